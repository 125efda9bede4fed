"""Problems of `rans prove`: plant, start set, horizon and property, as read from a TOML file."""

from __future__ import annotations

import ast
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rans.errors import ConfigError, brief, counted
from rans.files import read_text
from rans.structure import read_toml

MOST_STATES = 12
"""Largest number of states."""
MOST_STEPS = 10_000
"""Largest number of control periods."""


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
class Avoid:
    """The state is never in a box."""

    lower: tuple[float, ...]
    upper: tuple[float, ...]

    def margins(self, states: np.ndarray) -> np.ndarray:
        """Distances (N,) of states (N, n) from the box along the best axis; negative inside."""
        below = np.array(self.lower) - states
        above = states - np.array(self.upper)
        return np.maximum(below, above).max(axis=1)


@dataclass(frozen=True)
class Within:
    """The state is always in a box."""

    lower: tuple[float, ...]
    upper: tuple[float, ...]

    def margins(self, states: np.ndarray) -> np.ndarray:
        """Margins (N,) of states (N, n) along their worst axis; negative outside."""
        return np.minimum(states - np.array(self.lower), np.array(self.upper) - states).min(axis=1)


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
class Problem:
    """Closed loop of a network, and what it is to keep."""

    name: str
    derivative: tuple[str, ...]
    """Derivative of each state by time, a polynomial of x0, x1, ... and the commands u0, u1, ..."""
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
    keep: SpeedLimit | Avoid | KeepOut | Within
    end: Within | None = None
    """Box in which every flight ends; None: anywhere."""
    text: str = ""
    """Text of the file."""

    @property
    def states(self) -> int:
        """Number of states."""
        return len(self.derivative)

    def rates(self, states: Sequence[Any], commands: Sequence[Any]) -> list[Any]:
        """Derivatives, of whatever can be added and multiplied."""
        values = {f"x{i}": x for i, x in enumerate(states)}
        values |= {f"u{i}": u for i, u in enumerate(commands)}
        return [polynomial_value(text, values) for text in self.derivative]

    def linear(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Matrices A (n, n) and B (n, p) of x' = A x + B u, or None if the plant is no such one."""
        states = self.states
        columns = [
            _Linear(row) for row in np.eye(states + self.commands, states + self.commands + 1)
        ]
        try:
            rates = self.rates(columns[:states], columns[states:])
        except _NotLinear:
            return None
        rows = np.array([_as_row(rate, states + self.commands + 1) for rate in rates])
        if rows[:, -1].any():
            return None
        return rows[:, :states], rows[:, states:-1]


class _NotLinear(Exception):
    """A product of two variables."""


class _Linear:
    """Linear function of all variables, whose last coefficient is the constant."""

    def __init__(self, row: np.ndarray) -> None:
        self.row = row

    def __add__(self, other: Any) -> _Linear:
        return _Linear(self.row + _as_row(other, len(self.row)))

    __radd__ = __add__

    def __neg__(self) -> _Linear:
        return _Linear(-self.row)

    def __sub__(self, other: Any) -> _Linear:
        return self + -other

    def __rsub__(self, other: Any) -> _Linear:
        return -self + other

    def __mul__(self, other: Any) -> _Linear:
        if isinstance(other, _Linear):
            raise _NotLinear
        return _Linear(other * self.row)

    __rmul__ = __mul__


def _as_row(value: Any, width: int) -> np.ndarray:
    if isinstance(value, _Linear):
        return value.row
    row = np.zeros(width)
    row[-1] = value
    return row


def polynomial_value(text: str, values: Mapping[str, Any]) -> Any:
    """Value of a polynomial: numbers, names, +, - and *; no other syntax is executed.

    Raises:
        ConfigError: the text is something else.
    """
    try:
        tree = ast.parse(text, mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise ConfigError(f"{brief(text)} is no formula.") from None
    return _value(tree, values, text, 0)


def _value(node: ast.expr, values: Mapping[str, Any], text: str, depth: int) -> Any:
    """Value of a part of a formula's syntax tree, at a depth of it."""
    if depth > 50:
        raise ConfigError(f"{brief(text)} is nested too deep.")

    def inner(operand: ast.expr) -> Any:
        return _value(operand, values, text, depth + 1)

    match node:
        case ast.Constant(value=int() | float() as number) if (
            type(number) is not bool and abs(number) < 1e300
        ):
            return float(number)
        case ast.Name(id=name) if name in values:
            return values[name]
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            return -inner(operand)
        case ast.BinOp(left=left, op=ast.Add(), right=right):
            return inner(left) + inner(right)
        case ast.BinOp(left=left, op=ast.Sub(), right=right):
            return inner(left) - inner(right)
        case ast.BinOp(left=left, op=ast.Mult(), right=right):
            return inner(left) * inner(right)
    raise ConfigError(
        f"{brief(text)} is no polynomial: formulas have numbers, {', '.join(values)}, +, - and *."
    )


def read_problem(file: Path) -> Problem:
    """Read a problem.

    Raises:
        ConfigError: the file is missing, has a wrong or unknown key, or a number out of range.
    """
    text = read_text(file)
    return problem_of(text, file)


def problem_of(text: str, where: object = "the problem") -> Problem:
    """Problem of a TOML text; raises as `read_problem`."""
    table = read_toml(text)
    required = {"name", "period", "steps", "derivative", "commands", "start", "keep"}
    if table.keys() - {"end"} != required:
        raise ConfigError(
            f"{where} must have the keys {', '.join(sorted(required))}, and has {', '.join(table)}."
        )
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
    problem = Problem(
        name,
        tuple(derivative),
        commands,
        period,
        steps,
        lower,
        upper,
        _property(table["keep"], count, where),
        Within(*_corners(table["end"], count, f"{where}: end")) if "end" in table else None,
        text,
    )
    problem.rates([1.0] * count, [1.0] * commands)  # refuses formulas that are no polynomials
    return problem


def _property(table: Any, count: int, where: object) -> SpeedLimit | Avoid | KeepOut | Within:
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
            return Avoid(*_corners(box, count, f"{where}: keep.avoid"))
        case {"within": dict() as box, **rest} if not rest:
            return Within(*_corners(box, count, f"{where}: keep.within"))
        case {"keep_out": dict() as ball, **rest} if not rest and ball.keys() == {
            "position",
            "radius",
        }:
            position = _state_numbers(ball["position"], count, f"{where}: keep.keep_out.position")
            (radius,) = _numbers([ball["radius"]], 1, f"{where}: keep.keep_out.radius")
            if not radius > 0.0:
                raise ConfigError(f"{where}: keep.keep_out.radius must be above 0, got {radius}.")
            return KeepOut(position, radius)
    raise ConfigError(
        f"{where}: keep is speed_limit with position, velocity, base and slope, keep_out with position and radius, "
        "or avoid or within with lower and upper."
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
