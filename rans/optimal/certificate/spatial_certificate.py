"""What no on/off controller can beat in space, and controls that come near: see `spatial` for the bound.

There is no branching: the bound is the dual value alone, rounded up to whole periods and pulses. Controls are
looked for from more fuel than needed downwards, and from the least time upwards: see `spatial_search`.
"""

from __future__ import annotations

import math
import time
from collections.abc import Collection
from dataclasses import replace

import numpy as np

from rans.model.dynamics import SpatialState
from rans.optimal.certificate import hull
from rans.optimal.certificate.certificate import Certificate, Effort, Unreachable, check_steps
from rans.optimal.certificate.halves import Halves
from rans.optimal.certificate.lattice import GoalSet, rounded_up
from rans.optimal.certificate.onoff import fuel
from rans.optimal.certificate.spatial import ReachRelaxation, SpinLattice
from rans.optimal.certificate.spatial_search import Wanted, arrived, in_time, with_pulses
from rans.optimal.certificate.spatial_shares import throttled

_INNER = (0.4, 1.0)
"""Shares of the tolerances that throttled thrust keeps to, the first that it can: rounding then may miss."""
_LEVELS = 10
"""Numbers of periods whose processor time one search may take, throttled thrust with it."""
_EVALUATIONS = 24
"""Of the dual function, at most, 0.3 s each for 100 periods."""


def least_fuel(
    lattice: SpinLattice,
    aims: Collection[str],
    start: SpatialState,
    goal: SpatialState,
    steps: int,
    goal_set: GoalSet,
    effort: Effort,
) -> Certificate:
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
        raise Unreachable(
            f"no on/off controller can reach the goal set in {steps} control periods of "
            f"{lattice.period:g} s; the usual cause is too short a time."
        )
    dual, nodes = _raised(relaxation, (1.04, 1.04))
    dual = max(loose, dual)
    lower = lattice.next_fuel(dual, relaxation.last)
    halves = Halves(lattice, aims, start, goal, goal_set, steps)
    while lattice.pulse is not None and halves.exclude(round(lower / lattice.pulse)):
        lower = lattice.next_fuel(lower + lattice.pulse, relaxation.last)
    wanted = Wanted(lattice, start, goal, goal_set, "spin" in aims, effort.seconds)
    found = _fewer(
        wanted, steps, _pulses(lattice, lower), 2 if lattice.settled(relaxation.last) else 1
    )
    upper = math.inf if found is None else fuel(lattice.craft, found, lattice.period)
    commands = found if upper > 0.0 else None
    return Certificate(lower, upper, commands, dual, nodes, time.monotonic() - began)


def _fewer(wanted: Wanted, steps: int, least: int, pair: int) -> np.ndarray | None:
    """Commands of few pulses that arrive: some more than throttled thrust needs, then ever fewer or more."""
    best = throttled(wanted.lattice, wanted.start, wanted.goal, wanted.goal_set, steps)
    shares = [one.shares for one in best] or [np.ones((steps, len(wanted.wrenches)))]
    first = max(least, _pulses(wanted.lattice, best[0].fuel)) if best else math.ceil(1.5 * least)
    pulses = least + pair * math.ceil((first - least) / pair) + pair
    found = None
    while pulses >= least:
        better = with_pulses(wanted, steps, pulses, shares)
        if better is None and (found is not None or pulses >= 3 * least + 4 * pair):
            break
        found = better
        pulses += pair * max(1, math.ceil(0.25 * least / pair)) if found is None else -pair
    return found


def _pulses(lattice: SpinLattice, lower: float) -> int:
    """Fewest pulses of that fuel."""
    strongest = max(thruster.force for thruster in lattice.craft.thrusters)
    return math.ceil(lower / (strongest * lattice.period) - 1e-9)


def least_time(
    lattice: SpinLattice,
    aims: Collection[str],
    start: SpatialState,
    goal: SpatialState,
    most_steps: int,
    goal_set: GoalSet,
    effort: Effort,
) -> Certificate:
    """Least time in which any on/off controller can be in the goal set, up to so many control periods.

    Raises:
        ConfigError: see `ReachRelaxation`.
    """
    check_steps(most_steps)
    began = time.monotonic()
    h = lattice.period
    if arrived(start, goal, goal_set, "spin" in aims):
        return Certificate(0.0, 0.0, None, 0.0, 0, 0.0)
    loose = rounded_up(hull.least_time(lattice.craft, aims, start, goal, goal_set), h)
    lower = max(1, round(loose / h))
    nodes = 0
    while lower <= most_steps:
        value, count = _raised(
            ReachRelaxation(lattice, aims, start, goal, goal_set, lower, 0.0), (1.0,)
        )
        nodes += count
        if value <= 0.0:
            break
        lower += 1
    wanted = Wanted(lattice, start, goal, goal_set, "spin" in aims, effort.seconds)
    found = _soonest(wanted, lower, most_steps)
    upper = math.inf if found is None else len(found) * h
    return Certificate(lower * h, upper, found, loose, nodes, time.monotonic() - began)


def _soonest(wanted: Wanted, least: int, most: int) -> np.ndarray | None:
    """Commands that arrive after the fewest periods for which some are found, from the least on.

    None once time is up.
    """
    deadline = time.process_time() + _LEVELS * wanted.seconds
    for steps in range(least, most + 1):
        if time.process_time() > deadline:
            break
        tries = (
            throttled(
                wanted.lattice, wanted.start, wanted.goal, _inner(wanted.goal_set, share), steps
            )
            for share in _INNER
        )
        shares = [one.shares for one in next(filter(None, tries), [])]
        found = in_time(wanted, shares) if shares else None
        if found is not None:
            return found
    return None


def _inner(goal_set: GoalSet, share: float) -> GoalSet:
    return replace(
        goal_set,
        position=share * goal_set.position,
        velocity=share * goal_set.velocity,
        heading=share * goal_set.heading,
    )


def _raised(relaxation: ReachRelaxation, first: tuple[float, ...]) -> tuple[float, int]:
    """A high bound among costates along the way, and how many were tried; for time the first above 0.

    Pulls along the way by x (y (T - t) 2 / T - 1), in the units of the mass: x = y = 1 is the dual optimum of
    a straight flight of least fuel. Where fuel is free only y matters.
    """
    from scipy.optimize import minimize

    way = relaxation.way if relaxation.way.any() else relaxation.gain
    ahead = way / max(float(np.linalg.norm(way)), 1e-300)
    best = -math.inf
    count = 0

    def value(x: np.ndarray) -> float:
        nonlocal best, count
        size, slope = (1.0, x[0]) if relaxation.fuel == 0.0 else x
        if relaxation.fuel == 0.0 and best > 0.0:
            return 0.0
        found = relaxation.bound(-size * ahead, 2.0 * size * slope / relaxation.time * ahead)
        best = max(best, found)
        count = count + 1
        return -found

    simplex = np.array(first) + np.vstack([np.zeros(len(first)), 0.08 * np.eye(len(first))])
    minimize(
        value,
        first,
        method="Nelder-Mead",
        options={
            "maxfev": _EVALUATIONS if len(first) > 1 else _EVALUATIONS // 3,
            "initial_simplex": simplex,
        },
    )
    return best, count
