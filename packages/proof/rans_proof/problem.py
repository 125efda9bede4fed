"""Problems of `rans prove`: plant, start set, horizon and property, as read from a TOML file.

A problem is stored as its text, which certificates quote: prover and checker read it each by itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rans.extend import ConfigError, brief, counted, read_text, read_toml
from rans_proof.formula import Tape, formula_value

MOST_STATES = 16
"""Largest number of states."""
MOST_STEPS = 10_000
"""Largest number of control periods."""
_MOST_FUNCTIONS = 1000
"""Linear functions of a property, or numbers that a network takes, at most."""


@dataclass(frozen=True)
class SpeedLimit:
    """|velocity| <= base + slope |position| at all times; vectors of any number of states."""

    position: tuple[int, ...]
    velocity: tuple[int, ...]
    base: float
    """m/s."""
    slope: float
    """1/s."""

    def margins(self, states: np.ndarray) -> np.ndarray:
        """Margins (N,) of states (N, n); negative where the property is broken."""
        speed = np.linalg.norm(states[:, list(self.velocity)], axis=1)
        distance = np.linalg.norm(states[:, list(self.position)], axis=1)
        return self.base + self.slope * distance - speed


@dataclass(frozen=True)
class KeepOut:
    """|position| >= radius at all times; position is of any number of states."""

    position: tuple[int, ...]
    radius: float
    """m."""

    def margins(self, states: np.ndarray) -> np.ndarray:
        """Margins (N,) of states (N, n); negative inside the ball."""
        return np.linalg.norm(states[:, list(self.position)], axis=1) - self.radius


@dataclass(frozen=True)
class StayIn:
    """|position| <= radius at all times; position is of any number of states."""

    position: tuple[int, ...]
    radius: float

    def margins(self, states: np.ndarray) -> np.ndarray:
        """Margins (N,) of states (N, n); negative outside of the ball."""
        return self.radius - np.linalg.norm(states[:, list(self.position)], axis=1)


@dataclass(frozen=True)
class HalfSpaces:
    """Linear functions of the state are not negative: every one, or at least one at each instant."""

    rows: tuple[tuple[float, ...], ...]
    """Factors of each function."""
    offsets: tuple[float, ...]
    """Its constant."""
    every: bool
    """False: one of them, no matter which, is enough."""

    def margins(self, states: np.ndarray) -> np.ndarray:
        """Margins (N,) of states (N, n) in the functions' own units."""
        values = states @ np.array(self.rows).T + np.array(self.offsets)
        return values.min(axis=1) if self.every else values.max(axis=1)


@dataclass(frozen=True)
class Box:
    """Lower and upper corner of a box of states."""

    lower: tuple[float, ...]
    upper: tuple[float, ...]

    def inside(self) -> HalfSpaces:
        """The state is in the box: every face is beyond it."""
        eye = np.eye(len(self.lower))
        rows = np.concatenate((eye, -eye))
        offsets = np.concatenate((-np.array(self.lower), self.upper))
        return HalfSpaces(tuple(map(tuple, rows.tolist())), tuple(offsets.tolist()), True)

    def outside(self) -> HalfSpaces:
        """The state is beyond one of the box's faces."""
        rows, offsets, _ = astuple(self.inside())
        return HalfSpaces(
            tuple(tuple(-x for x in row) for row in rows), tuple(-x for x in offsets), False
        )


Property = SpeedLimit | KeepOut | StayIn | HalfSpaces


