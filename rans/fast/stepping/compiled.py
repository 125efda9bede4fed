"""The step of an engine on a CPU as a straight-line program: for few spacecraft four times as fast as equations.

Equations on NumPy's arrays compute common expressions again for each formula and allocate memory for every result,
which takes most of the time of a step of a hundred spacecraft.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from torch import Tensor

from rans.compile.step_program import BufferWrite, StepProgram, StepShape, trace_step
from rans.episode import Episode, World
from rans.errors import RansWarning, is_installed
from rans.fast.stepping.step import Backend, Step, step_arrays, step_tensors
from rans.model.random import Draws
from rans.model.trace import UNTRACEABLE, Symbol
from rans.randomization.faults import sets_among

if TYPE_CHECKING:
    from rans.compile.cpu.program import ProgramMemory

_BLOCK = 4096
"""Number of spacecraft whose numbers fit a processor's caches."""
_MOST = 600
"""Largest number of an episode's values for which a program is generated. 538 values, with 40 delayed commands of
8 thrusters, take 9 s and 300 MB; 3,000, as at 1 kHz with valves that are 0.2 s late, took minutes and 14 GB."""


class GeneratedStep:
    """Step of N spacecraft in single precision, in blocks; one thread at a time may call it.

    Its results are new arrays; episodes, seeds and settings are read from their memory in every step.

    Raises:
        TypeError: the task does more than arithmetic on fields; so does an AttributeError.
    """

    def __init__(self, world: World, episode: Episode, draws: Draws) -> None:
        from rans.compile.cpu.program import (
            CompiledProgram,
        )  # It imports LLVM, which a GPU does not need.

        program = trace_step(world, episode, np.float32)
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
        self._count = len(episode.clock)
        self._commands = [Symbol.input(f"command_{i}") for i in range(world.craft.command_count)]
        self._stores = list(_everywhere(program))
        self._memory = [parameter.source for parameter in program.memory]
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
            "flags": np.empty((len(StepShape.FLAGS), self._count), bool),
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


class ArrayStep:
    """Step of the episodes of one engine on NumPy's arrays, which are changed in place.

    The first call generates the program, in 0.01 s in the plane and up to 1 s under conditions in space. The
    equations are used instead without llvmlite, in double precision, for tasks that do more than arithmetic on
    fields, and for episodes with more than `_MOST` values.
    """

    def __init__(self) -> None:
        self._generated: GeneratedStep | None = None
        self._tried = not is_installed("llvmlite")

    def __reduce__(self) -> tuple[type[ArrayStep], tuple[()]]:
        """A copy generates a program of its own, for other episodes."""
        return ArrayStep, ()

    def __call__(self, world: World, episode: Episode, action: Tensor, draws: Draws) -> Step:
        """Step actions (N, n) as `step_arrays`; the first call traces the program, or warns once."""
        small = len(episode.memory()) <= _MOST
        by_values = getattr(world.setup.guard, "by_values", False)
        if not self._tried and draws.dtype is np.float32 and small and not by_values:
            try:
                self._generated = GeneratedStep(world, episode, draws)
            except UNTRACEABLE as error:
                warnings.warn(
                    "this engine steps slower, as its task does more than arithmetic on fields: "
                    f"{error}",
                    RansWarning,
                    stacklevel=2,
                )
        self._tried = True
        return (
            self._generated(action)
            if self._generated
            else step_arrays(world, episode, action, draws)
        )


class TorchCompiledStep:
    """A step on tensors that torch compiles; where it cannot, the step runs eagerly, with a warning."""

    def __init__(self) -> None:
        # The compiler cannot trace linear programs, whose result is the same in every step.
        torch.compiler.assume_constant_result(sets_among)
        self._step = torch.compile(step_tensors, fullgraph=True, dynamic=False)

    def __call__(self, world: World, episode: Episode, action: Tensor, draws: Draws) -> Step:
        """Step actions (N, n) as `step_tensors`; what torch cannot compile is stepped as written from then on."""
        from torch._dynamo.exc import Unsupported  # the import takes seconds

        try:
            return self._step(world, episode, action, draws)
        except Unsupported as error:  # while it is traced, before anything has changed
            reason = str(error).partition("\n")[0]
            warnings.warn(
                "this engine steps slower, as torch cannot compile what its task does: "
                f"{reason.lower()}. Use functions of rans.model.fields, or do not compile.",
                RansWarning,
                stacklevel=2,
            )
            self._step = step_tensors
            return step_tensors(world, episode, action, draws)


def stepping(
    backend: Backend, compiled: bool, plain: bool = False
) -> Callable[[World, Episode, Tensor, Draws], Step]:
    """Function that steps one engine's episodes; all of them agree to rounding (`tests/fast/stepping`)."""
    if plain:
        return partial(step_tensors, plain=True)
    if compiled:
        return TorchCompiledStep()
    return ArrayStep() if backend.on_numpy else step_tensors


def _everywhere(program: StepProgram) -> Iterator[BufferWrite]:
    """Stores of every period: those of a reset are selected by ``ended``, since this has no branches.

    A final observation is written for every row; only where ``ended`` is true it is read.
    """
    yield from program.always
    for store in program.at_end:
        old = program.memory[store.row].symbol if store.array == "memory" else store.value
        chosen = Symbol.apply("where", program.ended, store.value, old)
        yield BufferWrite(
            store.array, store.row, chosen if store.array == "memory" else store.value
        )
