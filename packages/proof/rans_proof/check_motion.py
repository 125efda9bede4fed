"""The motion of a plant in ball arithmetic: power series in time, and slopes of them by the state.

A function's slopes s over a set around c are balls with f(z) - f(c) in s (z - c) for every z of the set (Krawczyk
and Neumaier, "Interval slopes for rational functions and associated centered forms", 1985). `rans_proof.motion` is
the prover's own way to the same motion, and shares nothing with this.
"""

from __future__ import annotations

import ast
import contextlib
import functools
import math
import operator
import string
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from flint import arb, arb_mat, arb_series, ctx

from rans_proof.balls import (
    Refused,
    absolute_row_sums,
    column,
    diagonal,
    matrix,
    need,
    side_by_side,
    sizes,
)

_TERMS = 6
"""Terms of a step's series in time; the next one is its rest."""
_COARSE = 5e-5
"""Part of a state's spread that the rest of a step may add; a step that adds more is halved."""
_FINE = 1e-8
"""Part of a state's size that it may add beside that."""
_HALVINGS = 10
"""A period is halved so often at most."""
_RETAINED = 64
"""Columns of a spread, at least, which stay when the least ones become a box."""


Formula = Callable[[Sequence[Any]], Any]
"""Value of a formula, of numbers of any one kind in the place of its names."""
_SIGNS: dict[type, Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
}
_FUNCTIONS = ("sin", "cos", "tan", "exp", "sqrt")
_LETTERS = set(string.ascii_letters + string.digits + "_.+-*/() \t\n")
"""Characters of formulas: others of Unicode are read as some of these, and a comment would be printed as a part."""


def formula(text: str, names: Sequence[str]) -> Formula:
    """Formula of a text: numbers, names, +, -, *, /, brackets and functions.

    Raises:
        Refused: it has anything else.
    """
    need(set(text) <= _LETTERS, f"its formula {text[:80]!r} has a character that is of no formula.")

    def read(node: Any, depth: int) -> Formula:
        """Formula of a node of a parsed expression.

        Numbers, names, signs and functions of a closed list, or `Refused`.
        """
        need(depth <= 60, f"its formula {text[:80]!r} has over 60 operations within operations.")
        match node:
            case ast.Constant(value=int() | float() as value) if (
                type(value) is not bool and abs(value) < 1e300
            ):
                number = arb(value)  # exact, as a whole number beyond 2^53 is too
                return lambda _: number
            case ast.Name(id=name) if name in names:
                return operator.itemgetter(list(names).index(name))
            case ast.UnaryOp(op=ast.USub()):
                inner = read(node.operand, depth + 1)
                return lambda values: -inner(values)
            case ast.BinOp(op=op) if type(op) in _SIGNS:
                sign = _SIGNS[type(op)]
                a, b = (read(part, depth + 1) for part in (node.left, node.right))
                return lambda values: sign(a(values), b(values))
            case ast.Call(func=ast.Name(id=name), args=[argument], keywords=[]) if (
                name in _FUNCTIONS
            ):
                inner = read(argument, depth + 1)
                return lambda values: getattr(inner(values), name)()
        raise Refused(f"its formula {text[:80]!r} has more than names, numbers and functions.")

    try:
        return read(ast.parse(text, mode="eval").body, 0)
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        raise Refused(f"its formula {text[:80]!r} cannot be read.") from error


