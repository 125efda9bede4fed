"""Least impulse of inspections: a lower bound in closed form, from the points that are dearest to see."""

from __future__ import annotations

import math

import numpy as np

from rans.extend import Spacecraft, SpatialState, Timing, Vec3
from rans_missions.orbits.linear import carried, transition
from rans_missions.tasks.inspect import Inspect
from rans_missions.vectors import components, motion_of

_ROUNDING = 1e-9
"""Rounding of a share of points against its tolerance."""


def inspection_bound(
    craft: Spacecraft,
    task: Inspect,
    start: SpatialState,
    goal: SpatialState,
    within: float,
    timing: Timing,
) -> float:
    """Lower bound of the impulse of any successful inspection from a start, N s.

    To see a point with the outward normal a, the craft must be above its horizon, a . p >= R, at a check at which
    the sun is within the light cone. Without thrust it would be at a . p_free there. An impulse of 1 N s that is
    given a time s earlier moves it along a by at most e(s), the largest a . Phi_pv(s) d / m over the directions d
    of the thrusters. So the point costs at least (R - a . p_free) / max e, however the thrust is distributed. Its
    price is the least of this over all checks with light. If success allows k unseen points, every successful
    flight sees at least one of the k + 1 dearest points, so that the (k + 1)-th highest price is a bound.

    The bound leaves out the keep-out ball, the end of the zone, limits of the thrust, and that one flight has to
    see all points. It holds for every control law.

    Args:
        craft: of constant mass. If nothing can turn it, its thrusters push along their directions at the start,
            else in any direction.
        task: the inspection.
        start: state of one craft, of numbers.
        goal: goal of the same episode, with the angle of the sun at the start in its notes.
        within: time within which it must succeed, s.
        timing: control period and checks, at which points are seen.
    """
    prices = np.sort(point_prices(craft, task, start, goal, within, timing)[-1])
    allowed = math.ceil(task.unseen_tolerance * task.points - _ROUNDING) - 1
    return float(prices[-1 - max(allowed, 0)])


def point_prices(
    craft: Spacecraft,
    task: Inspect,
    start: SpatialState,
    goal: SpatialState,
    within: float,
    timing: Timing,
) -> np.ndarray:
    """Least impulse with which a craft sees each point by each check, (checks, points) N s; infinite before light.

    Arguments are those of `inspection_bound`.
    """
    step = timing.control_period / timing.checks
    times = step * np.arange(math.floor(within / step + 1e-9) + 1)
    normals = np.array(task.normals)

    # Where the craft coasts, and which points are in light.
    free = carried(task.drift, motion_of(start), times)[:, :3] @ normals.T
    lit = sunlit(task, goal.notes.sun, times)

    # How far an impulse of 1 N s moves it along each normal, at best, in the time since the start.
    along = np.einsum("ij,tjk->tik", normals, transition(task.drift, times)[:, :3, 3:])
    best = np.maximum.accumulate(most_gained(craft, thruster_pushes(craft, start), along), axis=0)
    best = np.where(best > 0.0, best + between_checks(task, step) / craft.mass, 0.0)

    missing = np.maximum(task.surface_distance - free, 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        price = np.where(missing > 0.0, missing / best, 0.0)
    return np.minimum.accumulate(np.where(lit, price, math.inf), axis=0)


def sunlit(task: Inspect, sun: float, times: np.ndarray) -> np.ndarray:
    """Whether each point is in light a time (T,), s, after the sun was at an angle, rad: (T, points)."""
    angle = sun - task.mean_motion * times
    towards = np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    lit: np.ndarray = towards @ np.transpose(task.normals) > math.cos(
        math.radians(task.light_degrees)
    )
    return lit


def between_checks(task: Inspect, step: float) -> float:
    """Most by which a response along a unit vector exceeds, between checks ``step`` (s) apart, those at both, s."""
    # Its second derivative is at most sqrt(18) n.
    return math.sqrt(18.0) * task.mean_motion * step**2 / 8.0


def thruster_pushes(craft: Spacecraft, start: SpatialState) -> np.ndarray | None:
    """Change of velocity by 1 N s of each thruster, (K, 3) m/s in W; None: the craft may turn and push anywhere."""
    wrenches = craft.wrenches
    turns = bool(craft.wheels) or bool(np.any(np.abs(wrenches[:, 3:]) > 0.0))
    if turns or np.any(start.spin()):
        return None
    forces = wrenches[:, :3]
    along = forces / np.linalg.norm(forces, axis=1, keepdims=True)
    in_world = [components(start.attitude.rotate(Vec3(*way)), 1)[0] for way in along]
    return np.array(in_world) / craft.mass


def most_gained(craft: Spacecraft, pushes: np.ndarray | None, along: np.ndarray) -> np.ndarray:
    """The most that 1 N s of a craft adds, (...), where 1 m/s along each axis of W adds ``along`` (..., 3).

    Its ``pushes`` are those of `thruster_pushes`.
    """
    if pushes is None:
        return np.linalg.norm(along, axis=-1) / craft.mass
    best = np.zeros(along.shape[:-1])
    for push in pushes:
        np.maximum(best, along @ push, out=best)
    return best
