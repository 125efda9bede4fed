"""Problems of `rans prove`: plant, start set, horizon and property, as read from a TOML file.

A problem is stored as its text, which certificates quote: prover and checker read it each by itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple, dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from rans.extend import ConfigError, brief, counted, read_text, read_toml, structure
from rans_proof.formula import Tape, formula_value

Number = int | float
"""A number of a file, of which one without a point stays a whole one."""
MOST_STATES = 16
"""Largest number of states."""
MOST_STEPS = 10_000
"""Largest number of control periods."""
_LARGEST = 1e9
"""Numbers of a problem are smaller."""
_MOST_FUNCTIONS = 1000
"""Linear functions of a property, or numbers that a network takes, at most."""


@dataclass(frozen=True)
class Distances:
    """base + slope |position| - |velocity| is not negative; both are vectors of states, and one of none is 0."""

    base: float
    slope: float
    position: tuple[int, ...]
    velocity: tuple[int, ...]

    def margins(self, states: np.ndarray) -> np.ndarray:
        """Margins (N,) of states (N, n); negative where the property is broken."""
        distance, speed = (
            np.linalg.norm(states[:, list(numbers)], axis=1)
            for numbers in (self.position, self.velocity)
        )
        return self.base + self.slope * distance - speed


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

    def __post_init__(self) -> None:
        are_numbers = all(abs(x) <= _LARGEST for x in (*self.lower, *self.upper))
        _need(
            are_numbers and len(self.lower) == len(self.upper),
            "lower and upper must be lists of as many numbers below 1e9",
        )
        is_box = all(low <= high for low, high in zip(self.lower, self.upper, strict=True))
        _need(is_box, "lower must not be above upper")

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


Property = Distances | HalfSpaces


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
    """Factors of names in a formula, and its constant as the last one, computed as fractions and rounded once.

    Raises:
        NotLinear: the formula is no linear function.
        ConfigError: it is no formula.
    """
    tape = Tape(len(names))
    variables = dict(zip(names, tape.variables, strict=True))
    result = tape.node(formula_value(text, variables))
    eye = np.eye(len(names) + 1, dtype=object)
    rows: list[np.ndarray] = []
    for operation in tape.operations:
        match operation:
            case "variable", number:
                row = eye[number]
            case "constant", value:
                row = Fraction(value) * eye[-1]
            case "sum", first, second:
                row = rows[first] + rows[second]
            case "multiple", first, factor:
                row = Fraction(factor) * rows[first]
            case "product", first, second if not rows[second][:-1].any():
                row = rows[second][-1] * rows[first]
            case "inverse", first if not rows[first][:-1].any() and rows[first][-1]:
                row = eye[-1] / rows[first][-1]
            case _:
                raise NotLinear(brief(text))
        rows.append(row)
    try:
        return rows[result.number].astype(float)
    except OverflowError:  # beyond the largest double
        raise NotLinear(brief(text)) from None


class NotLinear(Exception):
    """A product or function of variables; the message is the formula."""


def read_problem(file: Path) -> Problem:
    """Read a problem.

    Raises:
        ConfigError: the file is missing, has a wrong or unknown key, or a number out of range.
    """
    text = read_text(file)
    return problem_of(text, file)


@dataclass(frozen=True)
class _End(Box):
    earliest: Number = 0


@dataclass(frozen=True)
class _Ball:
    position: tuple[Number, ...]
    radius: float

    def __post_init__(self) -> None:
        _need(0.0 < self.radius < _LARGEST, f"radius must be above 0, got {self.radius}")


@dataclass(frozen=True)
class _SpeedLimit:
    position: tuple[Number, ...]
    velocity: tuple[Number, ...]
    base: float
    slope: float

    def __post_init__(self) -> None:
        _need(abs(self.base) < _LARGEST, f"base must be a number below 1e9, got {self.base}")
        _need(0.0 <= self.slope < _LARGEST, f"slope must be >= 0, got {self.slope}")
        _need(len(self.velocity) == 2, "velocity must be two states: one in the plane is proved")


@dataclass(frozen=True)
class _Keep:
    """What a file may ask of flights, one of these."""

    avoid: Box | None = None
    within: Box | None = None
    every: tuple[str, ...] | None = None
    some: tuple[str, ...] | None = None
    keep_out: _Ball | None = None
    stay_in: _Ball | None = None
    speed_limit: _SpeedLimit | None = None

    def __post_init__(self) -> None:
        count = sum(limit is not None for limit in vars(self).values())
        _need(count == 1, f"there must be one of {', '.join(vars(self))}, got {count}")

    def of(self, count: int) -> Property:
        """The property, of so many states; `ConfigError` if it is of other states."""
        if box := self.avoid or self.within:
            _need(len(box.lower) == count, f"a box must have {counted(count, 'number')}")
            return box.inside() if self.within else box.outside()
        if limit := self.speed_limit:
            places = _states(limit.position, count), _states(limit.velocity, count)
            return Distances(limit.base, limit.slope, *places)
        if ball := self.keep_out:
            return Distances(-ball.radius, 1.0, _states(ball.position, count), ())
        if ball := self.stay_in:
            return Distances(ball.radius, 0.0, (), _states(ball.position, count))
        formulas = self.some if self.every is None else self.every
        return HalfSpaces(*_linear_rows(formulas or (), count), self.some is None)


@dataclass(frozen=True)
class _File:
    """Tables of a file; numbers without a point stay whole numbers, as the checker asks for them."""

    name: str
    period: float
    steps: Number
    commands: Number
    derivative: tuple[str, ...]
    start: Box
    keep: _Keep | None = None
    end: _End | None = None
    inputs: tuple[str, ...] | None = None
    begins: Number = 0

    def problem(self, text: str) -> Problem:
        """The problem of a file's text; `ConfigError` if its numbers and formulas do not fit together."""
        count = len(self.derivative)
        _need(
            1 <= count <= MOST_STATES, f"derivative must be a list of 1 to {MOST_STATES} formulas"
        )
        is_line = len(self.name) <= 200 and self.name.isprintable()
        _need(is_line, "name must be a line of at most 200 characters")
        steps = _whole(self.steps, 1, MOST_STEPS, "steps")
        commands = _whole(self.commands, 1, count, "commands")
        is_short = 0.0 < self.period <= 1e4
        _need(is_short, f"period must be above 0 and at most 10,000 s, got {self.period}")
        _need(self.keep or self.end, "it must have keep or end: what flights keep, or their end")
        for box in (self.start, self.end or self.start):
            _need(len(box.lower) == count, f"start and end must have {counted(count, 'number')}")
        if self.inputs is not None:
            _linear_rows(self.inputs, count)
        problem = Problem(
            name=self.name,
            derivative=self.derivative,
            commands=commands,
            period=self.period,
            steps=steps,
            lower=self.start.lower,
            upper=self.start.upper,
            keep=self.keep.of(count) if self.keep else None,
            end=self._widened_end(self.end) if self.end else None,
            text=text,
            inputs=self.inputs or (),
            begins=_whole(self.begins, 0, steps - 1, "begins"),
            earliest=_whole(self.end.earliest, 0, steps, "end.earliest") if self.end else 0,
        )
        # Refuses what is no formula.
        anything = np.full(1, np.nan)
        problem.rates([anything] * count, [anything] * commands)
        return problem

    def _widened_end(self, end: Box) -> Box:
        """Box in which flights must end, +-1e9 along states that never change and start in it."""
        corners = np.array([end.lower, end.upper])
        starts = zip(self.derivative, self.start.lower, self.start.upper, strict=True)
        for i, (rate, low, high) in enumerate(starts):
            if rate.strip() == "0" and corners[0, i] <= low and high <= corners[1, i]:
                corners[:, i] = -_LARGEST, _LARGEST
        return Box(*map(tuple, corners.tolist()))


