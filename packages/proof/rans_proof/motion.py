"""Enclosed motion of plants of any formulas: Taylor series in time whose coefficients are affine forms of the set.

An affine form c + g s + e t, with s in [-1, 1]^m those of the set and t in [-1, 1] of its own, encloses a number
over a set of states (Stolfi and de Figueiredo, "Self-validated numerical methods and applications", 1997). The
coefficients of the solution follow from those of the rates (Moore, "Interval analysis", 1966); the rest of a step
is the next coefficient over a box that the motion does not leave during the step. A form must enclose with all
rounding: any operation without its rounding would prove what is false.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import torch
from torch import Tensor

from rans_proof.formula import Node, Tape
from rans_proof.plants import Piece
from rans_proof.problem import Problem
from rans_proof.relaxation import Planes, Zonotope

_ORDER = 4
"""Highest power of time in a step; the next one is its rest."""
_MOST_SUBSTEPS = 32
"""Taylor steps of a control period at most."""
_GUESSES = 4
"""Guesses of a box that a step does not leave; states that follow from exact ones, one by one, need as many."""
_REST = 0.01, 1e-6
"""Largest rest of a step: a part of the set's radius, and of its size. Above it steps are halved."""
_UNIT = 2.0**-53
_ULPS = 8.0
"""Errors of sin, cos, exp and their like, in units in the last place; of libraries in use they are below 2."""


class Form(NamedTuple):
    """Affine forms of B sets."""

    centre: Tensor
    """(B,)."""
    generators: Tensor
    """(B, m)."""
    error: Tensor
    """(B,)."""

    @property
    def radius(self) -> Tensor:
        """(B,) how far a value may be from the centre."""
        return self.generators.abs().sum(dim=1) + self.error

    def rounded(self, size: Tensor, operations: int) -> Form:
        """This form with a bound of the rounding of operations on numbers of a size (B,)."""
        error = self.error + 2.0 * (operations + self.generators.shape[1]) * _UNIT * size
        return Form(self.centre, self.generators, error)

    def times(self, factor: float) -> Form:
        """A multiple."""
        size = abs(factor) * (self.centre.abs() + self.radius)
        return Form(
            factor * self.centre, factor * self.generators, abs(factor) * self.error
        ).rounded(size, 4)


def total(*forms: Form) -> Form:
    """Sum of forms."""
    parts = [torch.stack([form[k] for form in forms]).sum(dim=0) for k in range(3)]
    size = torch.stack([form.centre.abs() + form.radius for form in forms]).sum(dim=0)
    return Form(*parts).rounded(size, 4 * len(forms))


def convolution(pairs: list[tuple[Form, Form]]) -> Form:
    """Sum of products of forms.

    Of a product of the generators' parts the squares s_i^2 are in [0, 1], all else is in [-1, 1].

    The error may be too large, never too small; errors of its formulas are tried in `tests/test_soundness.py`.
    """
    a, b = (Form(*map(torch.stack, zip(*side, strict=True))) for side in zip(*pairs, strict=True))
    reach = [form.generators.abs().sum(dim=2) + form.error for form in (a, b)]
    squares = a.generators * b.generators
    centre = (a.centre * b.centre + 0.5 * squares.sum(dim=2)).sum(dim=0)
    generators = (a.centre[:, :, None] * b.generators + b.centre[:, :, None] * a.generators).sum(
        dim=0
    )
    error = a.centre.abs() * b.error + b.centre.abs() * a.error
    error = (error + reach[0] * reach[1] - 0.5 * squares.abs().sum(dim=2)).sum(dim=0)
    size = ((a.centre.abs() + reach[0]) * (b.centre.abs() + reach[1])).sum(dim=0)
    return Form(centre, generators, error).rounded(size, 8 * len(pairs))


def bent(x: Form, value: Tensor, slope: Tensor, curve: tuple[Tensor, Tensor]) -> Form:
    """Function of a form by its value and slope at the centre, and its least and largest second derivative.

    All are (B,) beside the form's generators; rounding is added to the error.
    """
    square = 0.5 * x.radius**2
    low = torch.minimum(curve[0], torch.zeros_like(value)) * square
    high = torch.maximum(curve[1], torch.zeros_like(value)) * square
    size = value.abs() + slope.abs() * x.radius + torch.maximum(low.abs(), high.abs())
    return Form(
        value + 0.5 * (low + high),
        slope[:, None] * x.generators,
        slope.abs() * x.error + 0.5 * (high - low),
    ).rounded(_ULPS * size, 16)


