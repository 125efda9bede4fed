"""Motion of sets of states in ball arithmetic: power series in time, and slopes of them by the state.

A function's slopes s over a set around c are balls with f(z) - f(c) in s (z - c) for every z of the set (Krawczyk
and Neumaier, "Interval slopes for rational functions and associated centered forms", 1985). FLINT multiplies and
composes the series. It shares nothing with the prover's motion, which computes with affine forms.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Sequence
from typing import Any

from flint import arb, arb_mat, arb_series, ctx

from rans_proof.balls import Refused, absolute_row_sums, column, diagonal, side_by_side, sizes

_TERMS = 6
"""Terms of a step's series; the next one is its rest."""
_COARSE, _FINE = 0.01, 1e-8
"""Parts of a state's spread and of its size that the rest of a step may add; a step that adds more is halved."""
_HALVINGS = 10
"""A period is halved so often at most."""
_KEPT = 64
"""Columns of a spread, at least, of which the least ones become a box."""
_FUNCTIONS = ("sin", "cos", "tan", "exp", "sqrt")

Formula = Callable[[Sequence[Any]], Any]
"""Value of a formula, of numbers of any one kind in the place of its names."""


def formula(text: str, names: Sequence[str]) -> Formula:
    """Formula of a text: numbers, names, +, -, *, /, brackets and functions.

    Raises:
        Refused: it has anything else.
    """

    def read(node: Any, depth: int) -> Formula:
        if depth > 60:
            raise Refused(f"its formula {text[:80]!r} is nested too deep.")
        match node:
            case ast.Constant(value=int() | float() as value) if (
                type(value) is not bool and abs(value) < 1e300
            ):
                number = arb(float(value))
                return lambda _: number
            case ast.Name(id=name) if name in names:
                place = list(names).index(name)
                return lambda values: values[place]
            case ast.UnaryOp(op=ast.USub()):
                inner = read(node.operand, depth + 1)
                return lambda values: -inner(values)
            case ast.BinOp(op=ast.Add() | ast.Sub() | ast.Mult() | ast.Div() as sign):
                a, b = (read(part, depth + 1) for part in (node.left, node.right))
                match sign:
                    case ast.Add():
                        return lambda values: a(values) + b(values)
                    case ast.Sub():
                        return lambda values: a(values) - b(values)
                    case ast.Mult():
                        return lambda values: a(values) * b(values)
                return lambda values: a(values) / b(values)
            case ast.Call(func=ast.Name(id=name), args=[argument], keywords=[]) if (
                name in _FUNCTIONS
            ):
                inner = read(argument, depth + 1)
                return lambda values: getattr(inner(values), name)()
        raise Refused(
            f"its formula {text[:80]!r} has more than numbers, {', '.join(names)}, +, -, *, / and functions."
        )

    try:
        return read(ast.parse(text, mode="eval").body, 0)
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        raise Refused(f"its formula {text[:80]!r} cannot be read.") from error


