"""CUDA kernels of an update between its matrix products: what torch would take ten passes over memory for."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property
from importlib.resources import files

import torch
from torch import Tensor

from rans.extend import ACTIVATIONS, Architecture, Symbol
from rans_machine_code.cuda.launch import Function
from rans_machine_code.cuda.source import Lines, indented
from rans_machine_code.loss_gradient import STATISTICS, Loss, LossProgram

_THREADS = 128
"""Threads of a block of the kernels; the launch bounds in update.cuh are the same number."""
_MOST = 2**16
"""Threads among which transitions are divided, to hide the latency of memory; of activations twice as many."""


class UpdateKernels:
    """Losses of on/off thrusters with their derivatives, and derivatives before an activation.

    Args:
        architecture: of a network with on/off thrusters and an activation that has a slope.
        heads: outputs of the network with their padding, a multiple of 8.
        loss: of a transition.
    """

    def __init__(self, architecture: Architecture, heads: int, loss: Loss) -> None:
        self._heads = heads
        functions, kernels = (
            files("rans_machine_code.cuda").joinpath(f"{name}.cuh").read_text()
            for name in ("functions", "update")
        )
        self.source = "\n".join(
            (
                "typedef float real;",
                f"#define THRUSTERS {architecture.thrusters}",
                f"#define HEADS {heads}",
                f"#define STATISTICS {STATISTICS}",
                functions,
                *_transition(architecture.thrusters, heads, loss),
                *_through(architecture.activation),
                kernels,
            )
        )
        """CUDA C++."""

    @cached_property
    def functions(self) -> dict[str, Function]:
        """Compiled kernels by name; errors are those of `Function`."""
        capability = torch.cuda.get_device_capability()
        return {name: Function(self.source, name, capability) for name in ("losses", "backward")}

    def losses(self, outputs: Tensor, *given: Tensor) -> tuple[Tensor, Tensor]:
        """Derivatives of the losses by the outputs (N, heads), bfloat16, and sums, to be added up.

        Sums (heads + statistics, threads) are of the derivatives and of the statistics.

        Args:
            outputs: (N, 2 heads) outputs by the rounded weights, then by their remainders.
            given: biases (heads,), actions (N, thrusters) of zeros and ones, and, (N,) each, their
                log-probability under the rollout's policy, advantages and targets of the critic's value.
        """
        count = len(outputs)
        threads = min(count, _MOST)
        result = outputs.new_empty(count, self._heads, dtype=torch.bfloat16)
        sums = outputs.new_empty(self._heads + STATISTICS, threads)
        self._launch("losses", threads, (outputs, *given, result, sums), (count, threads))
        return result, sums

    def backward(self, value: Tensor, after: Tensor) -> tuple[Tensor, Tensor]:
        """Derivatives before an activation function (N, units), bfloat16, and sums (rows, units), to be added up.

        Sums are of the rounded derivatives, as the matrix products take them.

        Args:
            value: (N, units) values of the function.
            after: (N, units) derivatives by the values.
        """
        count, width = value.shape
        groups = width // 8
        rows = min(count, 2 * _MOST // groups)
        result = torch.empty_like(value)
        sums = value.new_empty(rows, width, dtype=torch.float32)
        self._launch("backward", rows * groups, (value, after, result, sums), (count, groups, rows))
        return result, sums

    def _launch(
        self, name: str, threads: int, tensors: Sequence[Tensor], numbers: Sequence[int]
    ) -> None:
        with torch.cuda.device(tensors[0].device):
            blocks = -(-threads // _THREADS)
            pointers = [x.data_ptr() for x in tensors]
            self.functions[name].launch(blocks, _THREADS, pointers, numbers)


def _transition(thrusters: int, heads: int, loss: Loss) -> Iterator[str]:
    """The function `transition` in CUDA C++."""
    roots = LossProgram.of(thrusters, loss).roots
    places = [*range(thrusters + 1), *range(heads, heads + STATISTICS)]
    yield "__device__ inline void transition("
    yield "    const real* output, const real* command, real log_prob, real advantage, real target, real* found) {"
    lines = Lines()
    yield from indented(lines.values(roots))
    yield from (
        f"  found[{place}] = {lines.operand(root)};"
        for place, root in zip(places, roots, strict=True)
    )
    yield "}"


def _through(activation: str) -> Iterator[str]:
    """The function `through` in CUDA C++."""
    slope = ACTIVATIONS[activation].slope
    assert slope is not None
    lines = Lines()
    root = Symbol.input("after") * slope(Symbol.input("y"))
    yield "__device__ inline real through(real y, real after) {"
    yield from indented(lines.values([root]))
    yield f"  return {lines.operand(root)};"
    yield "}"
