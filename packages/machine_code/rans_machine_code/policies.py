"""Programs of policies as symbols: of what a network is given, of the whole network, and of whole flights.

Machine code is written from them (`rans_machine_code.program`), and CUDA kernels (`rans_machine_code.cuda`).
"""

from __future__ import annotations

import contextlib
from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from typing import Any, NamedTuple, TypeVar

import numpy as np
from torch import Tensor

from rans.effectors.commands import of_outputs
from rans.episode.verdict import FlightAccumulator
from rans.extend import (
    Architecture,
    ColumnExecutor,
    Draws,
    Field,
    Network,
    Program,
    Symbol,
    TorchPreprocessor,
    World,
    inputs,
    leaves,
    step,
    unflatten,
)
from rans.model.trace import UNTRACEABLE
from rans.policy import scalars, traced

Made = TypeVar("Made")
IN_BODY = 0
VIEWED = 1
NEXT_FILTER_MEMORY = 2
"""Indices into `row_programs`, by the method of `ColumnExecutor` that each computes."""


class RowProgram(NamedTuple):
    """A function of one row as symbols."""

    columns: list[Symbol]
    outputs: list[Symbol]
    """Numbers, and in the end an integer: the side of the spacecraft that is viewed, else 0."""


def row_programs(architecture: Architecture) -> Iterator[RowProgram]:
    """Programs of one row, instead of hundreds of torch's operations.

    They compute the body frame of an observation, the view of columns and filters, and, where there are filters,
    their next memory from a command; in the order of `IN_BODY`, `VIEWED` and `NEXT_FILTER_MEMORY`.
    """
    policy = traced.policy_program(architecture)
    seen = {"body": architecture.read_count, "filters": architecture.filtering}
    views = ["view"] if policy.has("view") else []
    yield _row_program(policy, {"observation": architecture.layout.width}, ["body"])
    yield _row_program(policy, seen, ["seen", *views])
    if architecture.filtering:
        command = {"command": architecture.thrusters}
        yield _row_program(policy, seen | command, ["filters_after"])


def _row_program(policy: Program, widths: Mapping[str, int], asked: Sequence[str]) -> RowProgram:
    """Rows of a policy's program, of which the second is the side, from concatenated columns of its inputs."""
    columns = inputs("column", sum(widths.values()))
    rest = iter(columns)
    given = {name: list(islice(rest, width)) for name, width in widths.items()}
    outputs, _ = scalars.symbols(policy, given, asked)
    side = outputs["view"][0] if "view" in asked else Symbol.constant(0)
    return RowProgram(columns, [*outputs[asked[0]], side])


class RowsPreprocessor(ColumnExecutor):
    """Preprocessor by `row_programs`; torch computes gradients, and what cannot be compiled.

    Args:
        architecture: of the network.
        plain: torch's preprocessor.
    """

    def __init__(self, architecture: Architecture, plain: TorchPreprocessor) -> None:
        self._architecture = architecture
        self._plain = plain

    @abstractmethod
    def _run(self, number: int, rows: Tensor) -> tuple[Tensor, Tensor] | None:
        """Outputs (N, k) and integers (N,) of a program, by its index, of rows (N, width); None: torch must."""

    def in_body(self, observation: Tensor) -> Tensor:
        """See `ColumnExecutor`."""
        result = self._run(IN_BODY, observation)
        return self._plain.in_body(observation) if result is None else result[0]

    def viewed(self, rows: Tensor) -> tuple[Tensor, Tensor]:
        """See `ColumnExecutor`."""
        result = self._run(VIEWED, rows)
        return self._plain.viewed(rows) if result is None else result

    def next_filter_memory(self, rows: Tensor) -> Tensor:
        """See `ColumnExecutor`."""
        result = self._run(NEXT_FILTER_MEMORY, rows)
        return self._plain.next_filter_memory(rows) if result is None else result[0]

    def _made(self, make: Callable[[RowProgram], Made]) -> list[Made] | None:
        """What is made of each of `row_programs`; None for a layout that does more than arithmetic on fields.

        One after the other, as the order of an operation's operands depends on the symbols that are still known.
        """
        with contextlib.suppress(*UNTRACEABLE):
            return [*map(make, row_programs(self._architecture))]
        return None


class NetworkProgram(NamedTuple):
    """Log-odds of on/off thrusters as symbols, with dense layers between two programs of numbers."""

    observed: tuple[Symbol, ...]
    """Columns of an observation."""
    statistics: tuple[Symbol, ...]
    """Mean, scale and zoomed scale of every column."""
    features: tuple[Symbol, ...]
    """Inputs of the layers."""
    outputs: tuple[Symbol, ...]
    """Outputs of the layers, inputs of what follows."""
    log_odds: tuple[Symbol, ...]
    """In the order of the spacecraft's thrusters."""