class Sloped:
    """Series of a function of the state: at the centre, over the set, and its slopes by every variable."""

    def __init__(self, at: Any, over: Any, slopes: list[Any]) -> None:
        self.at = at
        self.over = over
        self.slopes = slopes

    def _of(self, other: Any) -> Sloped:
        """A number as a function."""
        if isinstance(other, Sloped):
            return other
        constant = arb_series([other])
        return Sloped(constant, constant, [arb_series([0])] * len(self.slopes))

    def __add__(self, other: Any) -> Sloped:
        b = self._of(other)
        slopes = [p + q for p, q in zip(self.slopes, b.slopes, strict=True)]
        return Sloped(self.at + b.at, self.over + b.over, slopes)

    def __mul__(self, other: Any) -> Sloped:
        if isinstance(other, arb):
            slopes = [other * p for p in self.slopes]
            return Sloped(other * self.at, other * self.over, slopes)
        b = self._of(other)
        slopes = [p * b.over + self.at * q for p, q in zip(self.slopes, b.slopes, strict=True)]
        return Sloped(self.at * b.at, self.over * b.over, slopes)

    __radd__, __rmul__ = __add__, __mul__

    def __neg__(self) -> Sloped:
        return self * arb(-1)

    def __sub__(self, other: Any) -> Sloped:
        return self + -self._of(other)

    def __rsub__(self, other: Any) -> Sloped:
        return -self + other

    def __truediv__(self, other: Any) -> Sloped:
        b = self._of(other)
        return self * b._bent(lambda x: (1 / x, -1 / (x * x), 2 / (x * x * x)))

    def __rtruediv__(self, other: Any) -> Sloped:
        return self._of(other) / self

    def _bent(self, function: Callable[[Any], tuple[Any, Any, Any]]) -> Sloped:
        """A function of this one, which gives its value and its first and second derivative.

        f(z) - f(c) is (z - c) (f'(c) + (z - c) times the mean of (1 - t) f''(c + t (z - c)) over t from 0 to 1).
        """
        at, first, _ = function(self.at)
        over, _, second = function(self.over)
        slope = first + (self.over - self.at) * second * arb("0.5")
        return Sloped(at, over, [slope * p for p in self.slopes])

    def sin(self) -> Sloped:
        """See `_FUNCTIONS`."""
        return self._bent(lambda x: (x.sin(), x.cos(), -x.sin()))

    def cos(self) -> Sloped:
        """See `_FUNCTIONS`."""
        return self._bent(lambda x: (x.cos(), -x.sin(), -x.cos()))

    def exp(self) -> Sloped:
        """See `_FUNCTIONS`."""
        return self._bent(lambda x: (x.exp(), x.exp(), x.exp()))

    def tan(self) -> Sloped:
        """See `_FUNCTIONS`."""
        return self.sin() / self.cos()

    def sqrt(self) -> Sloped:
        """See `_FUNCTIONS`."""
        half = arb("0.5")
        return self._bent(lambda x: (x.sqrt(), half / x.sqrt(), -half * half / (x * x.sqrt())))


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
        self._halvings = self._periods = 0

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
            self._halvings = max(0, self._halvings - 1)
        while len(pieces) < 2**self._halvings:
            end, sag = self._step(middle, wide, self._period / 2**self._halvings)
            if sag is None:  # again, in shorter steps
                self._halvings += 1
                if self._halvings > _HALVINGS:
                    raise Refused("its motion has no bound within a Taylor step.")
                middle, wide, pieces = *first, []
                continue
            begin = column(middle[:n]), arb_mat(wide.tolist()[:n])
            middle, wide = end
            pieces.append((begin, (column(middle[:n]), arb_mat(wide.tolist()[:n])), sag))
        return pieces

    def _step(self, middle: list[Any], wide: Any, h: Any) -> tuple[Any, Any]:
        """Set after a step and its sag, or None if the step is too long."""
        n = self._count
        widths = absolute_row_sums(wide)
        balls = [_ball(c.mid(), w + c.rad()) for c, w in zip(middle, widths, strict=True)]
        try:
            during = self._during(balls, h)
            if during is None:
                return None, None
            ctx.cap = _TERMS + 1
            rough = self._series([arb_series([x]) for x in during], _TERMS)
        except ValueError:  # FLINT's division by a ball round 0
            return None, None
        rest = [abs(x[_TERMS] * h**_TERMS).upper() for x in rough]
        allowed = [
            _COARSE * w + _FINE * (abs(x) + arb("0.001"))
            for w, x in zip(widths, balls, strict=True)
        ]
        if not all(r.is_finite() and r < a.upper() for r, a in zip(rest, allowed, strict=False)):
            return None, None
        sag = [(h * h / 4 * abs(x[2])).upper() for x in rough]
        ctx.cap = _TERMS
        # f(z) is in f(c) + slopes (z - c), whose uncertain part is an error.
        unit = [[arb_series([int(i == k)]) for i in range(len(balls))] for k in range(len(balls))]
        start = [
            Sloped(arb_series([c.mid()]), arb_series([x]), row)
            for c, x, row in zip(middle, balls, unit, strict=True)
        ]
        series = self._series(start, _TERMS - 1)
        after = [_sum(x.at, h) for x in series]
        slopes = arb_mat([[_sum(p, h) for p in x.slopes] for x in series])
        fixed = arb_mat([[x.mid() for x in row] for row in slopes.tolist()])
        loose = arb_mat([[arb(x.rad()) for x in row] for row in slopes.tolist()])
        reach = column([w + arb(c.rad()) for w, c in zip(widths, middle, strict=True)])
        of_centre = (sizes(fixed) * column([arb(c.rad()) for c in middle])).entries()
        off = [
            a + b + r + arb(x.rad())
            for a, b, r, x in zip((loose * reach).entries(), of_centre, rest, after, strict=True)
        ]
        moved = arb_mat((fixed * wide).tolist() + wide.tolist()[n:])
        extra = arb_mat(diagonal(off).tolist() + [[arb(0)] * n] * (len(middle) - n))
        return ([x.mid() for x in after] + middle[n:], side_by_side(moved, extra)), sag

    def _series(self, start: list[Any], terms: int) -> list[Any]:
        """Series of the states, up to a power of time, from series of states and commands of one term."""
        states = start[: self._count]
        for k in range(terms):
            ctx.cap = k + 1  # the rates' terms that follow from the states' so far
            rates = [rate([*states, *start[self._count :]]) for rate in self._rates]
            ctx.cap = k + 2
            states = [_integral(x, rate) for x, rate in zip(start, rates, strict=False)]
        return states

    def _during(self, balls: list[Any], h: Any) -> list[Any] | None:
        """Balls that hold the motion of a step from ``balls``: a guess that their own rates do not leave."""
        n = self._count
        ctx.cap = 1

        def moved(guess: list[Any]) -> list[Any]:
            rates = [rate([arb_series([x]) for x in guess]) for rate in self._rates]
            return [
                x + arb(0).union(h) * _coefficient(r, 0) for x, r in zip(balls, rates, strict=False)
            ]

        guess = balls
        for _ in range(2):
            guess = [
                _ball(x.mid(), x.rad() * arb("1.1") + abs(x) * arb(1e-9) + arb(1e-12))
                for x in moved(guess)
            ] + balls[n:]
        if not all(
            larger.contains_interior(x) for larger, x in zip(guess, moved(guess), strict=False)
        ):
            return None
        return guess


