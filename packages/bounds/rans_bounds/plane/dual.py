"""Lagrangian relaxation of the on/off problem: exact in attitude, dual in position and velocity.

For any costate the relaxation's value bounds from below what every on/off controller pays that ends in
the goal set. docs/bounds/certificate.md proves it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from types import ModuleType
from typing import Any

import numpy as np

from rans.extend import NonFiniteState, PlanarState, wrap
from rans_bounds.goal_set import GoalSet
from rans_bounds.plane.lattice import Lattice
from rans_bounds.problem import TooManyPoints

_EPSILON = float(np.finfo(np.float64).eps)
_MERGED = 3e-12
"""Patterns whose forces differ by less than 1e-12 of the largest, in x and in y, count as one."""
_HUGE = 1e200
"""A margin (which exceeds 1e-12 of any sum) from which on sums of costs might overflow, N s."""

_POINTS_PER_SECOND = 9e8
"""Lattice points that one sweep visits in a nominal second, a pattern each."""
_EVALUATION = 2e-3
"""Nominal seconds of an evaluation beside its points: the path, and the linear program that asked for it."""

_MOST_POINTS = 60_000_000
"""Points of the lattice, over all periods, at most: two tables of them take a gigabyte."""


@dataclass(frozen=True)
class Branch:
    """A part of the paths: heading indices low <= a < high per period and spin, patterns per period."""

    low: np.ndarray
    """(N + 1, spins) whole numbers, counted from the array's start."""
    high: np.ndarray
    patterns: np.ndarray
    """(N, P) whether a pattern may be used."""

    def at_most(self, k: int, a: int) -> Branch:
        """Branch of the paths whose heading index at period k does not exceed a."""
        high = self.high.copy()
        high[k] = np.maximum(self.low[k], np.minimum(high[k], a + 1))
        return replace(self, high=high)

    def above(self, k: int, a: int) -> Branch:
        """The other paths."""
        low = self.low.copy()
        low[k] = np.minimum(self.high[k], np.maximum(low[k], a + 1))
        return replace(self, low=low)

    def using(self, k: int, patterns: np.ndarray) -> Branch:
        """Branch of the paths that use one of these patterns, (P,) of truth values, in period k."""
        allowed = self.patterns.copy()
        allowed[k] &= patterns
        return replace(self, patterns=allowed)

    def range(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest index per period, (N + 1,) each; the lowest is above where none is left."""
        some = self.high > self.low
        lowest = np.where(some, self.low, np.iinfo(np.int64).max).min(axis=1)
        return lowest, np.where(some, self.high - 1, -1).max(axis=1)


@dataclass(frozen=True)
class DualValue:
    """Bound that one costate proves."""

    value: float
    """No path of the branch costs less; rounding is subtracted. N s, or m/s where fuel is free."""
    gradient: np.ndarray
    """(4,) a supergradient with respect to the costate."""
    costate: np.ndarray
    """(4,) multipliers of the final velocity (x, y) and position (x, y), N s per m/s and per m."""
    path: np.ndarray
    """(N,) the cheapest pattern of every period."""


class Relaxation:
    """The dual problem from one start to one goal, of floats, in N periods.

    With a cap, only controllers that burn at most this much fuel, N s, are looked at. The weight of the fuel
    is 1, or 0 to ask only whether the goal set can be reached. ``work`` counts what was computed so far, in
    nominal s (`rans_bounds.problem.SearchEffort`).

    Raises:
        TooManyPoints: the lattice is too large to search.
        ConfigError: no whole number of pulses ends with the goal's spin, a number is not finite, or numba
            is missing.
    """

    def __init__(
        self,
        lattice: Lattice,
        start: PlanarState,
        goal: PlanarState,
        goal_set: GoalSet,
        steps: int,
        cap: float | None,
        fuel: float = 1.0,
    ) -> None:
        self.lattice = lattice
        self.start = start
        self.goal = goal
        self.goal_set = goal_set
        self.steps = steps
        self.cap = cap
        self.fuel = fuel
        self.work = 0.0
        self.net = lattice.net_spins(goal_set, start, goal)
        from rans_bounds.plane import lattice_kernel  # compiles, with numba

        self._kernel: ModuleType = lattice_kernel
        self._tables(self._spin_limits())
        self._before, self._after = np.empty(self._shape), np.empty(self._shape)
        self._after[-1] = np.where(self._arrived(), 0.0, np.inf)
        self._before[0] = np.inf
        self._before[0, self._reach, self._origin] = 0.0

    def _spin_limits(self) -> np.ndarray:
        """(N + 1,) bounds of |n|: by the torque at hand before and after, and by the fuel to spend.

        They cut the search off: a spin that some flight within the cap may have must be inside.
        """
        k = np.arange(self.steps + 1)
        strongest = np.abs(self.lattice.patterns.torque).max()
        last = max(abs(n) for n in self.net)
        limit = np.minimum(strongest * k, strongest * (self.steps - k) + last)
        if self.cap is not None:
            bought = self.cap * self.lattice.quanta_per_fuel * (1 + 1e-12)
            limit = np.minimum(limit, int((bought + last) / 2))
        return limit

    def _tables(self, limits: np.ndarray) -> None:
        """Allocate tables over spin, angle and time within limits (periods,); `TooManyPoints` if too large."""
        lattice = self.lattice
        steps = self.steps
        h = self.lattice.period
        # Size of the tables: spin steps, angle steps and control periods that can be reached.
        self._reach = int(max(limits.max(), max(abs(n) for n in self.net)))
        widest = np.concatenate([[0], np.cumsum(limits[:-1])])
        self._origin = int(widest[-1])
        self._shape = (steps + 1, 2 * self._reach + 1, 2 * self._origin + 1)
        count = math.prod(self._shape)
        if count > _MOST_POINTS:
            raise TooManyPoints(
                f"a certificate over {steps} control periods of {h:g} s has {count:,} points, and at most "
                f"{_MOST_POINTS:,} are searched; the usual cause is a goal that is too far away, or a long "
                "horizon."
            )
        # The root of the search: every level of spin and angle within the limits, every pattern.
        n = np.arange(-self._reach, self._reach + 1)
        inside = np.abs(n) <= limits[:, None]
        self.everything = Branch(
            np.where(inside, self._origin - widest[:, None], 0),
            np.where(inside, self._origin + widest[:, None] + 1, 0),
            np.ones((steps, len(lattice.patterns.torque)), dtype=bool),
        )
        # Rotations of the thrust at every node, as complex numbers.
        angle = self.start.attitude.angle + self.start.w * h * np.arange(steps)[:, None]
        self._base = np.exp(1j * (angle + 0.5 * lattice.spin * h * n))
        self._turned = lattice.spin * h * (np.arange(self._shape[2]) - self._origin)
        self._responses = lattice.responses(self.start.w + lattice.spin * n)
        # Constants of the kernel; patterns are in ascending order of torque.
        patterns = lattice.patterns
        torques = lattice.torque_range
        firsts = np.searchsorted(patterns.torque, np.append(torques, torques[-1] + 1))
        self._constants = self._kernel.Tables(
            np.cos(self._turned),
            np.sin(self._turned),
            patterns.thrust,
            patterns.force,
            firsts,
            int(torques[0]),
            self._reach,
            self._origin,
        )

    def _arrived(self) -> np.ndarray:
        """(spins, headings) whether the last point is in the goal set."""
        n = np.arange(-self._reach, self._reach + 1)
        final = self.start.attitude.angle + self.start.w * self.steps * self.lattice.period
        heading = final + self._turned + 0.5 * self.lattice.spin * self.lattice.period * n[:, None]
        error = np.abs(wrap(heading - self.goal.attitude.angle))
        margin = self.lattice.drift(self.steps) + 1e-9
        return np.isin(n, list(self.net))[:, None] & (error <= self.goal_set.heading + margin)

    def _costs(self, costate: np.ndarray, branch: Branch) -> Any:
        """`lattice_kernel.Costs` of patterns under a costate (4,) of the final velocity and position.

        Numbers and order are those that the compiled kernel reads (`lattice_kernel.Costs`).
        """
        velocity = complex(*costate[:2])
        position = complex(*costate[2:])
        left = (self.steps - np.arange(self.steps)) * self.lattice.period
        first, second = self._responses
        pull = (
            np.conj(velocity + position * left)[:, None, None] * first - np.conj(position) * second
        )
        turns = self._base[:, :, None] * pull / self.lattice.craft.mass
        return self._kernel.Costs(
            self.fuel * self.lattice.period,
            turns,
            self._constants,
            branch.low,
            branch.high,
            branch.patterns,
        )

    def _sweep(self, costs: Any, value: np.ndarray, ahead: bool) -> None:
        """Fill a table of values, and count the work: every point of the branch, a pattern each."""
        points = np.maximum(costs.high - costs.low, 0).sum()
        self.work += _EVALUATION + points * len(self.lattice.patterns.torque) / _POINTS_PER_SECOND
        self._kernel.bellman(costs, value, ahead)

    def bound(self, costate: np.ndarray, branch: Branch) -> DualValue:
        """The dual function: its value is infinite where the branch holds no path.

        Whatever the costate, no path of the branch is cheaper than the value: `margin`, more than what rounding can
        add, is taken off. The table of costs to go is used again by the next call.

        Raises:
            NonFiniteState: by `margin`: numbers are too large, so that infinity might mean an overflow.
        """
        margin = self.margin(costate)
        costs = self._costs(costate, branch)
        self._sweep(costs, self._after, False)
        constant, slope = self.constant(costate)
        inside = branch.low[0, self._reach] <= self._origin < branch.high[0, self._reach]
        inner = self._after[0, self._reach, self._origin] if inside else np.inf
        if inner == np.inf:
            return DualValue(np.inf, np.zeros(4), costate, np.zeros(0, dtype=int))
        path = self._kernel.cheapest_patterns(costs, self._after)
        effect = np.array(self.effect(path)).view(float)  # real and imaginary parts are x and y
        return DualValue(constant + inner - margin, slope + effect, costate, path)

    def reachable(self) -> Branch:
        """All paths that end in the goal attitude within the cap."""
        limit = float(np.finfo(np.float64).max) if self.cap is None else self.cap * self.fuel
        return self.shrunk(np.zeros(4), self.everything, limit)

    def shrunk(self, costate: np.ndarray, branch: Branch, limit: float) -> Branch:
        """The branch without points through which every path's value exceeds the limit.

        Any costate will do; the better it is, the more is dropped.
        """
        margin = self.margin(costate)
        costs = self._costs(costate, branch)
        self._sweep(costs, self._after, False)
        self._sweep(costs, self._before, True)
        limit = limit - self.constant(costate)[0] + margin
        low, high = self._kernel.shrink(self._before, self._after, limit, branch.low, branch.high)
        return replace(branch, low=low, high=high)

    @cached_property
    def miss(self) -> np.ndarray:
        """(4,) final velocity (x, y) and position (x, y) without any thrust, from the goal's."""
        start = self.start
        goal = self.goal
        displacement = start.p + start.v.scale(self.steps * self.lattice.period) - goal.p
        return np.array(
            [start.v.x - goal.v.x, start.v.y - goal.v.y, displacement.x, displacement.y]
        )

    def constant(self, costate: np.ndarray) -> tuple[float, np.ndarray]:
        """Part of the dual function beside the inner minimum under a costate (4,), and its supergradient (4,).

        `bound`, `shrunk` and `rans_bounds.plane.onoff` add the same number to their inner minimum.
        """
        value = float(costate @ self.miss)
        slope = self.miss.copy()
        for part, radius in (
            (slice(2), self.goal_set.velocity),
            (slice(2, 4), self.goal_set.position),
        ):
            size = float(np.linalg.norm(costate[part]))
            value -= radius * size
            slope[part] -= radius * costate[part] / size if size > 0 else 0.0
        return value, slope

    def points(self, path: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Spin and heading indices n_k and a_k of a path of patterns, (N + 1,) each."""
        n = np.concatenate([[0], np.cumsum(self.lattice.patterns.torque[path])])
        return n, np.concatenate([[0], np.cumsum(n[:-1])])

    def heading_indices(self, path: np.ndarray) -> np.ndarray:
        """(N + 1,) indices of a path, as branches count them."""
        return self.points(path)[1] + self._origin

    def inside(self, path: np.ndarray, branch: Branch) -> bool:
        """Whether a path (T,) of patterns belongs to the branch: points and patterns alike."""
        n, a = self.points(path)
        k = np.arange(self.steps + 1)
        i = n + self._reach
        a = a + self._origin
        return bool(
            np.all((branch.low[k, i] <= a) & (a < branch.high[k, i]))
            and branch.patterns[k[:-1], path].all()
        )

    def effects(self, path: np.ndarray, patterns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Final velocity and position that patterns would add along the attitudes of a path (N,).

        The patterns, (N,) or (N, M), have the net torques of the path's. Two complex arrays like them, m/s
        and m in W.
        """
        n, a = self.points(path)
        k = np.arange(self.steps)
        i = n[:-1] + self._reach
        t = self.lattice.patterns.torque[path] - self.lattice.torque_range[0]
        turn = (
            self._base[k, i]
            * np.exp(1j * self._turned[a[:-1] + self._origin])
            / self.lattice.craft.mass
        )
        speed = turn * self._responses[0][i, t]
        response = (self.steps - k) * self.lattice.period * speed - turn * self._responses[1][i, t]
        force = self.lattice.patterns.force[patterns].T
        return (force * speed).T, (force * response).T

    def effect(self, path: np.ndarray) -> tuple[complex, complex]:
        """Final velocity and position that a path adds, m/s and m in W as complex numbers."""
        gained, displacement = self.effects(path, path)
        return complex(gained.sum()), complex(displacement.sum())

    def margin(self, costate: np.ndarray) -> float:
        """More than rounding and inexact torques can change a value by, at a costate (4,)."""
        h = self.lattice.period
        mass = self.lattice.craft.mass
        time = self.steps * self.lattice.period
        pull = float(np.linalg.norm(costate[:2]) + time * np.linalg.norm(costate[2:])) / mass
        stage = h * float(sum(self.lattice.forces)) * (self.fuel + pull)
        angle = (
            abs(self.start.attitude.angle)
            + abs(self.start.w) * time
            + self.lattice.spin * h * (self._origin + self._reach)
        )
        rounding = _EPSILON * (64.0 + 8.0 * angle + 2.0 * self.steps)
        relative = _MERGED + rounding + self.lattice.drift(self.steps)
        result = self.steps * stage * relative + 16.0 * _EPSILON * float(
            np.abs(costate) @ np.abs(self.miss)
        )
        if not result < _HUGE:
            raise NonFiniteState(
                "a bound of fuel or time would overflow; the usual cause is a start, goal "
                "or spacecraft with far too large numbers."
            )
        return result