class Sloped:
    """Series of a function of the state: at the centre, over the set, and its slopes by the variables in it."""

    def __init__(self, at: Any, over: Any, slopes: dict[int, Any]) -> None:
        self.at = at
        self.over = over
        self.slopes = slopes

    def of(self, other: Any) -> Sloped:
        """A number as a function."""
        if isinstance(other, Sloped):
            return other
        constant = arb_series([other])
        return Sloped(constant, constant, {})

    def __add__(self, other: Any) -> Sloped:
        b = self.of(other)
        slopes = self.slopes | {
            k: self.slopes[k] + q if k in self.slopes else q for k, q in b.slopes.items()
        }
        return Sloped(self.at + b.at, self.over + b.over, slopes)

    def __mul__(self, other: Any) -> Sloped:
        b = self.of(other)
        slopes = {k: p * b.over for k, p in self.slopes.items()}
        for k, q in b.slopes.items():
            slopes[k] = slopes[k] + self.at * q if k in slopes else self.at * q
        return Sloped(self.at * b.at, self.over * b.over, slopes)

    __radd__ = __add__
    __rmul__ = __mul__

    def __neg__(self) -> Sloped:
        return Sloped(-self.at, -self.over, {k: -p for k, p in self.slopes.items()})

    def __sub__(self, other: Any) -> Sloped:
        return self + -self.of(other)

    def __rsub__(self, other: Any) -> Sloped:
        return -self + other

    def __truediv__(self, other: Any) -> Sloped:
        return self * self.of(other).bent(lambda x: (1 / x, -1 / (x * x), 2 / (x * x * x)))

    def __rtruediv__(self, other: Any) -> Sloped:
        return self.of(other) / self

    def bent(self, function: Callable[[Any], tuple[Any, Any, Any]]) -> Sloped:
        """A function of this one, which gives its value and its first and second derivative.

        f(z) - f(c) is (z - c) (f'(c) + (z - c) times the mean of (1 - t) f''(c + t (z - c)) over t from 0 to 1).
        """
        at, first, _ = function(self.at)
        over, _, second = function(self.over)
        slope = first + (self.over - self.at) * second * arb("0.5")
        return Sloped(at, over, {k: slope * p for k, p in self.slopes.items()})

    def sin(self) -> Sloped:
        """See `_FUNCTIONS`, as for the others."""
        return self.bent(lambda x: (x.sin(), x.cos(), -x.sin()))

    def cos(self) -> Sloped:
        """The cosine."""
        return self.bent(lambda x: (x.cos(), -x.sin(), -x.cos()))

    def exp(self) -> Sloped:
        """The exponential function."""
        return self.bent(lambda x: (x.exp(), x.exp(), x.exp()))

    def tan(self) -> Sloped:
        """The tangent."""
        return self.sin() / self.cos()

    def sqrt(self) -> Sloped:
        """The square root."""
        half = arb("0.5")
        return self.bent(lambda x: (x.sqrt(), half / x.sqrt(), -half * half / (x * x.sqrt())))


def linear(text: str, names: Sequence[str]) -> list[Any]:
    """Factors of names in a formula, and its constant as the last one; a formula that is not linear is refused.

    `ctx.cap` is FLINT's global length of series, which is changed here as in all functions of this module.
    """
    ctx.cap = 1
    zero = arb_series([0])
    wide = arb_series([arb(0, 1e30)])
    variables = [Sloped(zero, wide, {k: arb_series([1])}) for k in range(len(names))]
    result = variables[0].of(formula(text, names)(variables))
    row = [result.slopes[k][0] if k in result.slopes else arb(0) for k in range(len(names))]
    row.append(result.at[0])
    is_linear = all(x.is_finite() and x.rad() <= 1e-15 * (1 + abs(x.mid())) for x in row)
    need(is_linear, f"its formula {text[:80]!r} is no linear function of the state.")
    return row


