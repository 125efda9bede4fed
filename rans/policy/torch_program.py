"""A policy's program (`rans.policy.traced`) computed by torch."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor
from torch.nn import functional

from rans.model.fields import Field
from rans.policy.program import Program, RowStep
from rans.policy.scalars import EACH


class TorchProgram:
    """One row of a policy's program, by torch's operations on rows (N, k).

    Its tables are made at once, since a CUDA graph may not copy from a CPU.

    Args:
        program: written for a policy.
        result: name of the row.
        given: names of the rows and parameters from which it is computed.
        like: a tensor of the device and precision.
    """

    def __init__(self, program: Program, result: str, given: set[str], like: Tensor) -> None:
        self._result = result
        self._steps = program.needed([result], {*given, *program.parameters})
        self._constants: dict[str, Field | list[int]] = {}
        for name, x in program.constants.items():
            if x.dtype.kind == "i":
                self._constants[name] = x.tolist()
            else:
                self._constants[name] = float(x) if x.ndim == 0 else like.new_tensor(x)

    def __call__(self, rows: Mapping[str, Tensor]) -> Tensor:
        """The row (N, k) of rows and parameters that are given."""
        values: dict[str, Any] = self._constants | dict(rows)
        for step in self._steps:
            result = _computed(step, *(values[name] for name in step.inputs))
            pieces = result if step.operation == "Split" else [result]
            values.update(zip(step.outputs, pieces, strict=True))
        return values[self._result]


def _computed(step: RowStep, *arguments: Any) -> Any:
    """Value of a step, or its values for a split."""
    if step.operation in EACH:
        return EACH[step.operation](*arguments)
    match step.operation:
        case "Dense" if not step.attributes["activation"]:
            return functional.linear(*arguments)
        case "Split":
            return arguments[0].split(arguments[1], dim=-1)
        case "Concat":
            return torch.cat(arguments, dim=-1)
        case "MatMul":
            return arguments[0] @ arguments[1]
        case "ArgMax":
            return arguments[0].argmax(dim=-1)
        case "Gather":
            return arguments[0][arguments[1]]
    raise NotImplementedError(
        f"torch does not compute the operation {step.operation!r} of a backbone's program yet."
    )
