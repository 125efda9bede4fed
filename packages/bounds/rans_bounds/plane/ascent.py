"""Maximisation of the dual function over the costate."""

from __future__ import annotations

import math

import numpy as np

from rans_bounds import cutting_planes
from rans_bounds.cutting_planes import Ascent, Cut
from rans_bounds.plane.dual import Branch, Relaxation


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
    """Raise the bound of a branch, see `rans_bounds.cutting_planes.ascend`; cuts are `DualValue`'s.

    An infinite value proves that the branch holds no path. Where fuel is free the dual function is homogeneous, and
    costates are kept on the plane through the start on which only their direction varies. No evaluation begins
    after so much work, in nominal s (`rans_bounds.problem.SearchEffort`).
    """
    limit = relaxation.work + work
    return cutting_planes.ascend(
        lambda costate: relaxation.bound(costate, branch),
        start,
        scale(relaxation),
        target,
        tolerance,
        trust,
        iterations,
        cuts,
        normal=towards_goal(relaxation) if relaxation.fuel == 0.0 else None,
        is_over=lambda: relaxation.work > limit,
    )
