"""What no on/off controller can beat in space, and controls that come near: see `spatial` for the bound.

There is no branching: the bound is the dual value alone, rounded up to whole periods and pulses. Controls are
looked for by simulated annealing, from more time or fuel than needed downwards.
"""

from __future__ import annotations

import math
import time
from collections.abc import Collection
from typing import NamedTuple

import numpy as np

from rans.model.dynamics import SpatialState
from rans.model.fields import leaves
from rans.optimal.certificate import hull
from rans.optimal.certificate.certificate import Certificate, Effort, Unreachable, check_steps
from rans.optimal.certificate.lattice import GoalSet, rounded_up
from rans.optimal.certificate.onoff import fuel, replay
from rans.optimal.certificate.spatial import ReachRelaxation, SpinLattice

_INSIDE = 0.999
"""Share of the tolerances that the search keeps to; its flights are some micrometres off."""
_SUBSTEPS = 8
"""Of the replay in a period."""
_FIRST_TRIES = 250_000
"""Changes of the first annealing, 0.3 s; every further one has twice as many."""
_EVALUATIONS = 24
"""Of the dual function, at most, 0.3 s each for 100 periods."""


class _Job(NamedTuple):
    """What commands are looked for."""

    lattice: SpinLattice
    start: SpatialState
    goal: SpatialState
    goal_set: GoalSet
    spins: bool
    """Whether the end must be at rest."""
    seconds: float


def least_fuel(lattice: SpinLattice, aims: Collection[str], start: SpatialState, goal: SpatialState,
               steps: int, goal_set: GoalSet, effort: Effort) -> Certificate:
    """Least thrust-time of any on/off controller that is in the goal set after so many control periods.

    Raises:
        Unreachable: no on/off controller can be in the goal set at that time.
        ConfigError: see `ReachRelaxation`.
    """
    check_steps(steps)
    began = time.monotonic()
    relaxation = ReachRelaxation(lattice, aims, start, goal, goal_set, steps)
    loose = hull.least_fuel(lattice.craft, aims, start, goal, relaxation.time, goal_set)
    if math.isinf(loose):
        raise Unreachable(f"no on/off controller can reach the goal set in {steps} control periods of "
                          f"{lattice.period:g} s; the usual cause is too short a time.")
    dual, nodes = _raised(relaxation, (1.04, 1.04))
    dual = max(loose, dual)
    lower = lattice.next_fuel(dual, relaxation.last)
    # commands that arrive at all, then with ever fewer pulses
    job = _Job(lattice, start, goal, goal_set, "spin" in aims, effort.seconds)
    found, nothing = None, np.zeros((steps, len(lattice.craft.thrusters)), dtype=np.int64)
    limit, least = nothing.size, _pulses(lattice, lower)
    while limit >= least:
        better = _annealed(job, nothing if found is None else found, limit, shifts=0.4)
        if better is None:
            break
        found, limit = better, int(better.sum()) - 1
    upper = math.inf if found is None else fuel(lattice.craft, found, lattice.period)
    commands = found if upper > 0.0 else None
    return Certificate(lower, upper, commands, dual, nodes, time.monotonic() - began)


def _pulses(lattice: SpinLattice, lower: float) -> int:
    """Fewest pulses of that fuel."""
    strongest = max(thruster.force for thruster in lattice.craft.thrusters)
    return math.ceil(lower / (strongest * lattice.period) - 1e-9)


