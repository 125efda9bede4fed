"""One step of an engine as a straight-line program, and what else is stored where an episode ends."""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from rans.fast.episode import Episodes, Simulation
from rans.model.fields import leaves, unflatten
from rans.model.trace import Symbol, ordered, substituted
from rans.tasks.base import is_moving

Type = Literal["real", "int", "signed char"]


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
        """Whether every spacecraft has one of its own."""
        return len(self.source.shape) == 1


@dataclass(frozen=True)
class Store:
    """A number for each spacecraft that a step leaves behind."""

    array: Literal["memory", "reals", "flags", "final"]
    """"final": final observations, stored row by row, because few spacecraft write theirs."""
    row: int
    value: Symbol


@dataclass(frozen=True)
class Shape:
    """Of a step's results: rows of reals and rows of flags, each with a number for each spacecraft."""

    width: int
    """Of an observation."""
    terms: int
    """Of the reward."""

    FLAGS = ("terminated", "truncated", "reached")
    PIECE = 8
    """Final observations fill multiples of so many numbers: memory is written 32 bytes at a time."""

    @property
    def reals(self) -> int:
        """Number of rows: observation, terms, reward."""
        return self.width + self.terms + 1

    @property
    def final_width(self) -> int:
        """Of a row of final observations, whose last numbers mean nothing."""
        return -(-self.width // self.PIECE) * self.PIECE


@dataclass(frozen=True)
class Program:
    """What a step computes from symbols.

    They are "command_0" ..., "memory_0" ..., "setting_0" ..., the seed's words "low" and "high", and the
    episodes' numbers "first" and "stride" (`rans.fast.episode.Simulation.step`). Starts and goals are drawn
    for every spacecraft, and chosen where an episode ended; the kernel draws only in warps that need one.
    """

    memory: tuple[Input, ...]
    """What the engine remembers."""
    settings: tuple[Input, ...]
    """Of task and mass properties, those that lie in memory: they may change, or differ."""
    ended: Symbol
    """Where an episode ends."""
    always: tuple[Store, ...]
    """What to store everywhere."""
    at_end: tuple[Store, ...]
    """What else to store where an episode ended."""
    shape: Shape
    """Of the results."""

    def going(self) -> list[Store]:
        """What is stored where no episode ends, with no more than that needs."""
        return _given(self.always, self.ended, value=False)

    def rare(self) -> set[Symbol]:
        """What only an episode's end needs, and no choice by it enters: draws and final observations."""
        everything = list(ordered([self.ended, *(store.value for store in (*self.always, *self.at_end))]))
        often, chosen = {self.ended, *(store.value for store in self.always)}, set[Symbol]()
        for symbol in reversed(everything):
            if symbol in often:
                often.update(symbol.args[2:] if self._chooses(symbol) else symbol.args)
        for symbol in everything:
            if self._chooses(symbol) or not chosen.isdisjoint(symbol.args):
                chosen.add(symbol)
        return {s for s in everything if s.operation != "constant"} - often - chosen

    def _chooses(self, symbol: Symbol) -> bool:
        return symbol.operation == "where" and symbol.args[0] is self.ended


def trace(simulation: Simulation, episodes: Episodes) -> Program:
    """Run one step on symbols.

    Args:
        simulation: what to run.
        episodes: those that the program will step.

    Raises:
        TypeError: the task's functions do more than arithmetic on fields.
    """
    settings: list[Input] = []
    simulation = dataclasses.replace(simulation, task=_with_symbols(simulation.task, settings),
                                     body=_with_symbols(simulation.body, settings))
    memory, inputs = _remembered(episodes)
    command = tuple(Symbol.input(f"command_{i}") for i in range(len(simulation.craft.thrusters)))
    words = (Symbol.input("low", "int"), Symbol.input("high", "int"))
    numbers = (Symbol.input("first", "int"), Symbol.input("stride", "int"))
    after, outcome = simulation.step(inputs, command, words, numbers)
    ended: Any = outcome.terminated | outcome.truncated
    shape = Shape(len(outcome.observation), len(outcome.terms))
    first = (*outcome.observation, *outcome.terms.values(), outcome.reward)
    stores = [
        *_rows("memory", after.memory()),
        *_rows("reals", first),
        *_rows("flags", (getattr(outcome, name) for name in Shape.FLAGS)),
    ]
    going, begun = (_given(stores, ended, value) for value in (False, True))
    stays = [s.array == "memory" and s.value is memory[s.row].symbol for s in going]
    return Program(
        memory=memory,
        settings=tuple(settings),
        ended=ended,
        always=tuple(store for store, same in zip(stores, stays, strict=True) if not same),
        at_end=(
            *_rows("final", outcome.final_observation),
            *(new for new, same in zip(begun, stays, strict=True) if same),
        ),
        shape=shape,
    )


def _rows(array: Any, values: Any) -> Iterator[Store]:
    return (Store(array, row, Symbol.constant(value)) for row, value in enumerate(values))


def _remembered(episodes: Episodes) -> tuple[tuple[Input, ...], Episodes]:
    """The episodes' arrays, and the episodes with symbols in their place."""
    arrays, switches = episodes.memory(), len(episodes.previous)
    types: list[Type] = ["real"] * (len(arrays) - 1 - switches)
    types.append("int")
    types.extend("signed char" for _ in range(switches))
    memory = tuple(
        Input(Symbol.input(f"memory_{row}", "real" if kind == "real" else "int"), kind, array)
        for row, (array, kind) in enumerate(zip(arrays, types, strict=True)))
    symbols = iter(given.symbol for given in memory)
    new = lambda x: x if isinstance(x, float) else next(symbols)  # noqa: E731
    state, goal = (unflatten(tree, [new(x) for x in leaves(tree)])
                   for tree in (episodes.state, episodes.goal))
    return memory, Episodes(state, goal, next(symbols), tuple(symbols))


def _with_symbols(setting: Any, found: list[Input]) -> Any:
    """A task, a body or a setting with symbols for the numbers in memory, which are added to those found."""
    if is_moving(setting) or len(getattr(setting, "shape", ())) == 1:
        symbol = Symbol.input(f"setting_{len(found)}")
        found.append(Input(symbol, "real", setting))
        return symbol
    if isinstance(setting, tuple):
        return tuple(_with_symbols(x, found) for x in setting)
    if not dataclasses.is_dataclass(setting):
        return setting
    changed = copy.copy(setting)  # not replaced: the settings were checked, and symbols cannot be
    for field in dataclasses.fields(setting):
        object.__setattr__(changed, field.name, _with_symbols(getattr(setting, field.name), found))
    return changed


def _given(stores: Sequence[Store], condition: Symbol, value: bool) -> list[Store]:
    """The stores where a condition is known."""
    values = substituted([s.value for s in stores], {condition: Symbol.constant(value)})
    return [Store(s.array, s.row, new) for s, new in zip(stores, values, strict=True)]