def reduced(centre: Any, spread: Any) -> tuple[Any, Any]:
    """A set around another one, in which the least columns of the spread are replaced by a box."""
    rows, columns = spread.nrows(), spread.ncols()
    kept = max(_KEPT, 5 * rows)
    if columns <= kept + rows:
        return centre, spread
    table = spread.tolist()
    scale = [float(w.upper()) or 1.0 for w in absolute_row_sums(spread)]
    worth = [
        sum(abs(float(row[k].mid())) / s for row, s in zip(table, scale, strict=True))
        for k in range(columns)
    ]
    order = sorted(range(columns), key=lambda k: -worth[k])
    box = [sum((abs(row[k]) for k in order[kept:]), arb(0)) for row in table]
    left = arb_mat([[row[k] for k in order[:kept]] for row in table])
    return centre, side_by_side(left, diagonal(box))


def _ball(middle: Any, radius: Any) -> Any:
    return arb(middle, radius.upper())


def _coefficient(value: Any, k: int) -> Any:
    """A coefficient of a series; a number is a series of one."""
    return value[k] if isinstance(value, arb_series) else value


def _sum(series: Any, h: Any) -> Any:
    """Value of a polynomial at h."""
    total = arb(0)
    for value in reversed(series.coeffs()):
        total = total * h + value
    return total


def _integral(start: Any, rate: Any) -> Any:
    """Integral of a rate by time, from the first term of a series."""
    if isinstance(start, Sloped):
        rate = start._of(rate)
        slopes = [p + q.integral() for p, q in zip(start.slopes, rate.slopes, strict=True)]
        at, over = (a + b.integral() for a, b in ((start.at, rate.at), (start.over, rate.over)))
        return Sloped(at, over, slopes)
    return start + (rate if isinstance(rate, arb_series) else arb_series([rate])).integral()
