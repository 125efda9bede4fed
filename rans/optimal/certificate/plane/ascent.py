"""Maximisation of the dual function over the costate: cutting planes within a trust region.

Kelley's method ("The cutting-plane method for solving convex programs", J. SIAM 8(4), 1960), kept from
jumping by a box around the best costate so far. How well it does decides only how good a bound is:
every costate it asks for gives a valid one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rans.optimal.certificate.plane.dual import Branch, DualValue, Relaxation

_FARTHEST = 10.0
"""Half the edge of the largest box, in scaled costate; those of least fuel are about 1."""


@dataclass(frozen=True)
class Cut:
    """A path's cost is linear in the costate: the dual function lies below it everywhere."""

    offset: float
    """Value of the cutting plane at costate zero."""
    slope: np.ndarray
    """(4,) per scaled costate."""
    path: np.ndarray
    """(N,) patterns."""


@dataclass(frozen=True)
class Ascent:
    """Result of the maximisation."""

    best: DualValue
    """The greatest bound found."""
    cuts: list[Cut]
    """Cut of every costate that was tried."""
    weights: np.ndarray
    """(cuts,) of the mixture of paths that the relaxation takes for a solution; sum 1 or all zero."""


def scale(relaxation: Relaxation) -> np.ndarray:
    """(4,) costates that are worth as much as the fuel: one newton second changes m v by one."""
    mass = relaxation.lattice.craft.mass
    time = relaxation.steps * relaxation.lattice.period
    return mass * np.array([1.0, 1.0, 2.0 / time, 2.0 / time])


def towards_goal(relaxation: Relaxation) -> np.ndarray:
    """(4,) the scaled costate of a flight in a straight line: thrust ahead, then back."""
    start = relaxation.start
    goal = relaxation.goal
    displacement = goal.p - start.p - start.v.scale(relaxation.steps * relaxation.lattice.period)
    length = displacement.norm()
    direction = (
        np.array([displacement.x, displacement.y]) / length if length > 0 else np.array([1.0, 0.0])
    )
    return np.concatenate([direction, -direction])


def ascend(
    relaxation: Relaxation,
    branch: Branch,
    start: np.ndarray,
    cuts: list[Cut],
    target: float,
    tolerance: float,
    trust: float,
    iterations: int,
    work: float = math.inf,
) -> Ascent:
    """Raise the bound until it exceeds the target, can hardly rise any more, or patience ends.

    Kelley's cutting planes in a trust region (a bundle method): the next costate is where the lowest plane so far
    is highest, within a box around the best costate. Where fuel is free the dual function is homogeneous, and
    costates are kept on the plane through the start on which only their direction varies.

    Source: J. E. Kelley, "The cutting-plane method for solving convex programs", Journal of the Society for
    Industrial and Applied Mathematics 8(4), 1960.

    Args:
        relaxation: whose dual function it is.
        branch: paths that count.
        start: scaled costate (4,) to begin with.
        cuts: planes of paths of the branch, from earlier ascents.
        target: bound that is enough.
        tolerance: rise that is not worth another evaluation.
        trust: half the edge of the first box, in scaled costate.
        iterations: largest number of evaluations.
        work: no evaluation begins after so much work, in nominal s (`Effort`).
    """
    unit = scale(relaxation)
    limit = relaxation.work + work
    cuts = list(cuts)
    normal = towards_goal(relaxation) if relaxation.fuel == 0.0 else None
    best = relaxation.bound(start * unit, branch)
    centre = start
    weights = np.zeros(0)
    latest = best
    point = start
    for _ in range(iterations):
        # An infinite value proves that the branch holds no path.
        if np.isinf(latest.value):
            return Ascent(latest, cuts, weights)
        slope = latest.gradient * unit
        cuts.append(Cut(float(latest.value - slope @ point), slope, latest.path))
        if best.value > target or relaxation.work > limit:
            break
        point, ceiling, weights = _highest(cuts, centre, trust, normal)
        while (
            ceiling - best.value < tolerance
            and trust < _FARTHEST
            and np.abs(point - centre).max() > 0.99 * trust
        ):
            trust *= 4.0  # the box holds it back, not the cuts
            point, ceiling, weights = _highest(cuts, centre, trust, normal)
        # No costate can raise the bound by more than this.
        if ceiling - best.value < tolerance:
            break
        latest = relaxation.bound(point * unit, branch)
        # The box grows where the planes predict the rise well, and shrinks where they do not.
        rise = (latest.value - best.value) / (ceiling - best.value)
        trust *= 2.0 if rise > 0.5 else 1.0 if rise > 0.1 else 0.5
        if rise > 0:
            best = latest
            centre = point
    return Ascent(best, cuts, np.append(weights, np.zeros(len(cuts) - len(weights))))


def _highest(
    cuts: list[Cut], centre: np.ndarray, trust: float, normal: np.ndarray | None
) -> tuple[np.ndarray, float, np.ndarray]:
    """Where (4,) in the box, and on the plane of ``normal``, the lowest cut is highest; height, weights (cuts,).

    Its height is an upper bound of what the box still offers; the ascent ends where that is little.
    """
    from scipy.optimize import linprog

    planes = np.array([np.append(-cut.slope, 1.0) for cut in cuts])
    box = [(x - trust, x + trust) for x in centre]
    plane, level = (
        (None, None) if normal is None else (np.append(normal, 0.0)[None], [normal @ centre])
    )
    answer = linprog(
        [0.0, 0.0, 0.0, 0.0, -1.0],
        A_ub=planes,
        b_ub=[cut.offset for cut in cuts],
        A_eq=plane,
        b_eq=level,
        bounds=[*box, (None, None)],
        method="highs",
    )
    if answer.x is None:  # planes so large that the solver gives up: stay
        return centre, -np.inf, np.zeros(len(cuts))
    return answer.x[:4], -float(answer.fun), np.abs(answer.ineqlin.marginals)
