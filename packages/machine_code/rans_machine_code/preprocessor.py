"""Preprocessing of observations, and whole networks, as machine code over NumPy's arrays."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property

import numpy as np
import torch
from torch import Tensor

from rans.extend import Architecture, ColumnExecutor, TorchPreprocessor
from rans_machine_code.network import CpuActorCritic
from rans_machine_code.policies import RowsPreprocessor, network_program
from rans_machine_code.program import CompiledProgram, ProgramMemory

_MOST_ROWS = 4096
"""Rows that the programs take; more, as a whole rollout's, are left to torch, which uses several cores."""


def preprocessor(
    architecture: Architecture, plain: TorchPreprocessor, like: Tensor
) -> ColumnExecutor:
    """Machine code in single precision; torch's in double precision, which only serves comparisons."""
    is_single = like.dtype == torch.float32
    return CpuPreprocessor(architecture, plain) if is_single else plain


class CpuPreprocessor(RowsPreprocessor):
    """Preprocessor on a CPU: machine code over NumPy arrays, in single precision; not thread-safe.

    Args:
        architecture: of the network.
        plain: preprocessor for gradients, for large batches, and for what cannot be compiled.
    """

    def __init__(self, architecture: Architecture, plain: TorchPreprocessor) -> None:
        super().__init__(architecture, plain)
        self._actor_critic: tuple[Tensor, CpuActorCritic | None] | None = None
        """Whole network compiled with the weights of a tensor, and that tensor."""

    def __reduce__(self) -> tuple[type[CpuPreprocessor], tuple[Architecture, TorchPreprocessor]]:
        """Pickling leaves out compiled code and scratch memory, which a copy makes anew."""
        return CpuPreprocessor, (self._architecture, self._plain)

    def whole(
        self, observation: Tensor, tensors: Mapping[str, Tensor]
    ) -> tuple[Tensor, Tensor] | None:
        """Log-odds (N, thrusters) and values (N,), or None; see `ColumnExecutor`. Compiled once a network."""
        weight = tensors["value_net.weight"]
        if torch.is_grad_enabled() or observation.requires_grad:
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
        architecture = self._architecture
        if CpuActorCritic.capabilities.missing(architecture):
            return None
        program = network_program(architecture)
        return CpuActorCritic(architecture, program, tensors) if program else None

    @cached_property
    def _programs(self) -> list[CompiledProgram] | None:
        """Compiled programs of the preprocessing; None if it cannot be traced."""
        return self._made(lambda program: CompiledProgram(*program))

    @cached_property
    def _memory(self) -> dict[tuple[int, int], ProgramMemory]:
        """Scratch memory by the index of a program and the number of rows."""
        return {}

    def _run(self, number: int, rows: Tensor) -> tuple[Tensor, Tensor] | None:
        """See `RowsPreprocessor`; `tests/test_preprocessor.py` asks for torch's numbers.

        Memory is made once for each length of the rows; the results are copies.
        """
        if rows.requires_grad or len(rows) > _MOST_ROWS or self._programs is None:
            return None
        if (memory := self._memory.get((number, len(rows)))) is None:
            self._memory[number, len(rows)] = memory = self._programs[number].memory(len(rows))
        memory.give(rows.numpy().T)
        *outputs, side = memory.run(0)
        return torch.from_numpy(np.stack(outputs)).T, torch.from_numpy(side.astype(np.int64))
