"""Whole episodes of one policy as a program: initial state, policy and one control period, as symbols.

Executors print it: CUDA kernels (`rans.compile.cuda.flight_source`) and machine code (`rans.compile.machine_code`).
"""

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
class StateVariable:
    """A number that is carried from one control period to the next."""

    symbol: Symbol
    """Its value in a period, an input of the program."""
    initial: Symbol
    """Its value where an episode begins."""
    next: Symbol
    """Its value in the next period; ``symbol`` itself where no period changes it."""


class Lookup(NamedTuple):
    """Numbers that an executor reads from a table's indices, instead of choosing them by comparisons."""

    name: str
    """Name of the table."""
    symbols: tuple[Symbol, ...]
    """The numbers, inputs of what is computed with them."""
    source: tuple[Symbol, ...]
    """The numbers to choose from."""
    table: np.ndarray
    """(S, n): for each side of the spacecraft, the index of each number in the source."""


class RecalledRow(NamedTuple):
    """Features of one row of a history, for executors that loop over the rows."""

    inputs: tuple[Symbol, ...]
    """The row as the memory holds it."""
    features: tuple[Symbol, ...]
    """Inputs of the first layer that it gives."""
    lookups: tuple[Lookup, ...]
    """Lookups that the features need."""


class PolicyInFlight(NamedTuple):
    """Traced computation of a policy in every control period of a flight."""

    carried: tuple[StateVariable, ...]
    """Memory of its filters."""
    history: tuple[StateVariable, ...]
    """Memory of its history."""
    stages: tuple[Stage, ...]
    """Its layers, in order."""
    commands: tuple[Symbol, ...]
    """Commands from the outputs of the last layer, 0 to 1."""
    lookups: tuple[Lookup, ...]
    """Lookups that the commands need."""
    row: RecalledRow | None
    """One row of the history, for executors that loop over its rows: the last inputs of the first layer."""
    newest: tuple[Symbol, ...]
    """The row that is appended to the history."""
    view: Symbol
    """Side from which the spacecraft is viewed, int."""


@dataclass(frozen=True)
class FlightProgram:
    """Program of a flight, whose inputs are the seed's words "low" and "high" and the scenario's "number".

    In each control period executors compute, in this order: inputs of the policy's layers from the state variables;
    from the layers' outputs commands; and from these, as inputs "command_0" ..., the next state.
    """

    carried: tuple[StateVariable, ...]
    """State variables of the episode, of its verdict, and `PolicyInFlight.carried`."""
    policy: PolicyInFlight
    """What the policy computes."""
    going: Symbol
    """Whether the flight goes on, as `rans.verdict.FlightAccumulator` has it, from the state variables."""
    failure: Symbol
    """Number of a `rans.verdict.Failure`, int."""
    settled: Symbol
    """Control period in which it settled, if it is solved."""
    totals: tuple[Symbol, ...]
    """Return, impulse, and open thrusters summed over the last fifth."""


def trace_flight(
    world: World,
    architecture: Architecture,
    tables: Mapping[str, np.ndarray] | None = None,
) -> FlightProgram:
    """Trace the program of a flight, by stepping an episode on symbols.

    Args:
        world: spacecraft, task, timing and conditions of the flight.
        architecture: the policy's architecture.
        tables: the policy's parameters (`rans.policy.traced.parameters`), to be written into the program. None:
            parameters outside layers become inputs, such as "mean_0", and what is in another order on each side
            of the craft becomes a `Lookup`.

    Raises:
        TypeError: a task or the policy does more than arithmetic on fields.
    """
    # The initial state.
    low, high, number = (Symbol.input(name, "int") for name in ("low", "high", "number"))
    draws = Draws(low, high, number, 0, None)
    clock = Symbol.constant(0)
    first = world.begin(*world.scenario(clock, draws), clock, draws)
    initial = (first, FlightAccumulator.begin(world, first, effort=True))

    # A control period. A number is a state variable only if some period changes it. To find these takes several
    # passes: in each, those that the last pass changed are symbols.
    commands = tuple(Symbol.input(f"command_{i}") for i in range(world.craft.command_count))
    kinds = dict[int, Kind]()
    while True:
        state = [
            _state_symbol(index, value, kinds.get(index))
            for index, value in enumerate(leaves(initial))
        ]
        episode, verdict = unflatten(initial, state)
        outcome = step(world, episode, tuple(of_outputs(world.craft, commands)), draws)
        after = leaves((outcome.episode, verdict.after(world, outcome)))
        count = len(kinds)
        for index, (new, old) in enumerate(zip(map(Symbol.constant, after), state, strict=True)):
            if not isinstance(old, Symbol) and new is not Symbol.constant(old):
                kinds[index] = new.kind
        if len(kinds) == count:
            break

    # The state variables, and the policy between two states.
    state_variables = tuple(
        StateVariable(symbol, Symbol.constant(old), Symbol.constant(new))
        for symbol, old, new in zip(state, leaves(initial), after, strict=True)
        if isinstance(symbol, Symbol)
    )
    policy = _policy_in_flight(architecture, world.observe(episode, draws), commands, tables)
    return FlightProgram(
        (*state_variables, *policy.carried),
        policy,
        verdict.running,
        Symbol.constant(verdict.failure()),
        Symbol.constant(verdict.settled),
        tuple(map(Symbol.constant, leaves(verdict.effort))),
    )


