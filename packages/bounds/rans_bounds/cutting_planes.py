"""Maximisation of concave functions, such as dual functions of bounds, by cutting planes within a trust region.

How well it does decides only how good a bound is: a dual function bounds at every point that is asked for.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

_FARTHEST = 10.0
"""Half the edge of the largest box, in scaled variables; those of least fuel are about 1."""


@dataclass(frozen=True)
class Cut:
    """A plane above the function."""

    offset: float
    """Value of the plane at zero."""
    slope: np.ndarray
    """(n,) per scaled variable."""
    source: Any
    """What the function gave where the plane touches it."""


@dataclass(frozen=True)
class Ascent:
    """Result of the maximisation."""

    best: Any
    """What the function gave at the best point."""
    cuts: list[Cut]
    """Cut of every point that was tried."""
    weights: np.ndarray
    """(cuts,) of the mixture of cuts that bounds the function; sum 1 or all zero."""


def ascend(
    function: Callable[[np.ndarray], Any],
    start: np.ndarray,
    unit: np.ndarray,
    target: float,
    tolerance: float,
    trust: float,
    iterations: int,
    cuts: Sequence[Cut] = (),
    low: np.ndarray | float = -math.inf,
    high: np.ndarray | float = math.inf,
    normal: np.ndarray | None = None,
    relative: float = 0.0,
    is_over: Callable[[], bool] = lambda: False,
) -> Ascent:
    """Raise a concave function until it exceeds the target, can hardly rise any more, or patience ends.

    Kelley's cutting planes in a trust region (a bundle method): the next point is where the lowest plane so far
    is highest, within a box around the best point.

    Source: J. E. Kelley, "The cutting-plane method for solving convex programs", Journal of the Society for
    Industrial and Applied Mathematics 8(4), 1960.

    Args:
        function: of a point (n,) to a ``value`` and its ``gradient`` (n,), a supergradient; an infinite value ends
            the ascent.
        start: scaled point (n,) to begin with.
        unit: (n,) sizes of the variables that count as one: points are scaled ones times these.
        target: value that is enough.
        tolerance: rise that is not worth another evaluation.
        trust: half the edge of the first box, in scaled variables.
        iterations: largest number of evaluations.
        cuts: planes from earlier ascents.
        low: (n,) least scaled variables.
        high: (n,) largest ones.
        normal: (n,) points stay on the plane through the start with this normal; None: anywhere.
        relative: rise, over the best value, that is not worth another evaluation either.
        is_over: whether no further evaluation may begin.
    """
    cuts = list(cuts)
    best = function(start * unit)
    centre = start
    weights = np.zeros(0)
    latest = best
    point = start

    def highest() -> tuple[np.ndarray, float, np.ndarray]:
        return _highest(
            cuts, np.maximum(low, centre - trust), np.minimum(high, centre + trust), centre, normal
        )

    for _ in range(iterations):
        if np.isinf(latest.value):
            return Ascent(latest, cuts, weights)
        slope = latest.gradient * unit
        cuts.append(Cut(float(latest.value - slope @ point), slope, latest))
        if best.value > target or is_over():
            break
        least = max(tolerance, relative * best.value)
        point, ceiling, weights = highest()
        while (
            ceiling - best.value <= least
            and trust < _FARTHEST
            and np.abs(point - centre).max() > 0.99 * trust
        ):
            trust *= 4.0  # the box holds it back, not the cuts
            point, ceiling, weights = highest()
        # No point can raise the value by more than this.
        if ceiling - best.value <= least:
            break
        latest = function(point * unit)
        # The box grows where the planes predict the rise well, and shrinks where they do not.
        rise = (latest.value - best.value) / (ceiling - best.value)
        trust *= 2.0 if rise > 0.5 else 1.0 if rise > 0.1 else 0.5
        if rise > 0:
            best = latest
            centre = point
    return Ascent(best, cuts, np.append(weights, np.zeros(len(cuts) - len(weights))))


def _highest(
    cuts: list[Cut],
    low: np.ndarray,
    high: np.ndarray,
    centre: np.ndarray,
    normal: np.ndarray | None,
) -> tuple[np.ndarray, float, np.ndarray]:
    """Where (n,) in the box, and on the plane of ``normal``, the lowest cut is highest; height, weights (cuts,).

    Its height is an upper bound of what the box still offers; the ascent ends where that is little.
    """
    from scipy.optimize import linprog

    plane, level = (
        (None, None) if normal is None else (np.append(normal, 0.0)[None], [normal @ centre])
    )
    answer = linprog(
        np.append(np.zeros(len(centre)), -1.0),
        A_ub=np.array([np.append(-cut.slope, 1.0) for cut in cuts]),
        b_ub=[cut.offset for cut in cuts],
        A_eq=plane,
        b_eq=level,
        bounds=[*zip(low, high, strict=True), (None, None)],
        method="highs",
    )
    if answer.x is None:  # planes so large that the solver gives up: stay
        return centre, -np.inf, np.zeros(len(cuts))
    # The solver leaves bounds by its tolerance, and a multiplier of the wrong sign bounds nothing.
    point = np.clip(answer.x[:-1], low, high)
    return point, -float(answer.fun), np.abs(answer.ineqlin.marginals)
