"""One step of an engine as a straight-line program, and what else is stored where an episode ends."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

from rans.episode.step import Episode, World, step_and_restart
from rans.model.fields import map_leaves
from rans.model.random import Draws
from rans.model.trace import Symbol, ordered, substituted
from rans.tasks.rewards import paid
from rans.tasks.settings import map_settings

Type = Literal["real", "float", "double", "int", "signed char"]
_TYPES: dict[str, Type] = {
    "int32": "int",
    "int8": "signed char",
    "float32": "float",
    "float64": "double",
}


@dataclass(frozen=True)
class Input:
    """A number that a step reads."""

    symbol: Symbol
    type: Type
    """In memory; an int has 32 bits."""
    source: Any
    """The array it lies in: one number for each spacecraft, or one for all."""

    @property
    def each(self) -> bool:
        """Whether every spacecraft has its own."""
        return len(self.source.shape) == 1


@dataclass(frozen=True)
class BufferWrite:
    """A number for each spacecraft that a step leaves behind."""

    array: Literal["memory", "reals", "flags", "final"]
    """"final": final observations, stored row by row, because few spacecraft write theirs."""
    row: int
    value: Symbol


@dataclass(frozen=True)
class StepShape:
    """Sizes of a step's results: rows of reals and rows of flags, each with a number for each spacecraft.

    Reals are the columns of an observation, then the terms of the reward, then their sum.
    """

    width: int
    terms: int

    FLAGS = ("terminated", "truncated", "reached")
    PIECE = 8
    """Final observations fill multiples of so many numbers: memory is written 32 bytes at a time."""

    @property
    def reals(self) -> int:
        """Number of rows."""
        return self.width + self.terms + 1

    @property
    def final_width(self) -> int:
        """Width of a row of final observations, whose last numbers are padding."""
        return -(-self.width // self.PIECE) * self.PIECE


@dataclass(frozen=True)
class StepProgram:
    """One step of N episodes as symbols.

    Its inputs are "command_0" ..., "memory_0" ..., "setting_0" ..., the seed's words "low" and "high", and the
    episodes' numbers "first" and "stride" (`rans.episode.step.restart`). Starts and goals are drawn
    for every spacecraft, and chosen where an episode ended; the kernel draws only in warps that need one.
    """

    memory: tuple[Input, ...]
    """Inputs that the episodes remember, with their places in memory."""
    settings: tuple[Input, ...]
    """Settings of the task that are in memory, since they may change or differ among spacecraft."""
    ended: Symbol
    """Whether an episode ends."""
    always: tuple[BufferWrite, ...]
    """Writes of every step."""
    at_end: tuple[BufferWrite, ...]
    """Further writes where an episode ended."""
    shape: StepShape
    commands: tuple[Symbol, ...]
    """Inputs that an action is written into."""
    observed: Callable[[], tuple[Symbol, ...]]
    """Traces the columns of the current observation, before a step."""

    def going(self) -> list[BufferWrite]:
        """Writes where no episode ends, simplified for that case."""
        return _given(self.always, self.ended, value=False)

    @cached_property
    def operations(self) -> int:
        """Number of operations of a step in which no episode ends."""
        return sum(
            bool(s.args) for s in ordered([self.ended, *(store.value for store in self.going())])
        )

    def rare(self) -> set[Symbol]:
        """Symbols that only the end of an episode needs, such as draws and final observations.

        A kernel computes them only in warps in which an episode ends.
        """
        everything = list(
            ordered([self.ended, *(store.value for store in (*self.always, *self.at_end))])
        )
        often = {self.ended, *(store.value for store in self.always)}
        chosen = set[Symbol]()
        for symbol in reversed(everything):
            if symbol in often:
                often.update(symbol.args[2:] if self._chooses(symbol) else symbol.args)
        for symbol in everything:
            if self._chooses(symbol) or not chosen.isdisjoint(symbol.args):
                chosen.add(symbol)
        return {s for s in everything if s.operation != "constant"} - often - chosen

    def _chooses(self, symbol: Symbol) -> bool:
        return symbol.operation == "where" and symbol.args[0] is self.ended


def trace_step(world: World, episode: Episode, dtype: Any) -> StepProgram:
    """Trace one step of these episodes; TypeError where a task does more than arithmetic on fields.

    What a store is called, and its row, is read by both executors: arrays of NumPy or torch, and the kernel's text.
    Symbols are numbered in the order in which memory and settings are walked; executors hand arrays over in that
    order.
    """
    settings: list[Input] = []
    setup = world.setup._replace(task=_with_symbols(world.task, settings))
    world = dataclasses.replace(world, setup=setup)
    memory, inputs = _remembered(episode)
    command = tuple(Symbol.input(f"command_{i}") for i in range(world.craft.command_count))
    low, high, first, stride = (
        Symbol.input(name, "int") for name in ("low", "high", "first", "stride")
    )
    draws = Draws(low, high, first, stride, dtype)
    stepped = step_and_restart(world, inputs, command, draws)
    outcome = stepped.outcome
    ended = stepped.outcome.ended
    terms, reward = paid(outcome.terms, outcome.terminated)
    stores = [
        *_rows("memory", stepped.after.memory()),
        *_rows("reals", (*stepped.observation, *terms.values(), reward)),
        *_rows("flags", (getattr(outcome, name) for name in StepShape.FLAGS)),
    ]
    # A store of what is in memory already is left out, where an episode goes on or everywhere.
    always = list[BufferWrite]()
    at_end = [*_rows("final", stepped.final_observation)]
    for store, going, begun in zip(
        stores, *(_given(stores, ended, x) for x in (False, True)), strict=True
    ):
        symbol = memory[store.row].symbol if store.array == "memory" else None
        if going.value is not symbol:
            always.append(store)
        elif begun.value is not symbol:
            at_end.append(begun)

    def observed() -> tuple[Symbol, ...]:
        return tuple(map(Symbol.constant, world.observe(world.recalled(inputs, draws), draws)))

    return StepProgram(
        memory,
        tuple(settings),
        ended,
        tuple(always),
        tuple(at_end),
        StepShape(len(stepped.observation), len(outcome.terms)),
        command,
        observed,
    )


def _rows(array: Any, values: Any) -> Iterator[BufferWrite]:
    return (BufferWrite(array, row, Symbol.constant(value)) for row, value in enumerate(values))


def _remembered(episode: Episode) -> tuple[tuple[Input, ...], Episode]:
    """The episode's arrays, and the episode with symbols in their place.

    Their order is that of `Episode.memory`, by which a step's results are written back.
    """
    types: list[Type] = [
        _TYPES[str(array.dtype).removeprefix("torch.")] for array in episode.memory()
    ]
    memory = tuple(
        Input(
            Symbol.input(f"memory_{row}", "real" if kind in ("float", "double") else "int"),
            kind,
            array,
        )
        for row, (array, kind) in enumerate(zip(episode.memory(), types, strict=True))
    )
    symbols = iter(stored.symbol for stored in memory)
    return memory, map_leaves(lambda x: x if isinstance(x, int | float) else next(symbols), episode)


def _with_symbols(settings: Any, result: list[Input]) -> Any:
    """A task with symbols for its numbers in memory, which are added to those found.

    Plain numbers stay in the program as constants. An array, as of a curriculum that moves, is
    read in every step.
    """

    def symbol(_: str, value: Any) -> Any:
        if isinstance(value, int | float):
            return value
        result.append(Input(Symbol.input(f"setting_{len(result)}"), "real", value))
        return result[-1].symbol

    return map_settings(symbol, settings)


def _given(stores: Sequence[BufferWrite], condition: Symbol, value: bool) -> list[BufferWrite]:
    """The stores where a condition is known."""
    values = substituted([store.value for store in stores], {condition: Symbol.constant(value)})
    return [dataclasses.replace(s, value=new) for s, new in zip(stores, values, strict=True)]
