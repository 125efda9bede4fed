"""Whole episodes of one policy as a program: what begins one, what a policy is shown, what a step changes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rans.effectors.commands import of_outputs
from rans.episode import World, step
from rans.model.fields import Field, leaves, unflatten, where
from rans.model.random import Draws
from rans.model.trace import Kind, Symbol
from rans.policy.architecture import Architecture
from rans.policy.symmetry import AIM, Symmetries
from rans.tasks.observation_terms import Layout
from rans.verdict import FlightAccumulator

_Row = tuple[Symbol, ...]


@dataclass(frozen=True)
class Carried:
    """A number that lives from step to step."""

    symbol: Symbol
    """It, as the step reads it."""
    begin: Symbol
    after: Symbol
    """The same symbol where no step changes it."""


@dataclass(frozen=True)
class FlightProgram:
    """What a flight computes from the seed's words "low" and "high" and the scenario's "number".

    Before the policy is asked, from "carried_0" ...: what it is shown. After it has answered "command_0" ...:
    the same numbers a step later. A policy with a history is also shown earlier rows, made of "then_0" ...,
    what it saw then.
    """

    carried: tuple[Carried, ...]
    columns: tuple[Symbol, ...]
    """In the body frame: what a history remembers."""
    seen: tuple[Symbol, ...]
    """The same from the side of the spacecraft that has the goal ahead, and as filters have them."""
    then: tuple[Symbol, ...]
    """Earlier columns "then_0" ... from that side."""
    view: Symbol
    """Which side that is, int."""
    going: Symbol
    """Whether the flight is not over, of `rans.verdict.FlightAccumulator`, over what is carried."""
    failure: Symbol
    """The number of a `rans.verdict.Failure`, int."""
    settles: Symbol
    """Whether it settled, bool, and at which instant."""
    settled: Symbol
    totals: tuple[Symbol, ...]
    """Return, impulse, and open thrusters summed over the last fifth."""


def trace_flight(world: World, given: Architecture) -> FlightProgram:
    """Run a flight on symbols; TypeError where a task does more than arithmetic on fields."""
    low, high, number = (Symbol.input(name, "int") for name in ("low", "high", "number"))
    draws = Draws(low, high, number, 0, None)
    clock = Symbol.constant(0)
    first = world.begin(*world.scenario(clock, draws), clock, draws)
    begun = (first, FlightAccumulator.begin(world, first, effort=True))
    commands = tuple(Symbol.input(f"command_{i}") for i in range(len(world.craft.commands)))
    kinds = dict[int, Kind]()
    while True:
        # What begins as a number is carried only if some step changes it.
        inputs = [
            _carried(place, value, kinds.get(place)) for place, value in enumerate(leaves(begun))
        ]
        now, verdict = unflatten(begun, inputs)
        outcome = step(world, now, tuple(of_outputs(world.craft, commands)), draws)
        after = leaves((outcome.episode, verdict.after(world, outcome)))
        known = len(kinds)
        for place, (new, old) in enumerate(zip(map(Symbol.constant, after), inputs, strict=True)):
            if not isinstance(old, Symbol) and new is not Symbol.constant(old):
                kinds[place] = new.kind
        if len(kinds) == known:
            break
    carried = tuple(
        Carried(symbol, Symbol.constant(old), Symbol.constant(new))
        for symbol, old, new in zip(inputs, leaves(begun), after, strict=True)
        if isinstance(symbol, Symbol)
    )
    filters = [Symbol.input(f"filter_{i}") for i in range(given.filtering)]
    columns, seen, then, view = shown(given, world.observe(now, draws), filters)
    expected = given.expected((*columns, *filters, *commands))
    carried += tuple(
        Carried(symbol, Symbol.constant(0.0), after)
        for symbol, after in zip(filters, expected, strict=True)
    )
    return FlightProgram(
        carried,
        columns,
        seen,
        then,
        view,
        verdict.running,
        Symbol.constant(verdict.failure()),
        verdict.settles,
        Symbol.constant(verdict.settled),
        tuple(map(Symbol.constant, leaves(verdict.effort))),
    )


def _carried(place: int, value: Any, kind: Kind | None) -> Any:
    """A symbol for a number that varies; one that never does is itself."""
    symbol = value if isinstance(value, Symbol) and value.operation != "constant" else None
    if symbol is None and kind is None:
        return value.value if isinstance(value, Symbol) else value
    return Symbol.input(f"carried_{place}", kind or symbol.kind)  # type: ignore[union-attr]


def shown(
    given: Architecture, observation: Sequence[Field], filters: Sequence[Symbol] = ()
) -> tuple[_Row, _Row, _Row, Symbol]:
    """Columns in the body frame, those and earlier ones as they are seen, and from which side.

    What filters make of the columns, of what they remember, is seen beside them.
    """
    columns = tuple(map(Symbol.constant, given.layout.in_body(tuple(observation))))
    body = given.layout.body
    then = tuple(Symbol.input(f"then_{i}") for i in range(len(columns)))
    way = body.ahead(columns)
    blocks = given.filtered((*columns, *filters))
    if given.symmetries is None or way is None:
        return columns, tuple(x for _, block in blocks for x in block), then, Symbol.constant(0)
    which, turn, hand = side(given.symmetries, way)
    seen = tuple(x for layout, block in blocks for x in viewed(layout, block, turn, hand))
    return columns, seen, viewed(body, then, turn, hand), which


def side(views: Symmetries, way: Sequence[Field]) -> tuple[Symbol, list[list[Field]], Field]:
    """As `Symmetries.which`: the side with the goal ahead, its matrix and hand."""
    axes = range(len(way))
    best = None
    which = Symbol.constant(0)
    turn = [[0.0] * len(way) for _ in axes]
    hand = 1.0
    # Rounding noise in a matrix would cost operations.
    for number, (matrix, mirror) in enumerate(
        zip(np.round(views.turn, 12).tolist(), views.hand.tolist(), strict=True)
    ):
        ahead = sum(way[j] * sum(AIM[i] * matrix[i][j] for i in axes) for j in axes)
        if best is None:
            best = ahead
            turn = matrix
            hand = mirror
            continue
        nearer = ahead > best
        best = where(nearer, ahead, best)
        which = where(nearer, number, which)
        hand = where(nearer, mirror, hand)
        turn = [[where(nearer, matrix[i][j], turn[i][j]) for j in axes] for i in axes]
    return which, turn, hand


def viewed(
    body: Layout, columns: Sequence[Symbol], turn: list[list[Field]], hand: Field
) -> tuple[Symbol, ...]:
    """As `Symmetries.viewed`."""

    def view(u: Sequence[Field]) -> list[Field]:
        return [sum(turn[i][j] * x for j, x in enumerate(u)) for i in range(len(u))]

    return tuple(map(Symbol.constant, body.mirrored(columns, view, hand)))
