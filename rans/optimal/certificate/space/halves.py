"""Levels of fuel that no flight of few pulses reaches: all of them, by their halves.

Until its first pulse a craft at rest has its start's attitude, after its last one the goal's, and in between
every pulse turns it on by a known spin. So flights of K pulses are finitely many, and half of one, flown
from the start or backwards from the goal, is known exactly. Those that gain enough along the way, each for
what the best other half leaves, are at most some hundred thousand. Where none from the start meets one from
the goal, with its spin, attitude, speed and place, there is no flight. docs/certificate.md proves it.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from rans.model.dynamics import SpatialState
from rans.model.fields import leaves
from rans.optimal.certificate.goal_set import GoalSet
from rans.optimal.certificate.space.reach import SpinLattice
from rans.optimal.certificate.space.search import gauss

_ROOM = 2_000_000
"""Halves kept at most, 0.2 GB; more prove nothing."""
_PART = 10_000
"""Halves compared with all others at a time."""
_MOST_PULSES = 12
_MOST_THRUSTERS = 16
"""Thrusters of a craft at most, as their patterns are listed one by one; also levels at most."""
_STEP = 0.05
_STEPS = 12
"""Steps of the search for the best half, pulses."""
_ASKEW = 2e-4
"""Widening of the tolerances, rad: flights of the kernel are turned off by some 1e-5."""
_LEANS = (0.0, 0.2, -0.2, 0.4, -0.4)
"""How much more a push counts in the first half than in the second, to look at splits from: below 0.5."""
_SLACK = 1.0
"""Pulses that may be wasted in a flight, at most, for its halves to be listed: more of them have no room."""
_TURN = 0.75
"""Angle that the fastest spin may turn in a period, rad, for the kernel to be so good."""


@dataclass(frozen=True, eq=False)
class _End:
    """Beginning of one half: the start, or the goal, from which time runs backwards."""

    attitude: np.ndarray
    """(4,) quaternion."""
    ahead: np.ndarray
    """(3,) unit vector in W along which its pulses should push."""
    sign: float
    """Sign, 1 or -1, also of the leans of `HalfTrajectories`, since time runs backwards from the goal."""
    tilt: float
    """Tolerance of the attitude, rad."""


class HalfTrajectories:
    """Flights from rest to rest in an even number of periods, of thrusters that are equally strong."""

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
        """Gained by one pulse, m/s."""
        fastest = _MOST_PULSES * self._speed
        self._radii = np.array(
            [goal_set.position, goal_set.velocity, goal_set.heading]
        ) + _ASKEW * np.array([fastest * self._time, fastest, 1.0])
        self._way = np.array((goal.p - start.p - start.v.scale(self._time)).columns())
        self._gain = np.array((goal.v - start.v).columns())
        ahead = self._way / max(float(np.linalg.norm(self._way)), 1e-300)
        attitudes = [np.array(leaves(x.attitude.normalised())) for x in (start, goal)]
        self._ends = (
            _End(attitudes[0], ahead, 1.0, 0.0),
            _End(attitudes[1], -ahead, -1.0, float(self._radii[2])),
        )
        self._able = (
            lattice.pulse is not None
            and steps % 2 == 0
            and not any(start.w.columns())
            and not any(goal.w.columns())
            and lattice.final(aims, start, goal_set) == range(1)
            and len(lattice.craft.thrusters) <= _MOST_THRUSTERS
        )
        self._best: dict[tuple[_End, int, float], float] = {}

    def exclude(self, pulses: int) -> bool:
        """Whether it is shown that no flight of just so many pulses arrives."""
        turn = pulses * self._lattice.spin * self._lattice.period
        return (
            self._able
            and pulses <= _MOST_PULSES
            and turn <= _TURN
            and all(
                self._apart(first, pulses - first)
                for first in sorted(range(pulses + 1), key=lambda k: abs(2 * k - pulses))
            )
        )

    def _needed(self, lean: float) -> float:
        """Velocity that both halves gain together at least, m/s, see `halves_kernel.gained`."""
        ahead = self._ends[0].ahead
        (position, velocity, _) = self._radii
        return float(
            2.0 / self._time * (self._way @ ahead - position)
            - (1.0 - lean) * (self._gain @ ahead + velocity)
        )

    def _apart(self, first: int, second: int) -> bool:
        """Whether it is shown that no half of the first pulses meets one of the second.

        What weighs pushes differently in the two halves shows it soonest where they have unequal numbers.
        """
        start, goal = self._ends
        for lean in _LEANS:
            perfect = self._speed * (first * (1.0 + lean) + second * (1.0 - lean))
            if perfect < self._needed(lean):
                return True
        slacks = {}
        for lean in _LEANS:
            most = self._most(start, first, lean), self._most(goal, second, lean)
            slacks[lean] = sum(most) - self._needed(lean)
            if slacks[lean] < 0.0:
                return True
        lean = min(slacks, key=lambda x: slacks[x] / (1.0 - abs(x)))  # few halves of either kind
        if slacks[lean] > _SLACK * self._speed * (1.0 - abs(lean)):
            return False
        before = self._all(start, first, lean, self._needed(lean) - self._most(goal, second, lean))
        if before is None:
            return False
        after = self._all(goal, second, lean, self._needed(lean) - self._most(start, first, lean))
        return after is not None and not self._meet(before, after)

    def _most(self, end: _End, pulses: int, lean: float) -> float:
        """Velocity that so many pulses of a half gain at most, m/s, or a little more."""
        if pulses == 0:
            return 0.0
        if (end, pulses, lean) not in self._best:
            perfect = (1.0 + end.sign * lean) * self._speed
            most = pulses * perfect
            found = None
            first = self._most(end, pulses - 1, lean) + perfect
            for least in first - _STEP * self._speed * np.arange(1, _STEPS):
                found = self._all(end, pulses, lean, float(least))
                if found is None or len(found):
                    break
                most = float(least)
            if found is not None and len(found):  # as these are all that gain so much
                most = self._gained(found, end, lean)
            self._best[end, pulses, lean] = most
        return self._best[end, pulses, lean]

    def _gained(self, result: np.ndarray, end: _End, lean: float) -> float:
        from rans.optimal.certificate.space.halves_kernel import gained

        how = (0.5 * self._time, end.ahead, self._time, end.tilt, end.sign * lean)
        return max(gained(one, *how) for one in result)

    def _all(self, end: _End, pulses: int, lean: float, least: float) -> np.ndarray | None:
        """(n, 13) states in the middle of all halves that gain so much; None if they are too many."""
        from rans.optimal.certificate.space.halves_kernel import followed

        h = self._lattice.period
        ended = []
        states = np.zeros((1, 13))
        periods = np.zeros(1, np.int64)
        left = np.full(1, pulses)
        states[0, 3:7] = end.attitude
        if pulses == 0:
            return states
        patterns, sizes = self._patterns(pulses, least, 1.0 + end.sign * lean)
        while len(states):
            room = np.empty((_ROOM, 13)), np.empty(_ROOM, np.int64), np.empty(_ROOM, np.int64)
            count = followed(
                states,
                periods,
                left,
                self._steps // 2,
                patterns,
                sizes,
                end.ahead,
                self._time,
                end.tilt,
                end.sign * lean,
                h,
                gauss(),
                self._speed,
                least,
                *room,
            )
            if count < 0:
                return None
            states, periods, left = (table[:count] for table in room)
            ended.append(states[left == 0])
            states, periods, left = (table[left > 0] for table in (states, periods, left))
        return np.concatenate(ended)

    def _patterns(self, pulses: int, least: float, worth: float) -> tuple[np.ndarray, np.ndarray]:
        """Accelerations (P, 6) of open thrusters that can gain enough, and how many they are, from one on."""
        craft = self._lattice.craft
        wrenches = np.array(craft.wrench_map) / np.repeat([craft.mass, self._lattice.moment], 3)
        rows = []
        sizes = []
        for size in range(1, pulses + 1):
            sums = np.array(
                [
                    wrenches[list(some)].sum(axis=0)
                    for some in itertools.combinations(range(len(wrenches)), size)
                ]
            ).reshape(-1, 6)
            push = self._lattice.period * np.linalg.norm(sums[:, :3], axis=1)
            sums = sums[worth * (push + (pulses - size) * self._speed) >= least - 1e-9]
            _, one = np.unique(np.round(sums, 9), axis=0, return_index=True)  # equal ones fly alike
            rows.append(sums[one])
            sizes.append(np.full(len(one), size))
        return np.concatenate(rows), np.concatenate(sizes)

    def _meet(self, before: np.ndarray, after: np.ndarray) -> bool:
        """Whether a half from the start and one backwards from the goal are one flight that arrives.

        Spins differ by a quantum or not at all. Seen backwards, speeds and spins are reversed.
        """
        from scipy.spatial import KDTree

        quantum = self._lattice.spin
        rest = 0.5 * self._time
        near = 2.0 * math.sin(0.25 * self._radii[2]) + 1e-9
        tree = KDTree(np.hstack([before[:, 3:7], before[:, 10:] / quantum]))
        back = after[:, 3:7] * [1.0, -1.0, -1.0, -1.0]
        speed = rotated(back, after[:, 7:10])  # that the second half adds, on B in the middle
        place = rotated(back, after[:, 7:10] * rest - after[:, :3])
        for sign, part in itertools.product((1.0, -1.0), range(0, len(after), _PART)):
            chosen = np.arange(part, min(part + _PART, len(after)))
            keys = np.hstack([sign * after[chosen, 3:7], -after[chosen, 10:] / quantum])
            hits = tree.query_ball_point(keys, near)
            j = np.repeat(chosen, [len(hit) for hit in hits])
            i = np.concatenate([np.array(hit, dtype=np.int64) for hit in hits])
            one = before[i]
            off_speed = one[:, 7:10] + rotated(one[:, 3:7], speed[j]) - self._gain
            off_place = (
                one[:, :3] + rest * one[:, 7:10] + rotated(one[:, 3:7], place[j]) - self._way
            )
            if (
                (np.linalg.norm(off_speed, axis=1) <= self._radii[1])
                & (np.linalg.norm(off_place, axis=1) <= self._radii[0])
            ).any():
                return True
        return False


def rotated(q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Vectors (n, 3) turned by quaternions (n, 4)."""
    across = 2.0 * np.cross(q[:, 1:], v)
    return v + q[:, :1] * across + np.cross(q[:, 1:], across)
