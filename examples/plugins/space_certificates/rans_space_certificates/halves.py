"""Exclusion of fuel levels by enumeration: no flight of K pulses arrives if no two half flights match.

Until its first pulse a craft at rest has the start's attitude, after its last pulse the goal's, and in between
every pulse adds a known spin. So there are finitely many flights of K pulses, and each half of a flight, from the
start or backwards from the goal, is computed exactly. Only halves that gain enough velocity along the displacement
can be part of a solution, given the best that the other half can gain; these are at most some hundred thousand.
If none from the start matches one from the goal in spin, attitude, velocity and position, there is no flight.
docs/bounds/certificate.md has the proof.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from rans_bounds.goal_set import GoalSet

from rans.extend import SpatialState, leaves
from rans_space_certificates.reach import SpinLattice

_MOST_HALVES = 2_000_000
"""Halves in memory at most, 0.2 GB; where there are more, the level is not excluded."""
_COMPARED_AT_ONCE = 10_000
"""Halves from the goal that are compared with all from the start at a time, so that matches fit in memory."""
_MOST_PULSES = 12
"""Largest level: the number of halves grows exponentially with it."""
_MOST_THRUSTERS = 16
"""Thrusters of a craft at most, since their patterns are enumerated."""
_SEARCH_STEP = 0.05
"""Step of the search for the largest gain of a half, in velocities of a pulse."""
_SEARCH_STEPS = 12
"""Steps of that search at most."""
_INTEGRATION_ERROR = 2e-4
"""Widening of the tolerances, rad: attitudes of the kernel are off by some 1e-5."""
_WEIGHT_SLOPES = (0.0, 0.2, -0.2, 0.4, -0.4)
"""Slopes of the weight 1 + slope of a push in the first half and 1 - slope in the second, each below 0.5.

Every slope gives a valid bound; which is sharp depends on how pulses are split between the halves.
"""
_MOST_WASTED = 1.0
"""Surplus of the largest gains, in pulses, up to which halves are enumerated: with more there are too many."""
_MOST_ROTATION = 0.75
"""Rotation by the fastest spin in a period, rad, up to which `_INTEGRATION_ERROR` holds."""


@dataclass(frozen=True, eq=False)
class _End:
    """Beginning of a half flight: the start, or the goal, from which time runs backwards."""

    attitude: np.ndarray
    """(4,) quaternion of B in W, (w, x, y, z)."""
    direction: np.ndarray
    """(3,) unit vector in W along which pushes gain velocity."""
    sign: float
    """1 at the start and -1 at the goal: sign of the weight's slope."""
    tolerance: float
    """Tolerance of the attitude at this end, rad."""


