"""On/off controls that reach the goal set: nozzles for a given attitude, and their exact replay."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from rans_bounds.flight import state_after
from rans_bounds.plane.dual import DualValue, Relaxation

_SIDES = 16
"""Sides of the polygon inside the goal's discs: it gives away 2 % of their radius."""
_NODES_PER_SECOND = 300
"""Nodes that HiGHS solves in a nominal second."""


def nozzles(
    relaxation: Relaxation, path: np.ndarray, bound: DualValue, limit: float, work: float
) -> np.ndarray | None:
    """Commands (N, thrusters) that turn as a path does and end, replayed, in the goal set, if any are found.

    With the attitude known, velocity and position at the end are linear in the choice of one pattern per
    period: a mixed-integer linear program (HiGHS). Patterns whose reduced cost alone exceeds what is left of
    the limit are not offered.

    Only the net torques of the path's patterns (N,) matter; the bound's costate gives the reduced costs. The
    limit is the most fuel, N s, 0 where fuel is free; the solver may branch for so much work, in
    nominal s (`rans_bounds.problem.SearchEffort`).
    """
    choices = _choices(relaxation, path, bound, limit)
    chosen = _solve(relaxation, *choices, limit, work)
    return None if chosen is None else replayed_within_cost(relaxation, choices[1][chosen], limit)


def replayed_within_cost(
    relaxation: Relaxation, path: np.ndarray, limit: float
) -> np.ndarray | None:
    """The commands of a path, (N, thrusters), if their replay ends in the goal set and costs no more.

    The sums are tried first, as they cost less; the flight by the engine's equations decides.
    """
    gained, displacement = relaxation.effect(path)
    miss = relaxation.miss
    goal_set = relaxation.goal_set
    lattice = relaxation.lattice
    impulse = float(lattice.patterns.thrust[path].sum()) * lattice.period
    if (
        abs(complex(*miss[:2]) + gained) > goal_set.velocity
        or abs(complex(*miss[2:]) + displacement) > goal_set.position
        or relaxation.fuel * impulse > limit + 1e-9
    ):
        return None
    commands = lattice.patterns.commands[path]
    final = state_after(lattice.craft, relaxation.start, commands, lattice.period)
    return commands if goal_set.contains(final, relaxation.goal) else None


def _choices(
    relaxation: Relaxation, path: np.ndarray, bound: DualValue, limit: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Period, pattern, final speed and displacement (C,) of every choice within the limit for a path (T,).

    Too many only slow the search; one that is left out may hide a plan, and makes no bound wrong.
    """
    patterns = relaxation.lattice.patterns
    same = patterns.torque[path][:, None] == patterns.torque
    everything = np.broadcast_to(np.arange(len(patterns.torque)), same.shape)
    speed, displacement = relaxation.effects(path, everything)
    velocity = complex(*bound.costate[:2])
    position = complex(*bound.costate[2:])
    price = relaxation.fuel * relaxation.lattice.period * patterns.thrust
    price = np.where(
        same, price + (np.conj(velocity) * speed + np.conj(position) * displacement).real, np.inf
    )
    cheapest = price.min(axis=1)
    left = limit - relaxation.constant(bound.costate)[0] - cheapest.sum()
    period, pattern = np.nonzero(price - cheapest[:, None] <= max(0.0, left) + 1e-9)
    return period, pattern, speed[period, pattern], displacement[period, pattern]


def _solve(
    relaxation: Relaxation,
    period: np.ndarray,
    pattern: np.ndarray,
    speed: np.ndarray,
    displacement: np.ndarray,
    limit: float,
    work: float,
) -> np.ndarray | None:
    """Indices (T,) of one choice a period, in their order, by an integer program; None: none within ``work``."""
    from scipy.optimize import Bounds, LinearConstraint, milp
    from scipy.sparse import csr_matrix

    # One choice in every period, whose sums end in the goal set and spend no more than the limit.
    count = len(period)
    lattice = relaxation.lattice
    miss = relaxation.miss
    once = csr_matrix((np.ones(count), (period, np.arange(count))), (relaxation.steps, count))
    constraints = [
        LinearConstraint(once, 1, 1),
        _disc(speed, complex(*miss[:2]), relaxation.goal_set.velocity),
        _disc(displacement, complex(*miss[2:]), relaxation.goal_set.position),
    ]
    if relaxation.fuel > 0:
        thrust = lattice.period * lattice.patterns.thrust[pattern]
        constraints.append(LinearConstraint(thrust[None], -np.inf, limit * (1 + 1e-9)))
    # Any choice will do: nothing is minimised.
    answer = milp(
        np.zeros(count),
        integrality=np.ones(count),
        bounds=Bounds(0, 1),
        constraints=constraints,
        options={"node_limit": math.ceil(work * _NODES_PER_SECOND)},
    )
    return None if answer.x is None else np.flatnonzero(answer.x > 0.5)


def _disc(effect: np.ndarray, miss: complex, radius: float) -> Any:
    """A `LinearConstraint`: half planes of a polygon inside |miss + sum of effects| <= radius."""
    from scipy.optimize import LinearConstraint

    normals: np.ndarray = np.exp(2j * np.pi * np.arange(_SIDES) / _SIDES)
    inside = radius * np.cos(np.pi / _SIDES) * (1 - 1e-9)
    left: Any = inside - np.real(np.conj(normals) * miss)
    return LinearConstraint(np.real(np.conj(normals)[:, None] * effect), -np.inf, left)
