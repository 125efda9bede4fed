"""Preprocessing of observations, and whole networks, as machine code over NumPy's arrays."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property

import numpy as np
import torch
from torch import Tensor

from rans.extend import ColumnExecutor, PolicyPrograms, TorchPreprocessor
from rans_machine_code.network import CpuActorCritic
from rans_machine_code.program import CompiledProgram, ProgramMemory

_MOST_ROWS = 4096
"""Rows that the programs take; more, as a whole rollout's, are left to torch, which uses several cores."""
_IN_BODY = 0
_VIEWED = 1
_NEXT_FILTER_MEMORY = 2
"""Indices into `PolicyPrograms.rows`, by the method of `ColumnExecutor` that each computes."""


class CpuPreprocessor(ColumnExecutor):
    """Preprocessor on a CPU: machine code over NumPy arrays, in single precision; not thread-safe.

    Args:
        policy: programs of the network.
        plain: preprocessor for gradients, for large batches, and for what cannot be compiled.
    """

    def __init__(self, policy: PolicyPrograms, plain: TorchPreprocessor) -> None:
        self._policy = policy
        self._plain = plain
        self._actor_critic: tuple[Tensor, CpuActorCritic | None] | None = None
        """Whole network compiled with the weights of a tensor, and that tensor."""

    def __reduce__(self) -> tuple[type[CpuPreprocessor], tuple[PolicyPrograms, TorchPreprocessor]]:
        """Pickling leaves out compiled code and scratch memory, which a copy makes anew."""
        return CpuPreprocessor, (self._policy, self._plain)

    def in_body(self, observation: Tensor) -> Tensor:
        """See `ColumnExecutor`."""
        return (
            self._rows(_IN_BODY, observation)[0]
            if self._can_run(observation)
            else self._plain.in_body(observation)
        )

    def viewed(self, rows: Tensor) -> tuple[Tensor, Tensor]:
        """See `ColumnExecutor`."""
        return self._rows(_VIEWED, rows) if self._can_run(rows) else self._plain.viewed(rows)

    def next_filter_memory(self, rows: Tensor) -> Tensor:
        """See `ColumnExecutor`."""
        return (
            self._rows(_NEXT_FILTER_MEMORY, rows)[0]
            if self._can_run(rows)
            else self._plain.next_filter_memory(rows)
        )

    def whole(
        self, observation: Tensor, tensors: Mapping[str, Tensor]
    ) -> tuple[Tensor, Tensor] | None:
        """Log-odds (N, thrusters) and values (N,), or None; see `ColumnExecutor`. Compiled once a network."""
        weight = tensors["value_net.weight"]
        if torch.is_grad_enabled() or not _is_plain_forward(observation):
            return None
        # Weights are compiled in: new tensors need new code.
        if self._actor_critic is None or self._actor_critic[0] is not weight:
            self._actor_critic = weight, self._compiled_actor_critic(tensors)
        run = self._actor_critic[1]
        return None if run is None else run(observation)

    def _compiled_actor_critic(self, tensors: Mapping[str, Tensor]) -> CpuActorCritic | None:
        """The whole network as machine code with these tensors; None if it has parts that this lacks.

        Asked for every new tensor of weights; networks of one shape share their machine code.
        """
        architecture = self._policy.architecture
        if CpuActorCritic.capabilities.missing(architecture):
            return None
        program = self._policy.network()
        return CpuActorCritic(architecture, program, tensors) if program else None

    def _can_run(self, rows: Tensor) -> bool:
        return _is_plain_forward(rows) and len(rows) <= _MOST_ROWS and self._programs is not None

    @cached_property
    def _programs(self) -> list[CompiledProgram] | None:
        """Compiled programs of the preprocessing; None if it cannot be traced.

        The last output of each is a whole number, the side; `tests/compile/test_preprocess.py` asks for torch's
        numbers.
        """
        rows = self._policy.rows()
        return None if rows is None else [CompiledProgram(*program) for program in rows]

    @cached_property
    def _memory(self) -> dict[tuple[int, int], ProgramMemory]:
        """Scratch memory by the index of a program and the number of rows."""
        return {}

    def _rows(self, number: int, rows: Tensor) -> tuple[Tensor, Tensor]:
        """Outputs (N, k) and integers (N,) of a program, by its index, of rows (N, width).

        Memory is made once for each length of the rows; the results are copies.
        """
        assert self._programs is not None
        if (memory := self._memory.get((number, len(rows)))) is None:
            self._memory[number, len(rows)] = memory = self._programs[number].memory(len(rows))
        memory.give(rows.numpy().T)
        *outputs, side = memory.run(0)
        return torch.from_numpy(np.stack(outputs)).T, torch.from_numpy(side.astype(np.int64))


def _is_plain_forward(rows: Tensor) -> bool:
    """Whether rows need neither gradients nor torch's compiler, which has no machine code."""
    return not (torch.compiler.is_compiling() or rows.requires_grad)
