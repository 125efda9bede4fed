"""Cheap flights that inspect: linear programs over burns, and a local search over who is seen when.

To see a point with the outward normal a at a check is a . p >= R there, which is linear in the burns of a flight in
a drift. If it is settled at which check each point is seen, and on which side the keep-out ball is passed, the
flight of least impulse is a linear program. Its flight sees most points better at other checks, and so has a
cheaper program: programs follow one another until the price no longer falls. They begin from several flights, and
from the best one with a point seen at another time, or with other burns. Positions are in the Hill frame (m), burns
changes of velocity (m/s); `tests/convex/test_inspecting.py` compares prices with certified bounds.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from rans.extend import Timing
from rans_missions.convex.burns import Reach, Solved, cheapest
from rans_missions.convex.inspection import sunlit
from rans_missions.tasks.inspect import Inspect

_EVERY = 4
"""Control periods of which one may have a burn in the search: what a burn moves changes little in 80 s."""
_ABOVE = 0.05
"""Height above the horizon of a point from which it counts as seen in a search, m: for rounding."""
BESIDE = 0.2
"""Distance that a flight keeps from its limits, the keep-out ball, the end of the zone and other craft, m."""
_NEAR = 25.0
"""Distance from the keep-out ball within which a path is kept out by tangents, m."""
_FAR = 0.75
"""Part of the end of the zone beyond which it is kept inside by tangents."""
_ROUNDS = 20
"""Programs that follow one another from a beginning, at most."""
_CONVERGED = 1e-3
"""Relative fall of the price at which they end."""
_LAZY = 3.0
"""How far above its horizon the craft is, m, where a point is no constraint of the program at first."""
_NEVER = -1e6
"""Height above a horizon, m, while the sun does not light the point."""


class Burns(NamedTuple):
    """Burns of a flight, and what they cost."""

    price: float
    """Sum of the changes of velocity along all axes, m/s."""
    periods: np.ndarray
    """Control periods from the start that have a burn, (K,), in order."""
    changes: np.ndarray
    """Changes of velocity in W in them of D craft, (D, K, 3) m/s."""
    finish: float
    """Time at which enough has been seen, s."""


class InspectionSearch:
    """Search for the cheapest flight of one craft, or of D craft together, that inspects enough.

    A point that any craft sees counts. Where no flight keeps all constraints of a program, it eases all alike at a
    price, and the next one begins from what it finds.

    Args:
        task: the inspection, whose points are seen from above their horizon.
        timing: control period and checks.
        starts: position (m) and velocity (m/s) in W of each craft, (D, 6).
        sun: angle of the sun at the start, rad.
        inspected: which points have been seen before, (points,).
        within: time within which enough is to be seen, s.
        most: largest change of velocity of a control period along an axis, m/s.
    """

    def __init__(
        self,
        task: Inspect,
        timing: Timing,
        starts: np.ndarray,
        sun: float,
        inspected: np.ndarray,
        within: float,
        most: float,
    ) -> None:
        self._task = task
        self._period = timing.control_period
        self._starts = starts
        self._known = inspected
        self._most = most
        self._nearest = task.keep_out + BESIDE
        self._farthest = task.fail_distance - BESIDE
        self._apart: float = getattr(task, "keep_apart", 0.0) + BESIDE
        self._pairs = list(itertools.combinations(range(len(starts)), 2))
        allowed = math.ceil(task.unseen_tolerance * task.points - 1e-9) - 1
        self._asked = task.points - max(allowed, 0)
        self._normals = np.array(task.normals)
        # Points are seen, and distances kept, at the ends of control periods.
        periods = np.arange(int(within / self._period + 1e-9))
        self._reach = Reach.of(
            task.drift, starts, self._period, periods[::_EVERY], self._period * (periods + 1)
        )
        self._lit = sunlit(task, sun, self._reach.times)

    def _heights(self, path: np.ndarray) -> np.ndarray:
        """Heights of paths (D, T, 3) above the horizon of each point, (D, T, points) m; `_NEVER` without light."""
        base = np.where(self._lit, -self._task.surface_distance, _NEVER)
        return path @ self._normals.T + base

    @property
    def times(self) -> np.ndarray:
        """Instants of the paths from which a search begins, (T,) s."""
        return self._reach.times

    @property
    def coast(self) -> np.ndarray:
        """Positions (D, T, 3) of the flight without a burn, m."""
        return self._reach.free

    @property
    def earliest(self) -> float:
        """Time before which too few points have been in light, s; infinite: they never are."""
        lit = np.logical_or.accumulate(self._lit, axis=0) | self._known
        enough = lit.sum(axis=1) >= self._asked
        return float(self._reach.times[enough.argmax()]) if enough.any() else math.inf

    def best(
        self,
        paths: Sequence[np.ndarray],
        is_safe: Callable[[Burns], bool] = lambda burns: True,
    ) -> Burns | None:
        """The cheapest flight that the search finds, a safe one if there is any; None: it finds none.

        Args:
            paths: paths from which it begins, (D, T, 3) each at `times`, m; none need be flown or inspect anything.
            is_safe: whether a flight keeps what no program has as a constraint.
        """
        found = [one for one in map(self._descend, paths) if one is not None]
        return min(found, key=lambda one: (not is_safe(one), one.price), default=None)

    def _descend(self, path: np.ndarray) -> Burns | None:
        """The cheapest flight of programs from a path (D, T, 3) on, until the price no longer falls."""
        result: Burns | None = None
        last = math.inf
        for _ in range(_ROUNDS):
            heights = self._heights(path).reshape(-1, len(self._normals))
            checks = heights.argmax(axis=0)
            highest = heights.max(axis=0)
            # The points that are easiest to see, as many as are asked for, without those seen before.
            highest[self._known] = math.inf
            points = np.argsort(-highest, kind="stable")[: self._asked]
            points = points[~self._known[points]]
            if len(points) and highest[points].min() <= 0.5 * _NEVER:
                break
            solved = self._solved(path, points, checks, highest)
            if solved is None:
                break
            path = self._reach.path(solved.burns)
            finish = self._judged(path)
            if finish is not None and (result is None or solved.price < result.price):
                changes = solved.burns.reshape(len(path), -1, 3)
                kept = np.flatnonzero(changes.any(axis=(0, 2)))
                time = float(self._reach.times[finish])
                result = Burns(solved.price, self._reach.slots[kept], changes[:, kept], time)
            if solved.price > (1.0 - _CONVERGED) * last:
                break
            last = solved.price
        return result

    def _judged(self, path: np.ndarray) -> int | None:
        """Check at which paths (D, T, 3) (m) have inspected enough.

        None: never, or one comes too near to the target or to another, or leaves before.
        """
        seen = (self._heights(path) > 0.0).any(axis=0)
        count = (np.logical_or.accumulate(seen, axis=0) | self._known).sum(axis=1)
        if count[-1] < self._asked:
            return None
        finish = int(np.argmax(count >= self._asked))
        path = path[:, : finish + 1]
        distance = np.linalg.norm(path, axis=2)
        # Tangents are between two checks of the search: a part of the margin is for what they miss.
        margin = 0.5 * BESIDE
        near = distance.min() < self._nearest - margin
        for i, j in self._pairs:
            near |= np.linalg.norm(path[i] - path[j], axis=1).min() < self._apart - margin
        return None if near or distance.max() > self._farthest + margin else finish

    def _solved(
        self,
        path: np.ndarray,
        points: np.ndarray,
        checks: np.ndarray,
        highest: np.ndarray,
    ) -> Solved | None:
        """What the program finds that a path begins, with burns (3 D K,); None: no flight.

        Args:
            path: (D, T, 3), whose tangents keep out of the balls.
            points: that are to be seen, (M,).
            checks: at which each point is seen, counted through those of one craft after another, (points,).
            highest: height of the path above each horizon then, m.
        """
        count, instants = path.shape[:2]
        size = self._reach.effect.shape[2]
        normals = self._normals[points]
        who, when = np.divmod(checks[points], instants)
        last = when.max(initial=0) + 1

        def row(directions: np.ndarray, craft: Any, at: np.ndarray) -> np.ndarray:
            """What burns (3 D K,) add to positions along directions (M, 3), of these craft at these instants."""
            result = np.zeros((len(directions), count, size))
            effect = np.einsum("mi,mik->mk", directions, self._reach.effect[at])
            result[np.arange(len(directions)), craft] = effect
            return result.reshape(len(directions), count * size)

        rows = [row(normals, who, when)]
        least = self._task.surface_distance + _ABOVE
        sides = [least - np.einsum("mi,mi->m", normals, self._reach.free[who, when])]
        begins = [highest[points] < _LAZY]
        # Where a path is near the ball or far away, or near another, until the last point is seen.
        for i, j in [*((i, None) for i in range(count)), *self._pairs]:
            way, free = path[i, :last], self._reach.free[i, :last]
            limits = [(1.0, self._nearest), (-1.0, -self._farthest)]
            if j is not None:
                way, free = way - path[j, :last], free - self._reach.free[j, :last]
                limits = [(1.0, self._apart)]
            distance = np.linalg.norm(way, axis=1)
            unit = way / distance[:, None]
            for side, limit in limits:
                near = distance < limit + _NEAR if side > 0.0 else distance > -_FAR * limit
                at = np.flatnonzero(near)
                effect = row(side * unit[at], i, at)
                if j is not None:
                    effect -= row(unit[at], j, at)
                rows.append(effect)
                sides.append(limit - side * np.einsum("ti,ti->t", unit[at], free[at]))
                begins.append(side * distance[at] < limit + 0.5)
        return cheapest(
            np.concatenate(rows),
            np.concatenate(sides),
            np.concatenate(begins),
            self._most,
        )