def _sine_and_cosine(x: Form) -> tuple[Form, Form]:
    """Sine and cosine of a form x, whose second derivatives lie between the negated values on the way.

    Margins of 1e-9 turns and 1e-12 cover the rounding of torch's functions.
    """
    sine = x.centre.sin()
    cosine = x.centre.cos()
    ends = x.centre - x.radius, x.centre + x.radius
    forms = []
    for shift, value, slope in ((0.0, sine, cosine), (0.5, cosine, -sine)):
        values = [torch.sin(end + shift * torch.pi) for end in ends]
        lowest = torch.minimum(*values) - 1e-12
        highest = torch.maximum(*values) + 1e-12
        # A crest is at a quarter of a turn, a trough at three quarters.
        turns = [(end / torch.pi + shift) / 2.0 for end in ends]
        for quarter, is_crest in ((0.25, True), (0.75, False)):
            passed = (turns[1] - quarter + 1e-9).floor() > (turns[0] - quarter - 1e-9).floor()
            if is_crest:
                highest = torch.where(passed, 1.0, highest)
            else:
                lowest = torch.where(passed, -1.0, lowest)
        bow = bent(x, value, slope, (-highest, -lowest))
        # Far from the centre a parabola is worse than the range itself.
        flat = Form(
            0.5 * (lowest + highest),
            torch.zeros_like(x.generators),
            0.5 * (highest - lowest) + 1e-12,
        )
        is_worse = bow.error > flat.error
        forms.append(
            Form(
                *(
                    torch.where(is_worse.view(-1, *[1] * (f.dim() - 1)), f, b)
                    for b, f in zip(bow, flat, strict=True)
                )
            )
        )
    return forms[0], forms[1]


def _exponential(x: Form) -> Form:
    value = x.centre.exp()
    low, high = ((x.centre + sign * x.radius).exp() for sign in (-1.0, 1.0))
    return bent(x, value, value, (low * (1.0 - 1e-12), high * (1.0 + 1e-12)))


def _root(x: Form) -> Form:
    low = x.centre - x.radius
    high = x.centre + x.radius
    low = torch.where(low > 0.0, low, torch.nan)  # of what may be negative there is none
    value = x.centre.sqrt()
    return bent(x, value, 0.5 / value, (-0.25 * low**-1.5 * (1.0 + 1e-12), -0.25 * high**-1.5))


def _inverse(x: Form) -> Form:
    """One over a form x whose interval does not contain 0; NaN where it does.

    The NaN reaches the margin of the cell, which then is not proved and is split.
    """
    low = x.centre - x.radius
    high = x.centre + x.radius
    low = torch.where((low > 0.0) | (high < 0.0), low, torch.nan)  # of what may be 0 there is none
    value = 1.0 / x.centre
    curves = [2.0 * end**-3 for end in (low, high)]
    widened = [
        c + sign * 1e-12 * c.abs()
        for c, sign in zip((torch.minimum(*curves), torch.maximum(*curves)), (-1, 1), strict=True)
    ]
    return bent(x, value, -(value**2), (widened[0], widened[1]))