def problem_of(text: str, where: object = "the problem") -> Problem:
    """Problem of a TOML text, with closed tables; errors begin with ``where`` and are those of `read_problem`.

    Texts that this accepts and the checker's own reader refuses end as refused certificates.
    """
    file = structure(read_toml(text), _File, str(where))
    try:
        return file.problem(text)
    except ConfigError as error:
        raise ConfigError(f"{where}: {error}") from None


def _need(condition: object, must: str) -> None:
    """Refuse (`ConfigError`) a table that does not meet a condition; its reader says where it is."""
    if not condition:
        raise ConfigError(f"{must}.")


def _whole(number: Number, low: int, high: int, what: str) -> int:
    """A whole number within bounds, both of which are allowed; `ConfigError` for others."""
    is_whole = type(number) is int and low <= number <= high
    _need(is_whole, f"{what} must be a whole number from {low} to {high}, got {brief(number)}")
    return int(number)


def _states(numbers: Sequence[Number], count: int) -> tuple[int, ...]:
    """Numbers of states, each at most once."""
    states = tuple(_whole(k, 0, count - 1, "the number of a state") for k in numbers)
    _need(states and len(set(states)) == len(states), "a list of states has none, or one twice")
    return states


def _linear_rows(
    formulas: Sequence[str], count: int
) -> tuple[tuple[tuple[float, ...], ...], tuple[float, ...]]:
    """Factors (a row each) and constants of linear functions of the state x0, x1 ...; `ConfigError` for others."""
    is_list = 1 <= len(formulas) <= _MOST_FUNCTIONS
    _need(is_list, f"a list of functions must have 1 to {_MOST_FUNCTIONS}")
    names = [f"x{i}" for i in range(count)]
    try:
        table = np.array([linear_function(text, names) for text in formulas])
    except NotLinear as error:
        raise ConfigError(f"{error} is no linear function of the state.") from None
    return tuple(map(tuple, table[:, :-1].tolist())), tuple(table[:, -1].tolist())
