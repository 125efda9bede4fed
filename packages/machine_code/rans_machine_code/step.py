"""The step of an engine as machine code."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from torch import Tensor

from rans.extend import Draws, Step, StepProgram, Symbol
from rans_machine_code.program import CompiledProgram, ProgramMemory

_BLOCK = 4096
"""Number of spacecraft whose numbers fit a processor's caches."""


class CompiledStep:
    """Step of N spacecraft in single precision, in blocks; one thread at a time may call it.

    Its results are new arrays; episodes, seeds and settings are read from their memory in every step.

    Args:
        program: of one step of these episodes.
        draws: random numbers of the episodes.
    """

    observe = None
    """See `rans.fast.machine_code.GeneratedStep`."""

    def __init__(self, program: StepProgram, draws: Draws) -> None:
        self._shape = program.shape
        self._given = [
            *(
                (parameter.symbol, parameter.source)
                for parameter in (*program.memory, *program.settings)
            ),
            *(
                (Symbol.input(word, "int"), value)
                for word, value in (
                    ("low", draws.low),
                    ("high", draws.high),
                    ("first", draws.first),
                )
            ),
        ]
        stride = Symbol.input("stride", "int")
        self._memory = [parameter.source for parameter in program.memory]
        self._count = len(self._memory[0])
        self._commands = program.commands
        self._stores = list(_everywhere(program))
        compiled = CompiledProgram(
            [*(symbol for symbol, _ in self._given), stride, *self._commands],
            [store.value for store in self._stores],
        )
        sizes = [min(_BLOCK, self._count - start) for start in range(0, self._count, _BLOCK)]
        room = {size: compiled.memory(size) for size in {*sizes}}
        for memory in room.values():
            memory.put(stride, draws.stride)
        self._blocks = [
            (slice(index * _BLOCK, index * _BLOCK + size), room[size])
            for index, size in enumerate(sizes)
        ]

    def __call__(self, action: Tensor) -> Step:
        """Hold the thrusters for one control period, see `Engine.step`; changes the episodes' memory in place."""
        shape = self._shape
        commands = action.numpy().T
        arrays = {
            "memory": self._memory,
            "reals": np.empty((shape.reals, self._count), np.float32),
            "flags": np.empty((len(shape.FLAGS), self._count), bool),
            "final": np.empty((self._count, shape.width), np.float32).T,
        }
        with np.errstate(all="ignore"):  # Branches that are not chosen may overflow.
            for rows, memory in self._blocks:
                self._block(rows, memory, commands, arrays)
        reals = torch.from_numpy(arrays["reals"])
        flags = torch.from_numpy(arrays["flags"])
        terms = shape.width + shape.terms
        terminated, truncated, reached = flags
        return Step(
            reals[: shape.width].T,
            reals[terms],
            terminated,
            truncated,
            torch.from_numpy(arrays["final"]).T,
            reached,
            reals[shape.width : terms],
        )

    def _block(
        self, rows: slice, memory: ProgramMemory, commands: np.ndarray, arrays: dict[str, Any]
    ) -> None:
        """Run the program on some rows of the batch, a block that fits into the caches; writes into ``arrays``.

        New memory is written over the old one in the end, when all results of these rows are computed.
        """
        for symbol, source in self._given:
            memory.put(symbol, source[rows] if np.ndim(source) else source)
        for symbol, command in zip(self._commands, commands, strict=True):
            memory.put(symbol, command[rows])
        for store, value in zip(self._stores, memory.run(0), strict=True):
            arrays[store.array][store.row][rows] = value


def _everywhere(program: StepProgram) -> Iterator[Any]:
    """Stores of every period: those of a reset are selected by ``ended``, since this has no branches.

    A final observation is written for every row; only where ``ended`` is true it is read.
    """
    yield from program.always
    for store in program.at_end:
        if store.array == "memory":
            old = program.memory[store.row].symbol
            store = replace(store, value=Symbol.apply("where", program.ended, store.value, old))
        yield store
