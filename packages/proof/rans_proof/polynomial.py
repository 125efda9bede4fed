"""Enclosed motion of polynomial plants: a Taylor step of order 2 with a bounded rest.

x(h) = x + h f + h^2 / 2 f2 + h^3 / 6 f3(at some state on the way), where f2 and f3 are derivatives along f. Over a
set the polynomial x + h f + h^2 / 2 f2 is its linear part at the centre and a second-order rest (Althoff et al.,
"Reachability analysis of nonlinear systems with uncertain parameters using conservative linearization", 2008).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor

from rans.errors import ConfigError
from rans_proof.plants import Piece
from rans_proof.problem import Problem
from rans_proof.relaxation import Planes, Zonotope

_SUBSTEPS = 10
"""Taylor steps of a control period."""
_UNIT = 2.0**-53
_MOST_TERMS = 100_000
"""Terms of one polynomial at most."""
_LARGEST_PRODUCT = 100_000
"""Products of terms in a product of two polynomials at most, which take a second."""

Monomial = tuple[int, ...]
"""Exponent of each variable."""


class Polynomial:
    """Polynomial as a table of coefficients."""

    def __init__(self, terms: Mapping[Monomial, float]) -> None:
        self.terms = {key: value for key, value in terms.items() if value != 0.0}
        if len(self.terms) > _MOST_TERMS:
            raise ConfigError(f"the plant has polynomials of more than {_MOST_TERMS:,} terms.")

    def __add__(self, other: Any) -> Polynomial:
        terms = dict(self.terms)
        for key, value in self._like(other).terms.items():
            terms[key] = terms.get(key, 0.0) + value
        return Polynomial(terms)

    __radd__ = __add__

    def __neg__(self) -> Polynomial:
        return -1.0 * self

    def __sub__(self, other: Any) -> Polynomial:
        return self + -self._like(other)

    def __rsub__(self, other: Any) -> Polynomial:
        return -self + other

    def __mul__(self, other: Any) -> Polynomial:
        if isinstance(other, int | float):
            return Polynomial({key: other * value for key, value in self.terms.items()})
        if len(self.terms) * len(other.terms) > _LARGEST_PRODUCT:
            raise ConfigError("the plant has polynomials of too many terms.")
        terms: dict[Monomial, float] = {}
        for key, value in self.terms.items():
            for key_2, value_2 in other.terms.items():
                product = tuple(a + b for a, b in zip(key, key_2, strict=True))
                terms[product] = terms.get(product, 0.0) + value * value_2
        return Polynomial(terms)

    __rmul__ = __mul__

    def _like(self, other: Any) -> Polynomial:
        if isinstance(other, Polynomial):
            return other
        width = len(next(iter(self.terms), ()))
        return Polynomial({(0,) * width: float(other)})

    def derivative(self, number: int) -> Polynomial:
        """Partial derivative by a variable."""
        return Polynomial(
            {
                tuple(e - (i == number) for i, e in enumerate(key)): value * key[number]
                for key, value in self.terms.items()
                if key[number] > 0
            }
        )


class _Compiled:
    """Polynomials evaluated together on tensors."""

    def __init__(self, polynomials: list[Polynomial], width: int, device: torch.device) -> None:
        keys = sorted({key for polynomial in polynomials for key in polynomial.terms}) or [
            (0,) * width
        ]
        self._exponents = torch.tensor(keys, device=device)
        table = torch.zeros((len(keys), len(polynomials)), dtype=torch.float64, device=device)
        for k, polynomial in enumerate(polynomials):
            for row, key in enumerate(keys):
                table[row, k] = polynomial.terms.get(key, 0.0)
        self._table = table
        self._highest = int(self._exponents.max())
        self.operations = len(keys) + width * (self._highest + 1)

    def __call__(self, values: Tensor) -> Tensor:
        """(B, polynomials) of variables (B, width)."""
        return self._monomials(values) @ self._table

    def absolute(self, values: Tensor) -> Tensor:
        """Bounds (B, polynomials) of absolute values where no variable's exceeds these (B, width)."""
        grown = 1.0 + 4.0 * self.operations * _UNIT
        return self._monomials(values) @ self._table.abs() * grown

    def _monomials(self, values: Tensor) -> Tensor:
        powers = torch.stack([values**k for k in range(self._highest + 1)], dim=2)  # (B, width, k)
        chosen = powers[:, torch.arange(values.shape[1]), self._exponents]  # (B, terms, width)
        return chosen.prod(dim=2)