def least_time(lattice: SpinLattice, aims: Collection[str], start: SpatialState, goal: SpatialState,
               most_steps: int, goal_set: GoalSet, effort: Effort) -> Certificate:
    """Least time in which any on/off controller can be in the goal set, up to so many control periods.

    Raises:
        ConfigError: see `ReachRelaxation`.
    """
    check_steps(most_steps)
    began, h = time.monotonic(), lattice.period
    if arrived(start, goal, goal_set, "spin" in aims):
        return Certificate(0.0, 0.0, None, 0.0, 0, 0.0)
    loose = rounded_up(hull.least_time(lattice.craft, aims, start, goal, goal_set), h)
    lower, nodes = max(1, round(loose / h)), 0
    while lower <= most_steps:
        value, count = _raised(ReachRelaxation(lattice, aims, start, goal, goal_set, lower, 0.0), (1.0,))
        nodes += count
        if value <= 0.0:
            break
        lower += 1
    # commands for a third more time, or more, then for ever fewer periods
    job = _Job(lattice, start, goal, goal_set, "spin" in aims, effort.seconds)
    found = None
    for steps in range(math.ceil(1.35 * lower), min(2 * lower, most_steps) + 1, max(1, lower // 10)):
        found = _annealed(job, np.zeros((steps, len(lattice.craft.thrusters)), dtype=np.int64), None)
        if found is not None:
            break
    while found is not None and len(found) > lower:
        quietest = int(found.sum(axis=1).argmin())
        better = _annealed(job, np.delete(found, quietest, axis=0), None)
        if better is None:
            break
        found = better
    upper = math.inf if found is None else len(found) * h
    return Certificate(lower * h, upper, found, loose, nodes, time.monotonic() - began)


def arrived(state: SpatialState, goal: SpatialState, goal_set: GoalSet, spins: bool) -> bool:
    """Whether a state of floats is in the set; its spin counts where ``spins``."""
    spin = np.linalg.norm(np.subtract(state.w.columns(), goal.w.columns()))
    return bool((goal.p - state.p).norm() <= goal_set.position
                and (goal.v - state.v).norm() <= goal_set.velocity
                and state.attitude.normalised().to(goal.attitude.normalised()).magnitude() <= goal_set.heading
                and (not spins or spin <= goal_set.spin + 1e-9))


def _raised(relaxation: ReachRelaxation, first: tuple[float, ...]) -> tuple[float, int]:
    """A high bound among costates along the way, and how many were tried; for time the first above 0.

    Pulls along the way by x (y (T - t) 2 / T - 1), in the units of the mass: x = y = 1 is the dual optimum of
    a straight flight of least fuel. Where fuel is free only y matters.
    """
    from scipy.optimize import minimize

    way = relaxation.way if relaxation.way.any() else relaxation.gain
    ahead = way / max(float(np.linalg.norm(way)), 1e-300)
    best, count = -math.inf, 0

    def value(x: np.ndarray) -> float:
        nonlocal best, count
        size, slope = (1.0, x[0]) if relaxation.fuel == 0.0 else x
        if relaxation.fuel == 0.0 and best > 0.0:
            return 0.0
        found = relaxation.bound(-size * ahead, 2.0 * size * slope / relaxation.time * ahead)
        best, count = max(best, found), count + 1
        return -found

    simplex = np.array(first) + np.vstack([np.zeros(len(first)), 0.08 * np.eye(len(first))])
    minimize(value, first, method="Nelder-Mead", options={
        "maxfev": _EVALUATIONS if len(first) > 1 else _EVALUATIONS // 3, "initial_simplex": simplex})
    return best, count


def _annealed(job: _Job, first: np.ndarray, limit: int | None, shifts: float = 0.1) -> np.ndarray | None:
    """Commands that arrive with at most so many pulses, replayed, from these on; None once time is up."""
    from rans.optimal.certificate.spatial_kernel import anneal

    lattice, goals, h = job.lattice, job.goal_set, job.lattice.period
    wrenches = np.array(lattice.craft.wrench_map) / np.repeat([lattice.craft.mass, lattice.moment], 3)
    products, squares = lattice.products, np.diag(lattice.products)
    same = (squares[:, None] == squares) & (np.abs(products) == squares)
    mates = np.where(same, np.sign(products), 0)
    mates[(squares[:, None] == 0) & (squares == 0)] = 1
    nodes, weights = np.polynomial.legendre.leggauss(3)
    rule = np.stack([0.5 * (nodes + 1.0), 0.5 * weights])
    radii = _INSIDE * np.array([goals.position, goals.velocity, goals.heading,
                                goals.spin if job.spins else math.inf])
    begin, end = (np.array([*x.p.columns(), *leaves(x.attitude.normalised()), *x.v.columns(), *x.w.columns()])
                  for x in (job.start, job.goal))
    deadline, attempt = time.process_time() + job.seconds, 0
    while time.process_time() < deadline:
        commands = first.copy()
        miss = anneal(commands, wrenches, mates, begin, end, np.maximum(radii, 1e-9), lattice.spin, h, rule,
                      commands.size if limit is None else limit, _FIRST_TRIES * 2 ** min(attempt, 4),
                      0.7, shifts, np.random.default_rng(attempt))
        if miss <= 0.0 and arrived(replay(lattice.craft, job.start, commands, h, _SUBSTEPS), job.goal, goals,
                                   job.spins):
            return commands
        attempt += 1
    return None
