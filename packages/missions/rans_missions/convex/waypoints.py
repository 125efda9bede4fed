"""Impulse below which no flight passes a sequence of balls, by a cone program."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from rans_missions.convex.cone_program import Rows

_ROUNDING = 1e-9
"""Relative rounding of a bound."""


class Waypoint(NamedTuple):
    """Ball, or a part of one, in which a flight is at some instant of a span."""

    first: float
    """Earliest instant, s."""
    last: float
    """Latest instant, > 0, s."""
    position: np.ndarray
    """(d,) centre in W, m."""
    radius: float
    """m."""
    ahead: np.ndarray | None = None
    """(d,) unit vector: positions are ahead of a plane across it. None: anywhere in the ball."""
    behind: float = 0.0
    """How far this plane is behind the centre, m."""
    level: np.ndarray | None = None
    """(d,) unit vector: positions are in the plane through the centre across it. None: anywhere."""


def least_impulse_through(mass: float, place: np.ndarray, waypoints: Sequence[Waypoint]) -> float:
    """Impulse below which no flight from rest is in each of some balls one after the other, N s.

    It is that of changes of velocity at the start and in the balls, by weak duality: with multipliers l_j of the
    positions at the instants t_j and q(t) the sum of l_j (t_j - t) over what is to come, the impulse is at least
    the integral of q . F if |q| <= 1. |q| is convex between the instants, and at each of them convex in all of
    them, so that it is checked for the earliest and latest ones only (docs/missions/through_balls.md). Commands may
    be anything between 0 and 1 that changes at any instant, and attitudes are free.

    Args:
        mass: of a craft that `rans.extend.check_certifiable` passes, with or without wheels, kg.
        place: (d,) where it starts in W, m.
        waypoints: in the order of the instants.

    Raises:
        SolverFailed: the solver of cone programs ends without an answer.
    """
    count, size = len(waypoints), len(place)
    spans = np.array([(point.first, point.last) for point in waypoints])
    unit = float(spans.max())
    ways = np.array([point.position for point in waypoints]) - place
    radii = np.array([point.radius for point in waypoints])
    behind = np.array([point.behind for point in waypoints])
    # By what the multipliers, times the unit of time, make q at the start and in every ball but the last.
    combined = []
    for instants in itertools.product(*spans.tolist()):
        for k, since in enumerate((0.0, *instants[:-1])):
            combined.append([(t - since) / unit if j >= k else 0.0 for j, t in enumerate(instants)])
    weights = np.unique(combined, axis=0)
    planes = np.zeros((count, size))
    # What measures a multiplier, over the radius: of a disc its part along the disc.
    shapes = np.tile(np.eye(size), (count, 1, 1))
    for k, point in enumerate(waypoints):
        if point.ahead is not None:
            planes[k] = point.ahead
        if point.level is not None:
            shapes[k] -= np.outer(point.level, point.level)
    # Variables: multipliers by ball and axis; what they have less a plane's, by size; and the planes' multipliers.
    width = count * (size + 2)
    pulls, sizes, of_planes = np.split(np.eye(width), [count * size, count * (size + 1)])
    pulls = pulls.reshape(count, size, width)
    rows = Rows(width)
    rows.keep_above_zero(of_planes, np.zeros(count))
    # Cones: these sizes, and q.
    apart = shapes @ (pulls - planes[:, :, None] * of_planes[:, None])
    q = np.einsum("wk,kin->win", weights, pulls)
    for heads, constant, tails in (sizes, 0.0, apart), (np.zeros((len(q), width)), 1.0, q):
        flat = tails.reshape(-1, width)
        constants = np.full(len(heads), constant)
        rows.keep_in_cones(heads, constants, flat, np.zeros(len(flat)))
    cost = np.concatenate([-ways.ravel(), radii, behind])
    unlimited = np.full(width, 1e6)
    program = rows.program(cost, -unlimited, unlimited)
    answer = np.array(program.solve("multipliers of a bound").x)
    multipliers = answer[: count * size].reshape(count, size)
    # Whatever the solver leaves open, these multipliers are shortened until |q| <= 1.
    shorter = max(1.0, float(np.linalg.norm(weights @ multipliers, axis=1).max())) * (1 + _ROUNDING)
    multipliers = multipliers / shorter
    of_planes = np.maximum(answer[count * (size + 1) :], 0.0) / shorter
    apart = multipliers - of_planes[:, None] * planes
    left = np.linalg.norm(np.einsum("kij,kj->ki", shapes, apart), axis=1)
    spared = float(radii @ left + behind @ of_planes)
    terms = float(np.sum(np.abs(multipliers) * (np.abs(ways) + 2.0 * np.abs(place)))) + spared
    return max(0.0, mass / unit * (float(np.sum(multipliers * ways)) - spared - _ROUNDING * terms))
