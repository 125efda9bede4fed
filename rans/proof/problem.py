"""Problems of `rans prove`: plant, start set, horizon and property, as read from a TOML file."""

from __future__ import annotations

import ast
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rans.errors import ConfigError, brief
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
        case ast.Constant(value=int() | float() as number):
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
    derivative = tuple(str(entry) for entry in table["derivative"])
    count = len(derivative)
    commands = table["commands"]
    steps = table["steps"]
    period = table["period"]
    if not (1 <= count <= MOST_STATES and isinstance(commands, int) and 1 <= commands <= count):
        raise ConfigError(
            f"{where}: a problem has 1 to {MOST_STATES} states and 1 to as many commands."
        )
    if not (isinstance(steps, int) and 1 <= steps <= MOST_STEPS):
        raise ConfigError(
            f"{where}: steps must be a whole number from 1 to {MOST_STEPS}, got {steps}."
        )
    if not (isinstance(period, int | float) and 0.0 < period <= 1e4):
        raise ConfigError(f"{where}: period must be above 0 and at most 10,000 s, got {period}.")
    lower, upper = (_numbers(table["start"].get(end), count, where) for end in ("lower", "upper"))
    if any(low > high for low, high in zip(lower, upper, strict=True)):
        raise ConfigError(f"{where}: start.lower must not be above start.upper.")
    end = None
    if "end" in table:
        end = Within(*(_numbers(table["end"].get(key), count, where) for key in ("lower", "upper")))
    problem = Problem(
        str(table["name"]),
        derivative,
        commands,
        float(period),
        steps,
        lower,
        upper,
        _property(table["keep"], count, where),
        end,
        text,
    )
    problem.rates([1.0] * count, [1.0] * commands)  # refuses formulas that are no polynomials
    return problem


def _property(
    table: dict[str, Any], count: int, where: object
) -> SpeedLimit | Avoid | KeepOut | Within:
    match table:
        case {"speed_limit": dict() as limit} if limit.keys() == {
            "position",
            "velocity",
            "base",
            "slope",
        }:
            indices = [tuple(limit["position"]), tuple(limit["velocity"])]
            _check_states([*indices[0], *indices[1]], count, where)
            base, slope = _numbers([limit["base"], limit["slope"]], 2, where)
            if slope < 0.0:
                raise ConfigError(f"{where}: keep.speed_limit.slope must be >= 0, got {slope}.")
            return SpeedLimit(indices[0], indices[1], base, slope)
        case {"avoid": dict() as box} if box.keys() == {"lower", "upper"}:
            return Avoid(_numbers(box["lower"], count, where), _numbers(box["upper"], count, where))
        case {"within": dict() as box} if box.keys() == {"lower", "upper"}:
            return Within(*(_numbers(box[key], count, where) for key in ("lower", "upper")))
        case {"keep_out": dict() as ball} if ball.keys() == {"position", "radius"}:
            _check_states(ball["position"], count, where)
            return KeepOut(tuple(ball["position"]), *_numbers([ball["radius"]], 1, where))
    raise ConfigError(
        f"{where}: keep is speed_limit with position, velocity, base and slope, keep_out with position and radius, "
        "or avoid or within with lower and upper."
    )


def _check_states(numbers: Any, count: int, where: object) -> None:
    """Refuse what is no list of numbers of states."""
    if not all(isinstance(i, int) and 0 <= i < count for i in numbers):
        raise ConfigError(
            f"{where}: position and velocity are numbers of states, 0 to {count - 1}."
        )


def _numbers(values: Any, count: int, where: object) -> tuple[float, ...]:
    good = isinstance(values, list) and len(values) == count
    if not good or not all(isinstance(x, int | float) and abs(x) < 1e9 for x in values):
        raise ConfigError(f"{where}: {brief(values)} must be {count} numbers below 1e9.")
    return tuple(float(x) for x in values)