def _state_symbol(index: int, value: Any, kind: Kind | None) -> Any:
    """Input symbol of a state variable; a number that no period changes stays itself.

    Args:
        index: of the leaf among those of the state.
        value: initial value, a number or a symbol.
        kind: type of what a period changes it to; None: no period is known to change it.
    """
    symbol = value if isinstance(value, Symbol) and value.operation != "constant" else None
    if symbol is None and kind is None:
        return value.value if isinstance(value, Symbol) else value
    return Symbol.input(f"carried_{index}", kind or symbol.kind)  # type: ignore[union-attr]


def _policy_in_flight(
    architecture: Architecture,
    observation: Sequence[Field],
    commands: Sequence[Symbol],
    tables: Mapping[str, np.ndarray] | None,
) -> PolicyInFlight:
    """Trace the policy.

    Args:
        architecture: of the policy.
        observation: fields of an observation.
        commands: inputs that stand for the commands in what follows them.
        tables: see `trace_flight`.
    """
    # Inputs: observation, memory, and parameters that no layer has.
    program = policy_program(architecture)
    lookups = list[Lookup]()

    def look_up(name: str, source: Sequence[Symbol], table: np.ndarray) -> list[Symbol]:
        rows = inputs(f"{name}_of", table.shape[1])
        lookups.append(Lookup(f"places_{len(lookups)}", tuple(rows), tuple(source), table))
        return rows

    gather = look_up if tables is None else None
    values: dict[str, Sequence[Any]] = {"observation": observation}
    for name in ("mean", "scale", "zoom"):
        if tables is not None and name in program.parameters:
            values[name] = tables[name].tolist()
    sizes = {"history": architecture.rows, "filters": architecture.filtering}
    memory = {name: inputs(name, size) for name, size in sizes.items() if size}
    values |= memory

    # Layers, commands and view.
    requested = [name for name in ("command", "view") if program.has(name)]
    memory_rows = ["memory_out"] if memory else []
    rows, stages = symbols(program, values, requested, gather)
    # Lookups of commands alone: those of a history are repeated for a row by itself, below.
    last_outputs = stages[-1].outputs
    command_lookups = tuple(
        lookup for lookup in lookups if any(lookup.source[0] is answer for answer in last_outputs)
    )

    # The next memory of histories and filters, from the commands.
    newest = ["newest"] if architecture.recalled else []
    with_commands = values | {"command": commands}
    rows |= symbols(program, with_commands, memory_rows + newest, gather)[0]
    state_symbols = [symbol for part in memory.values() for symbol in part]
    state = tuple(
        StateVariable(symbol, Symbol.constant(0.0), new)
        for symbol, new in zip(state_symbols, rows.get("memory_out", ()), strict=True)
    )

    # One row of the history by itself, for executors that loop over the rows.
    row = None
    if architecture.recalled and gather is not None:
        one_row_program = policy_program(replace(architecture, history=1, averages=()))
        row_symbols = inputs("then", architecture.row)
        earlier_lookups = len(lookups)
        features, _ = symbols(
            one_row_program, values | {"history": row_symbols}, ["recalled"], gather
        )
        lookups_of_row = tuple(lookups[earlier_lookups:])
        row = RecalledRow(tuple(row_symbols), tuple(features["recalled"]), lookups_of_row)
    return PolicyInFlight(
        state[architecture.rows :],
        state[: architecture.rows],
        stages,
        tuple(rows["command"]),
        command_lookups,
        row,
        tuple(rows.get("newest", ())),
        rows["view"][0] if "view" in rows else Symbol.constant(0),
    )