class Series:
    """Coefficients of the solution from a set, order by order.

    Args:
        tape: operations.
        rates: nodes of the rates of the states.
        start: forms of states and commands.
    """

    def __init__(self, tape: Tape, rates: list[Node], start: list[Form]) -> None:
        self._tape = tape
        self._rates = [node.number for node in rates]
        self._zero = start[0].times(0.0)
        self.states = [[form] for form in start[: len(rates)]]
        self._variables = [*self.states, *([form] for form in start[len(rates) :])]
        self._values: list[list[Any]] = [[] for _ in tape.operations]

    def extend(self) -> None:
        """Append the next coefficient of every state."""
        k = len(self.states[0]) - 1
        for number, operation in enumerate(self._tape.operations):
            self._values[number].append(self._coefficient(k, *operation))
        for state, rate in zip(self.states, self._rates, strict=True):
            state.append(self._values[rate][k].times(1.0 / (k + 1)))

    def _coefficient(self, k: int, name: str, *operands: Any) -> Any:
        """Coefficient k (a form) of an operation, by name and operands, from lower coefficients of its operands.

        Coefficients are those of Taylor series in time; nodes come in the order of the tape, after their operands.
        """
        if name == "variable":
            coefficients = self._variables[operands[0]]
            return coefficients[k] if k < len(coefficients) else self._zero
        if name == "constant":
            centre = torch.full_like(self._zero.centre, operands[0] if k == 0 else 0.0)
            return Form(centre, self._zero.generators, torch.zeros_like(centre))
        a = self._values[operands[0]]
        match name:
            case "sum":
                return total(a[k], self._values[operands[1]][k])
            case "multiple":
                return a[k].times(operands[1])
            case "product":
                b = self._values[operands[1]]
                return convolution([(a[i], b[k - i]) for i in range(k + 1)])
            case "sin":
                return a[k][0]
            case "cos":
                return a[k][1]
        if k == 0:
            return _BENDS[name](a[0])
        own = self._values[self._tape._numbers[(name, *operands)]]
        return self._bend(k, name, a, own)

    @staticmethod
    def _bend(k: int, name: str, a: list[Form], own: list[Any]) -> Any:
        """Coefficient k > 0 of a function, from those of its argument and its own lower ones.

        These are the recurrences of Taylor series (Moore, "Interval analysis", 1966).
        """
        match name:
            case "turn":  # (sin a)' = a' cos a, (cos a)' = -a' sin a
                pairs = [(a[i].times(i / k), own[k - i]) for i in range(1, k + 1)]
                return (
                    convolution([(x, both[1]) for x, both in pairs]),
                    convolution([(x, both[0]) for x, both in pairs]).times(-1.0),
                )
            case "exp":
                return convolution([(a[i].times(i / k), own[k - i]) for i in range(1, k + 1)])
            case "inverse":  # a (1 / a) = 1
                rest = convolution([(a[i], own[k - i]) for i in range(1, k + 1)])
                return convolution([(own[0], rest.times(-1.0))])
            case "sqrt":  # of whose square the coefficient is known
                inner = [(own[i], own[k - i]) for i in range(1, k)]
                rest = total(a[k], convolution(inner).times(-1.0)) if inner else a[k]
                return convolution([(_inverse(own[0].times(2.0)), rest)])
        raise AssertionError(name)


_BENDS: dict[str, Callable[[Form], Any]] = {
    "turn": _sine_and_cosine,
    "exp": _exponential,
    "sqrt": _root,
    "inverse": _inverse,
}