class PolynomialPlant:
    """Plant whose rates are polynomials of state and commands, which moves by Taylor steps of second order.

    With x' = f(x, u) and constant commands u, a step of length h is x + h f + h^2 / 2 f' + h^3 / 6 f'', with f''
    anywhere in the step.

    Args:
        problem: its rates, control period and numbers of states and commands.
        device: device of the sets that move.
    """

    def __init__(self, problem: Problem, device: torch.device) -> None:
        # The variables, states before commands, and f as polynomials of them.
        self._states = problem.states
        width = problem.states + problem.commands
        unit = [tuple(int(i == k) for i in range(width)) for k in range(width)]
        variables = [Polynomial({key: 1.0}) for key in unit]
        zero = Polynomial({(0,) * width: 0.0})
        rates = [
            zero + rate
            for rate in problem.rates(variables[: self._states], variables[self._states :])
        ]

        def along(polynomials: list[Polynomial]) -> list[Polynomial]:
            """Their derivatives by time."""
            return [
                sum((polynomial.derivative(k) * rate for k, rate in enumerate(rates)), start=zero)
                for polynomial in polynomials
            ]

        # f' and f'', the step without its last term, and the step's first and second derivatives by the variables.
        second = along(rates)
        third = along(second)
        h = problem.period / _SUBSTEPS
        step = [
            x + h * f + 0.5 * h * h * g for x, f, g in zip(variables, rates, second, strict=False)
        ]
        slopes = [component.derivative(k) for component in step for k in range(width)]
        curvatures = [slope.derivative(k) for slope in slopes for k in range(width)]
        self._h = h
        self._width = width
        self._step, self._rate, self._second, self._third, self._slopes, self._curvatures = (
            _Compiled(polynomials, width, device)
            for polynomials in (step, rates, second, third, slopes, curvatures)
        )

    def move(self, states: Zonotope, planes: Planes) -> list[Piece]:
        """A piece for each Taylor step."""
        # State and commands together; the commands are held.
        count = len(states.centre)
        commands = (planes.gain @ states.centre[:, :, None])[:, :, 0] + planes.offset
        kept = (planes.gain.abs() @ states.box[:, :, None])[:, :, 0] + planes.error
        upper = torch.cat((states.generators, torch.diag_embed(states.box)), dim=2)
        lower = torch.cat(
            (planes.gain @ states.generators, planes.gain * states.box[:, None, :]), dim=2
        )
        nothing = torch.zeros_like(states.box)
        both = Zonotope(
            torch.cat((states.centre, commands), dim=1),
            torch.cat((upper, lower), dim=1),
            torch.cat((nothing, planes.error + 64.0 * _UNIT * (kept + commands.abs())), dim=1),
        )
        pieces = []
        begin = self._of_states(both)
        for _ in range(_SUBSTEPS):
            both, sag = self._stepped(both)
            end = self._of_states(both)
            pieces.append(Piece(begin, end, sag))
            begin = end
        assert len(begin.centre) == count
        return pieces

    def _of_states(self, both: Zonotope) -> Zonotope:
        return Zonotope(*(x[:, : self._states] for x in both))

    def _stepped(self, both: Zonotope) -> tuple[Zonotope, Tensor]:
        """Set of state and commands a Taylor step later, and by how much its way there sags."""
        n = self._states
        radius = both.radius
        size = both.size
        # A box that no way leaves: grown by twice what the rates at its begin allow, and checked.
        grown = size.clone()
        grown[:, :n] += 2.0 * self._h * self._rate.absolute(size)
        fits = (self._h * self._rate.absolute(grown) <= grown[:, :n] - size[:, :n]).all(dim=1)
        grown = torch.where(fits[:, None], grown, torch.nan)  # without a box nothing is proved
        rest = self._h**3 / 6.0 * self._third.absolute(grown)
        sag = self._h**2 / 8.0 * self._second.absolute(grown)
        # Linear part at the centre, and the second-order rest over the set.
        jacobian = self._slopes(both.centre).reshape(-1, n, self._width)
        curvature = self._curvatures.absolute(size).reshape(-1, n, self._width, self._width)
        curved = 0.5 * (radius[:, None, None, :] @ curvature @ radius[:, None, :, None])
        curved = curved[:, :, 0, 0]
        rounding = 4.0 * self._step.operations * _UNIT * self._step.absolute(size)
        rounding = (
            rounding
            + 4.0
            * self._slopes.operations
            * _UNIT
            * (self._slopes.absolute(size).reshape(-1, n, self._width) @ radius[:, :, None])[
                :, :, 0
            ]
        )
        box = (jacobian.abs() @ both.box[:, :, None])[:, :, 0] + curved + rest + rounding
        centre = torch.cat((self._step(both.centre), both.centre[:, n:]), dim=1)
        generators = torch.cat((jacobian @ both.generators, both.generators[:, n:]), dim=1)
        return Zonotope(centre, generators, torch.cat((box, both.box[:, n:]), dim=1)), sag