@dataclass(frozen=True)
class Problem:
    """Closed loop of a network, and what it is to keep."""

    name: str
    derivative: tuple[str, ...]
    """Derivative of each state by time, a formula of x0, x1, ... and the commands u0, u1, ..."""
    commands: int
    """Number of commands, which are held for a control period."""
    period: float
    """Control period, s."""
    steps: int
    """Number of control periods from the start during which the property must hold."""
    lower: tuple[float, ...]
    """Lowest start."""
    upper: tuple[float, ...]
    """Highest start."""
    keep: Property | None
    """None: nothing but their end is asked of flights."""
    end: Box | None = None
    """Box in which every flight ends; None: anywhere. A state that never changes and starts in it has no ends here,
    since it needs no margin."""
    text: str = ""
    """Text of the file."""
    inputs: tuple[str, ...] = ()
    """What the network takes, linear functions of the state; (): the state."""
    begins: int = 0
    """Number of control periods after which the property must hold."""
    earliest: int = 0
    """Number of control periods after which a flight may be in the box of its end: it must be there at the end of
    one of them; 0: of the last."""

    @property
    def states(self) -> int:
        """Number of states."""
        return len(self.derivative)

    def rates(self, states: Sequence[Any], commands: Sequence[Any]) -> list[Any]:
        """Derivatives, of whatever formulas can be computed with."""
        values = {f"x{i}": x for i, x in enumerate(states)}
        values |= {f"u{i}": u for i, u in enumerate(commands)}
        return [formula_value(text, values) for text in self.derivative]

    def linear(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Matrices A (n, n) and B (n, p) of x' = A x + B u, or None if the plant is no such one.

        Then the motion is the matrix exponential, without Taylor series (`LinearPlant`).
        """
        names = [f"x{i}" for i in range(self.states)] + [f"u{i}" for i in range(self.commands)]
        try:
            rows = np.array([linear_function(rate, names) for rate in self.derivative])
        except NotLinear:
            return None
        if rows[:, -1].any():
            return None
        return rows[:, : self.states], rows[:, self.states : -1]

    def network_inputs(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Matrix (inputs, n) and offset of what the network takes, or None where it takes the state."""
        if not self.inputs:
            return None
        names = [f"x{i}" for i in range(self.states)]
        rows = np.array([linear_function(text, names) for text in self.inputs])
        return rows[:, :-1], rows[:, -1]

    def input_range(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Lowest and highest numbers that the network takes at the starts."""
        inputs = self.network_inputs()
        if inputs is None:
            return self.lower, self.upper
        middle, half = (0.5 * np.add(sign * np.array(self.lower), self.upper) for sign in (1, -1))
        at = inputs[0] @ middle + inputs[1]
        reach = np.abs(inputs[0]) @ half
        return tuple((at - reach).tolist()), tuple((at + reach).tolist())


def linear_function(text: str, names: Sequence[str]) -> np.ndarray:
    """Factors of names in a formula, and its constant as the last one.

    Raises:
        NotLinear: the formula is no linear function.
        ConfigError: it is no formula.
    """
    tape = Tape(len(names))
    variables = dict(zip(names, tape.variables, strict=True))
    result = tape.node(formula_value(text, variables))
    eye = np.eye(len(names) + 1)
    rows: list[np.ndarray] = []
    for operation in tape.operations:
        match operation:
            case "variable", number:
                row = eye[number]
            case "constant", value:
                row = value * eye[-1]
            case "sum", first, second:
                row = rows[first] + rows[second]
            case "multiple", first, factor:
                row = factor * rows[first]
            case "product", first, second if not rows[second][:-1].any():
                row = rows[second][-1] * rows[first]
            case "inverse", first if not rows[first][:-1].any():
                row = eye[-1] / rows[first][-1]
            case _:
                raise NotLinear
        rows.append(row)
    return rows[result.number]


class NotLinear(Exception):
    """A product or function of variables."""


def read_problem(file: Path) -> Problem:
    """Read a problem.

    Raises:
        ConfigError: the file is missing, has a wrong or unknown key, or a number out of range.
    """
    text = read_text(file)
    return problem_of(text, file)


def problem_of(text: str, where: object = "the problem") -> Problem:
    """Problem of a TOML text, with closed tables; errors begin with ``where`` and are those of `read_problem`.

    Texts that this accepts and the checker's own reader refuses end as refused certificates.
    """
    table = read_toml(text)
    required = {"name", "period", "steps", "derivative", "commands", "start"}
    if table.keys() - {"keep", "end", "inputs", "begins"} != required:
        raise ConfigError(
            f"{where} must have the keys {', '.join(sorted(required))}, and has {', '.join(table)}."
        )
    if not {"keep", "end"} & table.keys():
        raise ConfigError(f"{where} must have keep or end: what flights keep, or where they end.")
    # Sizes first, as all else depends on them.
    derivative = table["derivative"]
    if not (
        isinstance(derivative, list)
        and all(isinstance(entry, str) for entry in derivative)
        and 1 <= len(derivative) <= MOST_STATES
    ):
        raise ConfigError(f"{where}: derivative must be a list of 1 to {MOST_STATES} formulas.")
    count = len(derivative)
    name = table["name"]
    if not (isinstance(name, str) and len(name) <= 200 and name.isprintable()):
        raise ConfigError(f"{where}: name must be a line of at most 200 characters.")
    steps = table["steps"]
    commands = table["commands"]
    for key, value, largest in (("steps", steps, MOST_STEPS), ("commands", commands, count)):
        if type(value) is not int or not 1 <= value <= largest:
            raise ConfigError(
                f"{where}: {key} must be a whole number from 1 to {largest}, got {brief(value)}."
            )
    (period,) = _numbers([table["period"]], 1, f"{where}: period")
    if not 0.0 < period <= 1e4:
        raise ConfigError(f"{where}: period must be above 0 and at most 10,000 s, got {period}.")
    lower, upper = _corners(table["start"], count, f"{where}: start")
    begins = table.get("begins", 0)
    if type(begins) is not int or not 0 <= begins < steps:
        raise ConfigError(
            f"{where}: begins must be a whole number from 0 to {steps - 1}, got {brief(begins)}."
        )
    inputs = table.get("inputs", [])
    if "inputs" in table:
        _linear_rows(inputs, count, f"{where}: inputs")
    end, earliest = _end(table["end"], count, steps, where) if "end" in table else (None, 0)
    if end is not None:
        for i, rate in enumerate(derivative):
            is_inside = end.lower[i] <= lower[i] and upper[i] <= end.upper[i]
            if rate.strip() == "0" and is_inside:
                ends = (
                    (*x[:i], edge, *x[i + 1 :]) for x, edge in ((end.lower, -1e9), (end.upper, 1e9))
                )
                end = Box(*ends)
    problem = Problem(
        name,
        tuple(derivative),
        commands,
        period,
        steps,
        lower,
        upper,
        _property(table["keep"], count, where) if "keep" in table else None,
        end,
        text,
        tuple(inputs),
        begins,
        earliest,
    )
    # Refuses what is no formula.
    anything = np.full(1, np.nan)
    problem.rates([anything] * count, [anything] * commands)
    return problem


def _end(table: Any, count: int, steps: int, where: object) -> tuple[Box, int]:
    """Box of a flight's end, and after how many periods flights may be in it; `ConfigError` names the key."""
    table = dict(table) if isinstance(table, dict) else table
    earliest = table.pop("earliest", 0) if isinstance(table, dict) else 0
    if type(earliest) is not int or not 0 <= earliest <= steps:
        raise ConfigError(
            f"{where}: end.earliest must be a whole number from 0 to {steps}, got {brief(earliest)}."
        )
    return Box(*_corners(table, count, f"{where}: end")), earliest


def _linear_rows(
    formulas: Any, count: int, where: str
) -> tuple[tuple[tuple[float, ...], ...], tuple[float, ...]]:
    """Factors (a row each) and constants of linear functions of the state x0, x1 ...; `ConfigError` for others."""
    good = isinstance(formulas, list) and 1 <= len(formulas) <= _MOST_FUNCTIONS
    if not good or not all(isinstance(text, str) for text in formulas):
        raise ConfigError(f"{where} must be a list of 1 to {_MOST_FUNCTIONS} formulas.")
    names = [f"x{i}" for i in range(count)]
    rows = []
    for text in formulas:
        try:
            rows.append(linear_function(text, names))
        except NotLinear:
            raise ConfigError(
                f"{where}: {brief(text)} is no linear function of the state."
            ) from None
    table = np.array(rows)
    return tuple(map(tuple, table[:, :-1].tolist())), tuple(table[:, -1].tolist())


def _property(table: Any, count: int, where: object) -> Property:
    # One case a kind; what has another key is refused at the end.
    """Property of a table, one of a closed list, or a `ConfigError` that names the key."""
    match table:
        case {"speed_limit": dict() as limit, **rest} if not rest and limit.keys() == {
            "position",
            "velocity",
            "base",
            "slope",
        }:
            position = _state_numbers(
                limit["position"], count, f"{where}: keep.speed_limit.position"
            )
            velocity = _state_numbers(
                limit["velocity"], count, f"{where}: keep.speed_limit.velocity"
            )
            base, slope = _numbers([limit["base"], limit["slope"]], 2, f"{where}: keep.speed_limit")
            if slope < 0.0:
                raise ConfigError(f"{where}: keep.speed_limit.slope must be >= 0, got {slope}.")
            if len(velocity) != 2:
                raise ConfigError(
                    f"{where}: keep.speed_limit.velocity must be two states: a limit of a velocity in the plane is "
                    "proved."
                )
            return SpeedLimit(position, velocity, base, slope)
        case {"avoid": dict() as box, **rest} if not rest:
            return Box(*_corners(box, count, f"{where}: keep.avoid")).outside()
        case {"within": dict() as box, **rest} if not rest:
            return Box(*_corners(box, count, f"{where}: keep.within")).inside()
        case {"every": formulas, **rest} if not rest:
            return HalfSpaces(*_linear_rows(formulas, count, f"{where}: keep.every"), True)
        case {"some": formulas, **rest} if not rest:
            return HalfSpaces(*_linear_rows(formulas, count, f"{where}: keep.some"), False)
        case {"keep_out": dict() as ball, **rest} | {"stay_in": dict() as ball, **rest} if (
            not rest and (ball.keys() == {"position", "radius"})
        ):
            (kind,) = table
            position = _state_numbers(ball["position"], count, f"{where}: keep.{kind}.position")
            (radius,) = _numbers([ball["radius"]], 1, f"{where}: keep.{kind}.radius")
            if not radius > 0.0:
                raise ConfigError(f"{where}: keep.{kind}.radius must be above 0, got {radius}.")
            return (KeepOut if kind == "keep_out" else StayIn)(position, radius)
    raise ConfigError(
        f"{where}: keep is speed_limit with position, velocity, base and slope, keep_out or stay_in with position "
        "and radius, avoid or within with lower and upper, or every or some with a list of formulas that are not "
        "negative."
    )


def _state_numbers(numbers: Any, count: int, where: str) -> tuple[int, ...]:
    """Numbers of states, each at most once."""
    good = isinstance(numbers, list) and 1 <= len(numbers) <= count
    if not good or not all(type(i) is int and 0 <= i < count for i in numbers):
        raise ConfigError(f"{where} must be a list of numbers of states, 0 to {count - 1}.")
    if len(set(numbers)) != len(numbers):
        raise ConfigError(f"{where} has a state twice.")
    return tuple(numbers)


def _corners(box: Any, count: int, where: str) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Lower and upper corner of a box."""
    if not isinstance(box, dict) or box.keys() != {"lower", "upper"}:
        raise ConfigError(f"{where} must have lower and upper, and nothing else.")
    lower, upper = (_numbers(box[key], count, f"{where}.{key}") for key in ("lower", "upper"))
    if any(low > high for low, high in zip(lower, upper, strict=True)):
        raise ConfigError(f"{where}.lower must not be above {where.rpartition(' ')[2]}.upper.")
    return lower, upper


def _numbers(values: Any, count: int, where: str) -> tuple[float, ...]:
    good = isinstance(values, list) and len(values) == count
    if not good or not all(type(x) in (int, float) and abs(x) < 1e9 for x in values):
        raise ConfigError(f"{where}: {brief(values)} must be {counted(count, 'number')} below 1e9.")
    return tuple(float(x) for x in values)