class TaylorPlant:
    """Plant of any formulas, which moves by Taylor steps.

    Args:
        problem: its rates, control period and numbers of states and commands.
        device: device of the sets that move.
    """

    def __init__(self, problem: Problem, device: torch.device) -> None:
        self._states = problem.states
        self._tape = Tape(problem.states + problem.commands)
        variables = self._tape.variables
        rates = problem.rates(variables[: self._states], variables[self._states :])
        self._rates = [self._tape.node(rate) for rate in rates]
        self._period = problem.period
        self._substeps = 1
        self._moves = 0
        self._device = device

    def move(self, states: Zonotope, planes: Planes) -> list[Piece]:
        """A piece for each Taylor step; steps are halved until their rests are small.

        The number of steps is remembered, and tried smaller at every eighth move.
        """
        self._moves += 1
        if self._moves % 8 == 0:  # a time of fast motion may be over
            self._substeps = max(1, self._substeps // 2)
        while True:
            pieces, is_fine = self._moved(states, planes, self._substeps)
            if is_fine or self._substeps >= _MOST_SUBSTEPS:
                return pieces
            self._substeps *= 2

    def _moved(self, states: Zonotope, planes: Planes, substeps: int) -> tuple[list[Piece], bool]:
        """Pieces over a period by so many Taylor steps, and whether the rests of all are small.

        It stops early where a rest is too large, and `move` then tries more substeps.
        """
        # State and commands together; the commands are held.
        n = self._states
        wide = torch.cat((states.generators, torch.diag_embed(states.box)), dim=2)
        size = (planes.gain.abs() @ states.size[:, :, None])[:, :, 0] + planes.offset.abs()
        wrong = planes.error + 4.0 * (n + wide.shape[2]) * _UNIT * size
        commands = (planes.gain @ states.centre[:, :, None])[:, :, 0] + planes.offset
        lower = torch.cat((planes.gain @ wide, torch.diag_embed(wrong)), dim=2)
        upper = torch.nn.functional.pad(wide, (0, wrong.shape[1]))
        zero = torch.zeros_like(wrong)
        begin = Zonotope(states.centre, upper, torch.zeros_like(states.box))
        held = Zonotope(commands, lower, zero)
        pieces = []
        is_fine = True
        for _ in range(substeps):
            end, sag, rest = self._step(begin, held, self._period / substeps)
            pieces.append(Piece(begin, end, sag))
            small = _REST[0] * begin.radius + _REST[1] * (begin.size + 1e-3)
            is_fine = is_fine and bool((rest <= small).all())
            if not is_fine and substeps < _MOST_SUBSTEPS:
                break
            generators = torch.cat((end.generators, torch.diag_embed(end.box)), dim=2)
            begin = Zonotope(end.centre, generators, torch.zeros_like(end.box))
            held = Zonotope(held.centre, torch.nn.functional.pad(held.generators, (0, n)), held.box)
        return pieces, is_fine

    def _step(self, states: Zonotope, held: Zonotope, h: float) -> tuple[Zonotope, Tensor, Tensor]:
        """Set a Taylor step of h (s) later, by how much the way there sags (B, n), and the rest (B, n).

        The rest is the next term over a box that no motion of the step leaves (`_during`); it is in the set
        already.
        """
        n = self._states
        boxes = [
            Form(zonotope.centre[:, k], zonotope.generators[:, 0, :0], radius[:, k])
            for zonotope, radius in ((states, states.radius), (held, held.radius))
            for k in range(radius.shape[1])
        ]
        during = self._during(boxes, h)
        rough = Series(self._tape, self._rates, during)
        for _ in range(_ORDER + 1):
            rough.extend()
        fine = Series(
            self._tape,
            self._rates,
            [
                Form(zonotope.centre[:, k], zonotope.generators[:, k], zonotope.box[:, k])
                for zonotope in (states, held)
                for k in range(zonotope.centre.shape[1])
            ],
        )
        for _ in range(_ORDER):
            fine.extend()
        ends = []
        sags = []
        rests = []
        for k in range(n):
            terms = [form.times(h**power) for power, form in enumerate(fine.states[k])]
            last = rough.states[k][_ORDER + 1].times(h ** (_ORDER + 1))
            rest = last.centre.abs() + last.radius
            end = total(*terms)
            ends.append(Form(end.centre, end.generators, end.error + rest * (1.0 + 1e-12)))
            second = rough.states[k][2]
            sags.append(0.25 * h * h * (second.centre.abs() + second.radius) * (1.0 + 1e-12))
            rests.append(rest)
        centre, generators, box = (torch.stack([form[k] for form in ends], dim=1) for k in range(3))
        return Zonotope(centre, generators, box), torch.stack(sags, 1), torch.stack(rests, 1)

    def _during(self, boxes: list[Form], h: float) -> list[Form]:
        """Boxes that states do not leave during a step: a guess that the rates in it keep.

        Boxes have an error alone, and the last ones are commands, which stay.
        """
        n = self._states

        def reach(guess: list[Form]) -> list[tuple[Tensor, Tensor]]:
            """How far down and up, (B,) each, rates within a box move the states in the step."""
            series = Series(self._tape, self._rates, guess)
            series.extend()
            moves = [state[1].times(h) for state in series.states]
            return [
                (
                    (m.centre - m.radius).clamp(max=0.0),
                    (m.centre + m.radius).clamp(min=0.0),
                )
                for m in moves
            ]

        def grown(ways: list[tuple[Tensor, Tensor]], room: float) -> list[Form]:
            """Boxes with room beyond these ways; commands stay.

            Only a guess of where the motion stays in the step: `_during` then proves it, by the rates over the
            guess.
            """
            forms = []
            for box, (down, up) in zip(boxes, ways, strict=False):
                more = room * (up - down) + 1e-9 * (box.centre.abs() + box.radius) + 1e-12
                low = down - more
                high = up + more
                centre = box.centre + 0.5 * (low + high)
                radius = (box.radius + 0.5 * (high - low)) * (1.0 + 1e-12)
                forms.append(Form(centre, box.generators, radius))
            return [*forms, *boxes[n:]]

        # A guess is proved if what its rates reach is inside it.
        guess = grown(reach(boxes), 0.2)
        fits = torch.ones_like(boxes[0].centre, dtype=torch.bool)
        for _ in range(_GUESSES):
            guess = grown(reach(guess), 0.2)
            ways = reach(guess)
            fits = torch.ones_like(fits)
            for box, larger, (down, up) in zip(boxes, guess, ways, strict=False):
                fits &= box.centre - box.radius + down > larger.centre - larger.radius
                fits &= box.centre + box.radius + up < larger.centre + larger.radius
            if bool(fits.all()):
                break
        # Without a box nothing is proved.
        return [
            Form(torch.where(fits, form.centre, torch.nan), form.generators, form.error)
            for form in guess
        ]