class Plant:
    """Plant whose commands are held.

    Args:
        rates: formula of each state's rate.
        commands: number of commands.
        period: s for which they are held.
    """

    def __init__(self, rates: Sequence[str], commands: int, period: float) -> None:
        self._count = len(rates)
        names = [f"x{i}" for i in range(len(rates))] + [f"u{i}" for i in range(commands)]
        self._rates = [formula(text, names) for text in rates]
        self._period = arb(period)
        self.halvings = 0
        self._periods = 0
        self.left = math.inf
        """Steps that may still be tried; below 0 the motion is refused."""

    def move(
        self, centre: Any, spread: Any, gain: Any, offset: Any, errors: Sequence[Any]
    ) -> list[tuple[Any, Any, list[Any]]]:
        """Sets at the begin and end of the steps of a period, and how far the way is off the chord between.

        Args:
            centre: c (n, 1) of the states c + G s, |s| <= 1.
            spread: G (n, k).
            gain: commands are gain x + offset +- errors.
            offset: of the commands, (p, 1).
            errors: of the commands.
        """
        n = self._count
        # States and commands as one set, centre + spread s; errors of commands are further s.
        middle = [*centre.entries(), *(gain * centre + offset).entries()]
        of_states = side_by_side(spread, arb_mat(n, len(errors)))
        of_commands = side_by_side(gain * spread, diagonal(errors))
        wide = arb_mat(of_states.tolist() + of_commands.tolist())
        first = middle, wide
        pieces: list[tuple[Any, Any, list[Any]]] = []
        self._periods += 1
        if self._periods % 8 == 0:  # the motion may have become slower
            self.halvings = max(0, self.halvings - 1)
        while len(pieces) < 2**self.halvings:
            self.left -= 1
            need(self.left >= 0, "its motion takes more steps than are tried.")
            step: Any = None
            with contextlib.suppress(ValueError):  # FLINT's division by a ball round 0
                step = self._step(middle, wide, self._period / 2**self.halvings)
            if step is None:  # again, in shorter steps
                self.halvings += 1
                need(self.halvings <= _HALVINGS, "its motion has no bound within a Taylor step.")
                middle, wide = first
                pieces = []
                continue
            begin = column(middle[:n]), arb_mat(wide.tolist()[:n])
            (middle, wide), sag = step
            pieces.append((begin, (column(middle[:n]), arb_mat(wide.tolist()[:n])), sag))
        return pieces

    def _step(self, middle: list[Any], wide: Any, h: Any) -> tuple[Any, Any] | None:
        """Set (ball matrices) after a step of length h (s) and its sag; None: the step is too long.

        The set must have every state that is reached, and the sag (per state) must bound how far motion is off its
        chord: `Loop` judges the property by both.
        """
        n = self._count
        widths = absolute_row_sums(wide)
        balls = [_ball(c.mid(), w + c.rad()) for c, w in zip(middle, widths, strict=True)]
        during = self.during(balls, h)
        if during is None:
            return None
        ctx.cap = _TERMS + 1  # a series ends where the cap was when it was made
        rough = self._series([arb_series([x]) for x in during], _TERMS)
        # The next term over all of the motion is the rest of the series, and x'' h^2 / 8 the sag.
        rest = [abs(x[_TERMS] * h**_TERMS).upper() for x in rough]
        allowed = [
            _COARSE * w + _FINE * (abs(x) + arb("0.001"))
            for w, x in zip(widths, balls, strict=True)
        ]
        if not all(r.is_finite() and r < a.upper() for r, a in zip(rest, allowed, strict=False)):
            return None
        sag = [(h * h / 4 * abs(x[2])).upper() for x in rough]
        # f(z) is in f(c) + slopes (z - c), whose uncertain part is an error.
        ctx.cap = _TERMS
        start = [
            Sloped(arb_series([c.mid()]), arb_series([x]), {k: arb_series([1])})
            for k, (c, x) in enumerate(zip(middle, balls, strict=True))
        ]
        series = self._series(start, _TERMS - 1)
        after = [_sum(x.at, h) for x in series]
        slopes = arb_mat(
            [
                [_sum(x.slopes[k], h) if k in x.slopes else arb(0) for k in range(len(balls))]
                for x in series
            ]
        )
        fixed = arb_mat([[x.mid() for x in row] for row in slopes.tolist()])
        loose = arb_mat([[arb(x.rad()) for x in row] for row in slopes.tolist()])
        reach = column([w + arb(c.rad()) for w, c in zip(widths, middle, strict=True)])
        of_centre = (sizes(fixed) * column([arb(c.rad()) for c in middle])).entries()
        moved = [[*row] for row in (fixed * wide).tolist()]
        # The balls' own radii, which would grow from step to step, are errors, too.
        off = [
            a + b + r + arb(x.rad()) + sum((arb(y.rad()) for y in row), arb(0))
            for a, b, r, x, row in zip(
                (loose * reach).entries(), of_centre, rest, after, moved, strict=True
            )
        ]
        moved = arb_mat([[y.mid() for y in row] for row in moved] + wide.tolist()[n:])
        extra = arb_mat(diagonal(off).tolist() + [[arb(0)] * n] * (len(middle) - n))
        return ([x.mid() for x in after] + middle[n:], side_by_side(moved, extra)), sag

    def _series(self, start: list[Any], terms: int) -> list[Any]:
        """Series of the states, up to a power of time, from series of states and commands of one term.

        `ctx.cap` is left at the last length; series that are made afterwards end there.
        """
        states = start[: self._count]
        for k in range(terms):
            ctx.cap = k + 1  # the rates' terms that follow from the states' so far
            rates = [rate([*states, *start[self._count :]]) for rate in self._rates]
            ctx.cap = k + 2
            states = [_integral(x, rate) for x, rate in zip(start, rates, strict=False)]
        return states

    def during(self, balls: list[Any], h: Any) -> list[Any] | None:
        """Balls that hold the motion of a step from ``balls``: a guess that their own rates do not leave.

        None: there is no such guess.
        """
        ctx.cap = 1

        def moved(guess: list[Any]) -> list[Any]:
            rates = [rate([arb_series([x]) for x in guess]) for rate in self._rates]
            rates = [r[0] if isinstance(r, arb_series) else r for r in rates]
            return [x + arb(0).union(h) * r for x, r in zip(balls, rates, strict=False)]

        guess = balls
        for _ in balls:  # states that follow from exact ones, one by one, need as many guesses
            guess = [
                _ball(x.mid(), x.rad() * arb("1.1") + abs(x) * arb(1e-9) + arb(1e-12))
                for x in moved(guess)
            ] + balls[self._count :]
            motion = moved(guess)
            if all(x.contains_interior(y) for x, y in zip(guess, motion, strict=False)):
                # The motion is within what a box that holds it is moved to, and in that of this.
                return moved(motion + balls[self._count :]) + balls[self._count :]
        return None