class HalfTrajectories:
    """Half flights from rest, and to rest, in an even number of periods, with thrusters of equal force.

    Args:
        lattice: spins of the craft.
        aims: what the goal asks, such as "position".
        start: of the flight.
        goal: of the flight.
        goal_set: tolerances of the goal.
        steps: control periods of the flight.
    """

    def __init__(
        self,
        lattice: SpinLattice,
        aims: Collection[str],
        start: SpatialState,
        goal: SpatialState,
        goal_set: GoalSet,
        steps: int,
    ) -> None:
        self._lattice = lattice
        self._steps = steps
        self._time = steps * lattice.period
        self._speed = lattice.craft.thrusters[0].force * lattice.period / lattice.craft.mass
        """Change of velocity by one pulse, m/s."""
        # Goal set, enlarged by the error of integration over the longest flight.
        fastest = _MOST_PULSES * self._speed
        self._radii = np.array(
            [goal_set.position, goal_set.velocity, goal_set.heading]
        ) + _INTEGRATION_ERROR * np.array([fastest * self._time, fastest, 1.0])
        self._displacement = np.array((goal.p - start.p - start.v.scale(self._time)).columns())
        self._velocity_change = np.array((goal.v - start.v).columns())
        direction = self._displacement / max(float(np.linalg.norm(self._displacement)), 1e-300)
        # Both ends of the flight, seen along the displacement.
        attitudes = [np.array(leaves(x.attitude.normalised())) for x in (start, goal)]
        self._ends = (
            _End(attitudes[0], direction, 1.0, 0.0),
            _End(attitudes[1], -direction, -1.0, float(self._radii[2])),
        )
        # The halves meet in the middle: an even number of steps, at rest at both ends.
        self._is_applicable = (
            lattice.pulse is not None
            and steps % 2 == 0
            and not any(start.w.columns())
            and not any(goal.w.columns())
            and lattice.final_levels(aims, start, goal_set) == range(1)
            and lattice.craft.thruster_count <= _MOST_THRUSTERS
        )
        self._largest_gains: dict[tuple[_End, int, float], float] = {}

    def exclude(self, pulses: int) -> bool:
        """Whether it is proved that no flight of exactly this number of pulses arrives; false: not proved."""
        rotation = pulses * self._lattice.spin * self._lattice.period
        return (
            self._is_applicable
            and pulses <= _MOST_PULSES
            and rotation <= _MOST_ROTATION
            and all(
                self._cannot_meet(first, pulses - first)
                for first in sorted(range(pulses + 1), key=lambda k: abs(2 * k - pulses))
            )
        )

    def _gain_needed(self, slope: float) -> float:
        """Weighted velocity, m/s, that the halves of a solution gain together at least (`halves_kernel.gained`)."""
        direction = self._ends[0].direction
        (position, velocity, _) = self._radii
        return float(
            2.0 / self._time * (self._displacement @ direction - position)
            - (1.0 - slope) * (self._velocity_change @ direction + velocity)
        )

    def _cannot_meet(self, first: int, second: int) -> bool:
        """Whether it is proved that no half with ``first`` pulses matches one with ``second`` pulses.

        Cheap bounds come first: perfect pushes, then the largest gain of each half, then all matching halves.
        """
        start, goal = self._ends
        for slope in _WEIGHT_SLOPES:
            perfect = self._speed * (first * (1.0 + slope) + second * (1.0 - slope))
            if perfect < self._gain_needed(slope):
                return True
        # The largest gains of real halves, and their surplus over what is needed.
        slacks = {}
        for slope in _WEIGHT_SLOPES:
            bounds = self._most_gained(start, first, slope), self._most_gained(goal, second, slope)
            slacks[slope] = sum(bounds) - self._gain_needed(slope)
            if slacks[slope] < 0.0:
                return True
        # All matching halves, with the slope that leaves fewest of either kind.
        slope = min(slacks, key=lambda x: slacks[x] / (1.0 - abs(x)))
        if slacks[slope] > _MOST_WASTED * self._speed * (1.0 - abs(slope)):
            return False
        from_start = self._halves(
            start, first, slope, self._gain_needed(slope) - self._most_gained(goal, second, slope)
        )
        if from_start is None:
            return False
        from_goal = self._halves(
            goal, second, slope, self._gain_needed(slope) - self._most_gained(start, first, slope)
        )
        return from_goal is not None and not self._any_match(from_start, from_goal)

    def _most_gained(self, end: _End, pulses: int, slope: float) -> float:
        """Upper bound of the weighted velocity that a half with so many pulses gains, m/s."""
        if pulses == 0:
            return 0.0
        if (end, pulses, slope) not in self._largest_gains:
            per_pulse = (1.0 + end.sign * slope) * self._speed
            largest = pulses * per_pulse
            # Lower the level from that of one pulse less, step by step, until some half gains so much.
            halves = None
            upper_bound = self._most_gained(end, pulses - 1, slope) + per_pulse
            for gain_needed in upper_bound - _SEARCH_STEP * self._speed * np.arange(
                1, _SEARCH_STEPS
            ):
                halves = self._halves(end, pulses, slope, float(gain_needed))
                if halves is None or len(halves):
                    break
                largest = float(gain_needed)
            # These are all that gain so much: the bound is exact.
            if halves is not None and len(halves):
                largest = self._gained(halves, end, slope)
            self._largest_gains[end, pulses, slope] = largest
        return self._largest_gains[end, pulses, slope]

    def _gained(self, states: np.ndarray, end: _End, slope: float) -> float:
        from rans_space_certificates.halves_kernel import gained

        arguments = (0.5 * self._time, end.direction, self._time, end.tolerance, end.sign * slope)
        return max(gained(state, *arguments) for state in states)

    def _halves(
        self, end: _End, pulses: int, slope: float, gain_needed: float
    ) -> np.ndarray | None:
        """States (n, 13) in mid-flight of all halves that gain ``gain_needed``, m/s; None if they are too many.

        A breadth-first search: every iteration adds one pattern of thrusters to all unfinished halves.
        """
        from rans_space_certificates.halves_kernel import continue_halves

        finished = []
        states = np.zeros((1, 13))
        periods = np.zeros(1, np.int64)
        pulses_left = np.full(1, pulses)
        states[0, 3:7] = end.attitude
        if pulses == 0:
            return states
        patterns, sizes = self._patterns(pulses, gain_needed, 1.0 + end.sign * slope)
        while len(states):
            buffers = (
                np.empty((_MOST_HALVES, 13)),
                np.empty(_MOST_HALVES, np.int64),
                np.empty(_MOST_HALVES, np.int64),
            )
            count = continue_halves(
                states,
                periods,
                pulses_left,
                half=self._steps // 2,
                patterns=patterns,
                sizes=sizes,
                direction=end.direction,
                flight=self._time,
                tolerance=end.tolerance,
                slope=end.sign * slope,
                h=self._lattice.period,
                quadrature=gauss(),
                pulse=self._speed,
                gain_needed=gain_needed,
                new_states=buffers[0],
                new_periods=buffers[1],
                new_pulses_left=buffers[2],
            )
            if count < 0:
                return None
            states, periods, pulses_left = (table[:count] for table in buffers)
            finished.append(states[pulses_left == 0])
            states, periods, pulses_left = (
                table[pulses_left > 0] for table in (states, periods, pulses_left)
            )
        return np.concatenate(finished)

    def _patterns(
        self, pulses: int, gain_needed: float, weight: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Accelerations (P, 6) of thruster patterns that may occur in a half, and their pulses (P,)."""
        craft = self._lattice.craft
        wrenches = np.array(craft.wrench_map) / np.repeat([craft.mass, self._lattice.moment], 3)
        rows = []
        sizes = []
        for size in range(1, pulses + 1):
            sums = np.array(
                [
                    wrenches[list(chosen)].sum(axis=0)
                    for chosen in itertools.combinations(range(len(wrenches)), size)
                ]
            ).reshape(-1, 6)
            push = self._lattice.period * np.linalg.norm(sums[:, :3], axis=1)
            sums = sums[weight * (push + (pulses - size) * self._speed) >= gain_needed - 1e-9]
            # Patterns of equal accelerations give equal flights.
            _, index = np.unique(np.round(sums, 9), axis=0, return_index=True)
            rows.append(sums[index])
            sizes.append(np.full(len(index), size))
        return np.concatenate(rows), np.concatenate(sizes)

    def _any_match(self, from_start: np.ndarray, from_goal: np.ndarray) -> bool:
        """Whether a half from the start and one backwards from the goal form a flight that arrives.

        Velocities and spins of the halves from the goal are reversed, since their time runs backwards.

        Args:
            from_start: (n, 13) states in the middle.
            from_goal: (m, 13) states in the middle.
        """
        from scipy.spatial import KDTree

        quantum = self._lattice.spin
        half_time = 0.5 * self._time
        # Neighbours in attitude and spin: spins are on a lattice, so they are equal or at least a quantum apart.
        radius = 2.0 * math.sin(0.25 * self._radii[2]) + 1e-9
        tree = KDTree(np.hstack([from_start[:, 3:7], from_start[:, 10:] / quantum]))
        conjugate = from_goal[:, 3:7] * [1.0, -1.0, -1.0, -1.0]
        # Velocity and position that the second half adds, in B at the middle.
        velocity_added = rotate_each(conjugate, from_goal[:, 7:10])
        position_added = rotate_each(conjugate, from_goal[:, 7:10] * half_time - from_goal[:, :3])
        for sign, begin in itertools.product(
            (1.0, -1.0), range(0, len(from_goal), _COMPARED_AT_ONCE)
        ):
            indices = np.arange(begin, min(begin + _COMPARED_AT_ONCE, len(from_goal)))
            keys = np.hstack([sign * from_goal[indices, 3:7], -from_goal[indices, 10:] / quantum])
            neighbours = tree.query_ball_point(keys, radius)
            j = np.repeat(indices, [len(near) for near in neighbours])
            i = np.concatenate([np.array(near, dtype=np.int64) for near in neighbours])
            halves = from_start[i]
            velocity_error = (
                halves[:, 7:10]
                + rotate_each(halves[:, 3:7], velocity_added[j])
                - self._velocity_change
            )
            position_error = (
                halves[:, :3]
                + half_time * halves[:, 7:10]
                + rotate_each(halves[:, 3:7], position_added[j])
                - self._displacement
            )
            if (
                (np.linalg.norm(velocity_error, axis=1) <= self._radii[1])
                & (np.linalg.norm(position_error, axis=1) <= self._radii[0])
            ).any():
                return True
        return False


def rotate_each(q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Rotate vectors (n, 3) by unit quaternions (n, 4), row by row."""
    across = 2.0 * np.cross(q[:, 1:], v)
    return v + q[:, :1] * across + np.cross(q[:, 1:], across)


def gauss() -> np.ndarray:
    """Gauss-Legendre quadrature, (2, 3): nodes and weights on (0, 1)."""
    nodes, weights = np.polynomial.legendre.leggauss(3)
    return np.stack([0.5 * (nodes + 1.0), 0.5 * weights])
