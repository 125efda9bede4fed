"""Certified least fuel and time in space: `reach` has the bound.

There is no branching: the bound is the dual value alone, rounded up to whole periods and pulses.
"""

from __future__ import annotations

import math

import numpy as np
from rans_bounds import hull
from rans_bounds.flight import state_after
from rans_bounds.goal_set import GoalSet
from rans_bounds.problem import Found, Problem, SearchEffort, Unreachable

from rans.extend import Spacecraft, SpatialState, rounded_up
from rans_space_certificates.halves import HalfTrajectories
from rans_space_certificates.reach import ReachRelaxation, SpinLattice

_EVALUATIONS = 24
"""Evaluations of the dual function at most, 0.3 s each for 100 periods."""


class SpatialBounder:
    """Bounds on/off control in space by the dual value alone, and finds no commands.

    See `rans_bounds.certificate.Bounder`.
    """

    def __init__(self, lattice: SpinLattice) -> None:
        self.lattice = lattice

    @property
    def craft(self) -> Spacecraft:
        """Spacecraft that the bounds are of."""
        return self.lattice.craft

    @property
    def period(self) -> float:
        """Control period, s."""
        return self.lattice.period

    def contains(self, problem: Problem) -> bool:
        """See `Bounder`."""
        start, goal, goal_set, aims = problem
        return is_in_goal_set(start, goal, goal_set, "spin" in aims)

    def can_stop(self, problem: Problem) -> bool:
        """See `Bounder`; goals that spin have no bound either."""
        start, goal, goal_set, aims = problem
        return self.lattice.can_end_at_rest(aims, start, goal, goal_set)

    def least_fuel(self, problem: Problem, steps: int, effort: SearchEffort) -> Found:
        """See `Bounder`; the `ConfigError` is that of `ReachRelaxation`."""
        start, goal, goal_set, aims = problem
        lattice = self.lattice

        # The better one of the dual's and the hull's, and levels that halves exclude.
        relaxation = ReachRelaxation(lattice, aims, start, goal, goal_set, steps)
        loose = hull.least_fuel(lattice.craft, aims, start, goal, relaxation.time, goal_set)
        if math.isinf(loose):
            raise Unreachable.after(steps, lattice.period)
        dual = _raised(relaxation, (1.04, 1.04))
        lower = lattice.next_fuel(max(loose, dual), relaxation.final_levels)
        halves = HalfTrajectories(lattice, aims, start, goal, goal_set, steps)
        while lattice.pulse is not None and halves.exclude(round(lower / lattice.pulse)):
            lower = lattice.next_fuel(lower + lattice.pulse, relaxation.final_levels)
        # A coast that arrives needs no commands, and no others are looked for.
        nothing = np.zeros((steps, len(lattice.products)), dtype=np.int64)
        final = state_after(lattice.craft, start, nothing, lattice.period, 1)
        coasts = is_in_goal_set(final, goal, goal_set, "spin" in aims)
        return Found(lower, nothing if coasts else None)

    def least_time(self, problem: Problem, most_steps: int, effort: SearchEffort) -> Found:
        """See `Bounder`; the `ConfigError` is that of `ReachRelaxation`."""
        start, goal, goal_set, aims = problem
        lattice = self.lattice
        h = lattice.period

        # The first number of periods that neither the hull nor the dual excludes.
        loose = rounded_up(hull.least_time(lattice.craft, aims, start, goal, goal_set), h)
        lower = max(1, round(loose / h))
        while lower <= most_steps:
            relaxation = ReachRelaxation(lattice, aims, start, goal, goal_set, lower, 0.0)
            if _raised(relaxation, (1.0,)) <= 0.0:
                break
            lower += 1
        return Found(lower * h, None)


def spatial_bounder(craft: Spacecraft, period: float) -> SpatialBounder:
    """Bounder of a craft in space whose commands are held for a period, s.

    Raises:
        ConfigError: see `SpinLattice`.
    """
    return SpatialBounder(SpinLattice(craft, period))


def is_in_goal_set(
    state: SpatialState, goal: SpatialState, goal_set: GoalSet, rest_asked: bool
) -> bool:
    """Whether a state of floats is in the goal set; its spin counts where ``rest_asked``."""
    spin = np.linalg.norm(np.subtract(state.w.columns(), goal.w.columns()))
    return bool(
        (goal.p - state.p).norm() <= goal_set.position
        and (goal.v - state.v).norm() <= goal_set.velocity
        and state.attitude.normalised().to(goal.attitude.normalised()).magnitude()
        <= goal_set.heading
        and (not rest_asked or spin <= goal_set.spin + 1e-9)
    )


def _raised(relaxation: ReachRelaxation, first: tuple[float, ...]) -> float:
    """A high bound among costates along the way; for time the first above 0.

    Pulls along the way by x (y (T - t) 2 / T - 1), in the units of the mass: x = y = 1 is the dual optimum of
    a straight flight of least fuel. Where fuel is free only y matters.
    """
    from scipy.optimize import minimize

    displacement = (
        relaxation.displacement if relaxation.displacement.any() else relaxation.velocity_change
    )
    ahead = displacement / max(float(np.linalg.norm(displacement)), 1e-300)
    best = -math.inf

    # Costates along the displacement: their size (only for fuel), and the slope over time.
    def value(x: np.ndarray) -> float:
        nonlocal best
        size, slope = (1.0, x[0]) if relaxation.fuel == 0.0 else x
        if relaxation.fuel == 0.0 and best > 0.0:
            return 0.0
        result = relaxation.bound(-size * ahead, 2.0 * size * slope / relaxation.time * ahead)
        best = max(best, result)
        return -result

    # Every value is a valid bound, so that the search needs no accuracy.
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
    return best