def reduced(centre: Any, spread: Any) -> tuple[Any, Any]:
    """A set around another one, in which the least columns of the spread become a box.

    The box is along the states or along the columns' main axes, whichever has the smaller volume. Any axes are
    sound: what the columns differ by from their parts along them is a box along the states. Each box widens the
    set, so that there is none before the columns are twice as many as those that stay.
    """
    rows = spread.nrows()
    columns = spread.ncols()
    retained = max(_RETAINED, 10 * rows)
    if columns <= 2 * retained:
        return centre, spread
    table = np.array([[float(x.mid()) for x in row] for row in spread.tolist()])
    scale = abs(table).sum(axis=1, keepdims=True)
    scale[scale == 0.0] = 1.0
    need(np.isfinite(scale).all(), "its motion has no bound.")
    # A column along one state is a part of a box already, so that its other parts say what is lost.
    part = table / scale
    order = np.argsort(abs(part).max(axis=0) - abs(part).sum(axis=0))
    rest = part[:, order[retained:]]
    axes = scale * min((np.eye(rows), np.linalg.svd(rest)[0]), key=lambda u: _volume(u.T @ rest))
    first, least = (
        arb_mat([[row[k] for k in part] for row in spread.tolist()])
        for part in (order[:retained].tolist(), order[retained:].tolist())
    )
    along = matrix(np.linalg.inv(axes)) * least
    box = matrix(axes) * diagonal(absolute_row_sums(along))
    left = absolute_row_sums(least - matrix(axes) * along)
    return centre, side_by_side(first, box, diagonal(left))


def _volume(table: np.ndarray) -> float:
    """Logarithm of the volume of the box around columns, whose sides count as 1e-9 at least."""
    return float(np.log(abs(table).sum(axis=1) + 1e-9).sum())


def _ball(middle: Any, radius: Any) -> Any:
    return arb(middle, radius.upper())


def _sum(series: Any, h: Any) -> Any:
    """Value of a polynomial at h."""
    return functools.reduce(lambda total, x: total * h + x, reversed(series.coeffs()), arb(0))


def _integral(start: Any, rate: Any) -> Any:
    """Integral of a rate by time, from the first term of a series."""
    if isinstance(start, Sloped):
        rate = start.of(rate)
        slopes = {k: q.integral() for k, q in rate.slopes.items()}
        slopes |= {k: p + slopes[k] if k in slopes else p for k, p in start.slopes.items()}
        return Sloped(start.at + rate.at.integral(), start.over + rate.over.integral(), slopes)
    return start + (rate if isinstance(rate, arb_series) else arb_series([rate])).integral()