def network_program(architecture: Architecture) -> NetworkProgram | None:
    """The whole actor, of one stage of layers; None where it takes more than arithmetic."""
    observed = inputs("observed", architecture.layout.width)
    with contextlib.suppress(*UNTRACEABLE):
        values, (stage,) = scalars.symbols(
            traced.policy_program(architecture), {"observation": observed}, ["placed_0"]
        )
        statistics = [
            symbol
            for name in ("mean", "scale", "zoom")
            for symbol in inputs(name, architecture.column_count)
        ]
        parts = (observed, statistics, stage.inputs, stage.outputs, values["placed_0"])
        return NetworkProgram(*map(tuple, parts))
    return None


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
    stages: tuple[scalars.Stage, ...]
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
    """Whether the flight goes on, as `rans.episode.verdict.FlightAccumulator` has it, from the state variables."""
    failure: Symbol
    """Number of a `rans.episode.verdict.Failure`, int."""
    settled: Symbol
    """Control period in which it settled, if it is solved."""
    totals: tuple[Symbol, ...]
    """Return, impulse, and open thrusters summed over the last fifth."""
    tables: Mapping[str, np.ndarray]
    """The policy's parameters by name."""


def trace_flight(world: World, network: Network, lookups: bool) -> FlightProgram:
    """Trace the program of a flight, by stepping an episode on symbols.

    Args:
        world: spacecraft, task, timing and conditions of the flight.
        network: the policy.
        lookups: whether parameters outside layers become inputs, such as "mean_0", and what is in another order on
            each side of the craft becomes a `Lookup`; otherwise parameters are written into the program.

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
    changed = dict[int, Symbol]()
    while True:
        state = [
            _state_symbol(index, value, changed.get(index))
            for index, value in enumerate(leaves(initial))
        ]
        episode, verdict = unflatten(initial, state)
        outcome = step(world, episode, tuple(of_outputs(world.craft, commands)), draws)
        after = leaves((outcome.episode, verdict.after(world, outcome)))
        count = len(changed)
        for index, (new, old) in enumerate(zip(map(Symbol.constant, after), state, strict=True)):
            if not isinstance(old, Symbol) and new is not Symbol.constant(old):
                changed[index] = new
        if len(changed) == count:
            break

    # The state variables, and the policy between two states.
    state_variables = tuple(
        StateVariable(symbol, Symbol.constant(old), Symbol.constant(new))
        for symbol, old, new in zip(state, leaves(initial), after, strict=True)
        if isinstance(symbol, Symbol)
    )
    tables = traced.parameters(network)
    policy = _policy_in_flight(
        network.architecture,
        world.observe(episode, draws),
        commands,
        None if lookups else tables,
    )
    return FlightProgram(
        (*state_variables, *policy.carried),
        policy,
        verdict.running,
        Symbol.constant(verdict.failure()),
        Symbol.constant(verdict.settled),
        tuple(map(Symbol.constant, leaves(verdict.effort))),
        tables,
    )


def _state_symbol(index: int, value: Any, changed: Symbol | None) -> Any:
    """Input symbol of a state variable; a number that no period changes stays itself.

    Args:
        index: of the leaf among those of the state.
        value: initial value, a number or a symbol.
        changed: what a period changes it to; None: no period is known to change it.
    """
    is_number = not isinstance(value, Symbol) or value.operation == "constant"
    if is_number and changed is None:
        return value.value if isinstance(value, Symbol) else value
    return Symbol.input(f"carried_{index}", (value if changed is None else changed).kind)


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
        tables: the policy's parameters, to be written into the program; None: they are looked up.
    """
    # Inputs: observation, memory, and parameters that no layer has.
    program = traced.policy_program(architecture)
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
    rows, stages = scalars.symbols(program, values, requested, gather)
    # Lookups of commands alone: those of a history are repeated for a row by itself, below.
    last_outputs = stages[-1].outputs
    command_lookups = tuple(
        lookup for lookup in lookups if any(lookup.source[0] is answer for answer in last_outputs)
    )

    # The next memory of histories and filters, from the commands.
    newest = ["newest"] if architecture.recalled else []
    with_commands = values | {"command": commands}
    rows |= scalars.symbols(program, with_commands, memory_rows + newest, gather)[0]
    state_symbols = [symbol for part in memory.values() for symbol in part]
    state = tuple(
        StateVariable(symbol, Symbol.constant(0.0), new)
        for symbol, new in zip(state_symbols, rows.get("memory_out", ()), strict=True)
    )

    # One row of the history by itself, for executors that loop over the rows.
    row = None
    if architecture.recalled and gather is not None:
        one_row_program = traced.policy_program(replace(architecture, history=1, averages=()))
        row_symbols = inputs("then", architecture.row)
        earlier_lookups = len(lookups)
        features, _ = scalars.symbols(
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
