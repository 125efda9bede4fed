"""Translation under a thrust that turns with the craft, by quadrature through a drift."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from rans.model.drift import Drift
from rans.model.fields import Field

Rule = tuple[tuple[float, float], ...]

RULES: dict[int, Rule] = {
    count: tuple(
        (float(node + 1) / 2, float(weight) / 2)
        for node, weight in zip(*np.polynomial.legendre.leggauss(count), strict=True)
    )
    for count in range(1, 9)
}
"""Gauss-Legendre nodes and weights on [0, 1], made beforehand: torch cannot trace NumPy's polynomials."""


def moved(
    p: Any,
    v: Any,
    h: Field,
    drift: Drift,
    rule: Rule,
    pushes: Iterator[Any],
    in_world: Callable[[Any, Field], Any],
    steady: Any = None,
) -> tuple[Any, Any]:
    """Position and velocity after h.

    The thrust's acceleration a(t) is a kick w_i h a(s_i h) at every node s_i of weight w_i, which the
    drift carries for the rest of the time. Where kicks travel straight they are summed first:
    v(h) = v + h sum w_i a(s_i h) and p(h) = p + v h + h^2 sum w_i (1 - s_i) a(s_i h), and a disturbance's
    share is exact, as its force does not turn.

    Args:
        p: position in W at the start, m.
        v: velocity in W, m/s.
        h: s.
        drift: how a free point moves.
        rule: nodes and weights.
        pushes: the acceleration at each node, in any form of which sums can be made.
        in_world: makes a vector in W of that form and a scalar to multiply it with.
        steady: a second acceleration, constant in W, m/s^2.
    """
    if not drift.in_straight_lines:
        p, v = drift.carry(p, v, h)
        for (node, weight), push in zip(rule, pushes, strict=True):
            kick = in_world(push, weight * h)
            kick = kick if steady is None else kick + steady.scale(weight * h)
            q, u = drift.carry(kick.scale(0.0), kick, (1 - node) * h)
            p = p + q
            v = v + u
        return p, v
    speed: Any = type(p)(*(0.0,) * len(p.columns()))
    way = speed
    for (node, weight), push in zip(rule, pushes, strict=True):
        speed = speed + push.scale(weight)
        way = way + push.scale(weight * (1 - node))
    gained = in_world(speed, h)
    gone = in_world(way, h * h)
    if steady is not None:
        gained = gained + steady.scale(h)
        gone = gone + steady.scale(0.5 * h * h)
    p, v = drift.carry(p, v, h)
    return p + gone, v + gained
