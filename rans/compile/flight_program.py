"""Whole episodes of one policy as a program: what begins one, what a policy is shown, what a step changes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from rans.effectors.commands import of_outputs
from rans.episode import World, step
from rans.model.fields import Field, leaves, unflatten
from rans.model.random import Draws
from rans.model.trace import Kind, Symbol
from rans.policy.architecture import Architecture
from rans.policy.program import inputs
from rans.policy.scalars import Stage, symbols
from rans.policy.traced import policy_program
from rans.verdict import FlightAccumulator


@dataclass(frozen=True)
class Carried:
    """A number that lives from step to step."""

    symbol: Symbol
    """It, as the step reads it."""
    begin: Symbol
    after: Symbol
    """The same symbol where no step changes it."""


class Lookup(NamedTuple):
    """Numbers that an executor reads from a table's places among others, instead of by comparisons."""

    name: str
    """Of the table."""
    found: tuple[Symbol, ...]
    """Inputs of what is computed with them."""
    source: tuple[Symbol, ...]
    table: np.ndarray
    """(S, n): for each side of the spacecraft, which of the sources each is."""


class RecalledRow(NamedTuple):
    """What the network is given of one row of a history, and which numbers it is made of."""

    then: tuple[Symbol, ...]
    shown: tuple[Symbol, ...]
    lookups: tuple[Lookup, ...]


class PolicyInFlight(NamedTuple):
    """What a policy does in every step of a flight."""

    carried: tuple[Carried, ...]
    """Of its filters, or of its recurrent core."""
    history: tuple[Carried, ...]
    stages: tuple[Stage, ...]
    """Its layers, in order."""
    commands: tuple[Symbol, ...]
    lookups: tuple[Lookup, ...]
    """Of them."""
    row: RecalledRow | None
    """One row of the history, for executors that loop over its rows: the last inputs of the first layer."""
    newest: tuple[Symbol, ...]
    """The row that the history is continued with."""
    view: Symbol
    """From which side it sees the spacecraft, int."""


@dataclass(frozen=True)
class FlightProgram:
    """What a flight computes from the seed's words "low" and "high" and the scenario's "number".

    In each step, from what is carried: inputs of the policy's layers; from their outputs, commands; and from these,
    "command_0" ..., what is carried a step later.
    """

    carried: tuple[Carried, ...]
    """Of the episode and its verdict, and `PolicyInFlight.carried`."""
    policy: PolicyInFlight
    going: Symbol
    """Whether the flight is not over, of `rans.verdict.FlightAccumulator`, over what is carried."""
    failure: Symbol
    """The number of a `rans.verdict.Failure`, int."""
    settles: Symbol
    """Whether it settled, bool, and at which instant."""
    settled: Symbol
    totals: tuple[Symbol, ...]
    """Return, impulse, and open thrusters summed over the last fifth."""


def trace_flight(
    world: World,
    architecture: Architecture,
    tables: Mapping[str, np.ndarray] | None = None,
) -> FlightProgram:
    """Run a flight on symbols.

    Args:
        world: in which the policy flies.
        architecture: the policy's architecture.
        tables: the policy's parameters (`rans.policy.traced.parameters`), to be written into the program. Without,
            those that no layer has are inputs, such as "mean_0", and what each side of the craft has in another
            place is a `Lookup`.

    Raises:
        TypeError: a task or the policy does more than arithmetic on fields.
    """
    low, high, number = (Symbol.input(name, "int") for name in ("low", "high", "number"))
    draws = Draws(low, high, number, 0, None)
    clock = Symbol.constant(0)
    first = world.begin(*world.scenario(clock, draws), clock, draws)
    begun = (first, FlightAccumulator.begin(world, first, effort=True))
    commands = tuple(Symbol.input(f"command_{i}") for i in range(len(world.craft.commands)))
    kinds = dict[int, Kind]()
    while True:
        # What begins as a number is carried only if some step changes it.
        begins = [
            _carried(place, value, kinds.get(place)) for place, value in enumerate(leaves(begun))
        ]
        now, verdict = unflatten(begun, begins)
        outcome = step(world, now, tuple(of_outputs(world.craft, commands)), draws)
        after = leaves((outcome.episode, verdict.after(world, outcome)))
        known = len(kinds)
        for place, (new, old) in enumerate(zip(map(Symbol.constant, after), begins, strict=True)):
            if not isinstance(old, Symbol) and new is not Symbol.constant(old):
                kinds[place] = new.kind
        if len(kinds) == known:
            break
    carried = tuple(
        Carried(symbol, Symbol.constant(old), Symbol.constant(new))
        for symbol, old, new in zip(begins, leaves(begun), after, strict=True)
        if isinstance(symbol, Symbol)
    )
    policy = _policy_in_flight(architecture, world.observe(now, draws), commands, tables)
    return FlightProgram(
        (*carried, *policy.carried),
        policy,
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


def _policy_in_flight(
    architecture: Architecture,
    observation: Sequence[Field],
    commands: Sequence[Symbol],
    tables: Mapping[str, np.ndarray] | None,
) -> PolicyInFlight:
    """A policy that observes these fields; its commands have these names afterwards."""
    program = policy_program(architecture)
    lookups = list[Lookup]()

    def looked_up(name: str, source: Sequence[Symbol], table: np.ndarray) -> list[Symbol]:
        rows = inputs(f"{name}_of", table.shape[1])
        lookups.append(Lookup(f"places_{len(lookups)}", tuple(rows), tuple(source), table))
        return rows

    gather = looked_up if tables is None else None
    known: dict[str, Sequence[Any]] = {"observation": observation}
    for name in ("mean", "scale", "zoom"):
        if tables is not None and name in program.parameters:
            known[name] = tables[name].tolist()
    sizes = (
        {"memory": architecture.units}
        if architecture.units
        else {"history": architecture.rows, "filters": architecture.filtering}
    )
    memory = {name: inputs(name, size) for name, size in sizes.items() if size}
    known |= memory

    # What it answers.
    asked = [name for name in ("command", "view") if program.has(name)]
    after = ["memory_out"] if memory else []
    rows, stages = symbols(program, known, asked + (after if architecture.units else []), gather)
    # A history of one row is looked up too: as a row by itself, below.
    answers = stages[-1].outputs
    of_commands = tuple(
        lookup for lookup in lookups if any(lookup.source[0] is answer for answer in answers)
    )

    # What it remembers of that; a recurrent core has said so already.
    if not architecture.units:
        newest = ["newest"] if architecture.recalled else []
        answered = known | {"command": commands}
        rows |= symbols(program, answered, after + newest, gather)[0]
    names = [symbol for part in memory.values() for symbol in part]
    remembered = tuple(
        Carried(symbol, Symbol.constant(0.0), new)
        for symbol, new in zip(names, rows.get("memory_out", ()), strict=True)
    )

    # One row of the history by itself.
    row = None
    if architecture.recalled and gather is not None:
        one = policy_program(replace(architecture, history=1, averages=()))
        then = inputs("then", architecture.row)
        known_lookups = len(lookups)
        recalled, _ = symbols(one, known | {"history": then}, ["recalled"], gather)
        own = tuple(lookups[known_lookups:])
        row = RecalledRow(tuple(then), tuple(recalled["recalled"]), own)
    return PolicyInFlight(
        remembered[architecture.rows :],
        remembered[: architecture.rows],
        stages,
        tuple(rows["command"]),
        of_commands,
        row,
        tuple(rows.get("newest", ())),
        rows["view"][0] if "view" in rows else Symbol.constant(0),
    )
