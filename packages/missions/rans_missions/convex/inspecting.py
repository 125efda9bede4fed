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
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import linprog

from rans.extend import Timing, Vec3
from rans_missions.convex.inspection import sunlit
from rans_missions.tasks.inspect import Inspect
from rans_missions.vectors import components

_EVERY = 4
"""Control periods of which one may have a burn in the search: what a burn moves changes little in 80 s."""
_AROUND = 5
"""Control periods on either side of each burn found, in which the last program may burn instead."""
_NEAR = 25.0
"""Distance from the keep-out ball within which a path is kept out by tangents, m."""
_FAR = 0.75
"""Part of the end of the zone beyond which it is kept inside by tangents."""
_ROUNDS = 20
"""Programs that follow one another from a beginning, at most."""
_CONVERGED = 1e-3
"""Relative fall of the price at which they end."""
_HOPELESS = 1.6
"""Price over that of the best flight beyond which they end after a few rounds."""
_PATIENT = 4
"""These few rounds."""
_LAZY = 3.0
"""How far above its horizon the craft is, m, where a point is no constraint of the program at first."""
_CUTS = 12
"""Times at which a program is solved again with the constraints that its flight breaks, at most."""
_NEVER = -1e6
"""Height above a horizon, m, while the sun does not light the point."""
_EASING = 1.0
"""Price of a metre by which constraints are eased that cannot all be kept, m/s: far more than one is worth."""
_MATTERS = 1e-7
"""Multiplier of a constraint, N s / m for a craft of 1 kg, beyond which it raises the price."""
_KICK = 0.03
"""Largest standard deviation of a burn that is added at random, m/s: a tenth of what a dear inspection takes."""


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


@dataclass(frozen=True)
class _Found:
    """A flight with what its program knows of the constraints."""

    price: float
    burns: np.ndarray
    """Changes of velocity by craft, slot and axis, (3 D K,) m/s."""
    finish: int
    """Check at which enough has been seen."""
    checks: np.ndarray
    """Check at which each point is seen, counted through the checks of one craft after another, (points,)."""
    dear: np.ndarray
    """Points that raise the price, (M,)."""


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
        above: height above the horizon of a point from which it counts as seen, m.
        clear: distance from the keep-out ball and from the end of the zone that the flight keeps, m.
        apart: distance from one another that several craft keep, m.
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
        above: float,
        clear: float,
        apart: float = 0.0,
    ) -> None:
        self._task = task
        self._period = timing.control_period
        self._starts = starts
        self._sun = sun
        self._known = inspected
        self._most = most
        self._above = above
        self._nearest = task.keep_out + clear
        self._farthest = task.fail_distance - clear
        self._apart = apart
        self._pairs = list(itertools.combinations(range(len(starts)), 2))
        self._within = within
        allowed = math.ceil(task.unseen_tolerance * task.points - 1e-9) - 1
        self._asked = task.points - max(allowed, 0)
        self._normals = np.array(task.normals)
        self._check_time = self._period / timing.checks
        # The search sees once a control period; the last program and the judge at every check.
        self._grid = self._gridded(self._period, np.arange(0, int(within / self._period), _EVERY))

    def _gridded(self, step: float, slots: np.ndarray) -> _Grid:
        """What burns in control periods (K,) do to a flight, at instants a step (s) apart.

        Burns are columns by slot and then by axis, in the order of `Burns`.
        """
        times = step * np.arange(1, int(self._within / step + 1e-9) + 1)
        p, v = (Vec3(*x.T[:, :, None]) for x in (self._starts[:, :3], self._starts[:, 3:]))
        since = np.maximum(times[:, None] - slots * self._period, 0.0)
        # During a burn as far as a constant thrust carries it until then, afterwards as an impulse in its middle.
        period = self._period
        since = np.where(since < period, since**2 / (2.0 * period), since - 0.5 * period)
        axes = [self._task.drift.kicked(Vec3(*row), since)[0] for row in np.eye(3)]
        effect = np.stack([components(axis, since.shape) for axis in axes], axis=-1)
        lit = sunlit(self._task, self._sun, times)
        return _Grid(
            slots,
            times,
            components(self._task.drift.carry(p, v, times)[0], (len(self._starts), len(times))),
            np.ascontiguousarray(effect.transpose(0, 2, 1, 3)).reshape(len(times), 3, -1),
            np.where(lit, -self._task.surface_distance, _NEVER),
        )

    @property
    def times(self) -> np.ndarray:
        """Instants of the paths from which a search begins, (T,) s."""
        return self._grid.times

    @property
    def coast(self) -> np.ndarray:
        """Positions (D, T, 3) of the flight without a burn, m."""
        return self._grid.free

    @property
    def earliest(self) -> float:
        """Time before which too few points have been in light, s; infinite: they never are."""
        lit = np.logical_or.accumulate(self._grid.base > 0.5 * _NEVER, axis=0) | self._known
        enough = lit.sum(axis=1) >= self._asked
        return float(self._grid.times[enough.argmax()]) if enough.any() else math.inf

    def best(
        self,
        paths: Sequence[np.ndarray],
        hops: int,
        is_safe: Callable[[Burns], bool] = lambda burns: True,
    ) -> Burns | None:
        """The cheapest flight that the search finds, a safe one if there is any; None: it finds none.

        Args:
            paths: paths from which it begins, (D, T, 3) each at `times`, m; none need be flown or inspect anything.
            hops: number of times that it begins again from the best flight, changed at random.
            is_safe: whether a flight keeps what no program has as a constraint.
        """
        found = [one for one in (self._descend(self._grid, path) for path in paths) if one]
        if not found:
            return None
        best = min(found, key=lambda one: one.price)
        random = np.random.default_rng(0)
        for _ in range(hops):
            other = self._hop(best, random)
            if other is not None:
                found.append(other)
                best = min(best, other, key=lambda one: one.price)
        cheapest = None
        for one in sorted(found, key=lambda one: one.price):
            flight = self._polished(one)
            if flight is not None and is_safe(flight):
                return flight
            cheapest = cheapest or flight
        return cheapest

    def _hop(self, best: _Found, random: np.random.Generator) -> _Found | None:
        """Begin again from a flight that sees a dear point at another time, or with other burns.

        Published prices are those of these draws in this order; another order finds other flights of the same seed.
        """
        if len(best.dear) and random.random() < 0.7:
            point = int(random.choice(best.dear))
            width = int(random.integers(5, 60))
            check = int(best.checks[point])
            later = point, slice(max(check - width, 0), check + width + 1)
            return self._descend(self._grid, self._grid.path(best.burns), best.price, later)
        noise = 0.3 * random.normal(size=len(best.burns)) * (random.random(len(best.burns)) < 0.5)
        burns = best.burns * (1.0 + noise)
        slot = 3 * int(random.integers(len(burns) // 3))
        burns[slot : slot + 3] += random.normal(size=3) * _KICK * random.random()
        return self._descend(self._grid, self._grid.path(burns), best.price)

    def _descend(
        self,
        grid: _Grid,
        path: np.ndarray,
        best: float = math.inf,
        later: tuple[int, slice] | None = None,
    ) -> _Found | None:
        """Programs from a path until the price no longer falls.

        Args:
            grid: times of checks and burns.
            path: (D, T, 3).
            best: price of the best flight known, m/s.
            later: a point, and checks at which the first program does not see it.
        """
        result: _Found | None = None
        last = math.inf
        for turn in range(_ROUNDS):
            heights = (path @ self._normals.T + grid.base).reshape(-1, len(self._normals))
            if turn == 0 and later is not None:
                point, hidden = later
                heights[hidden, point] = _NEVER
            checks = heights.argmax(axis=0)
            highest = heights.max(axis=0)
            # The points that are easiest to see, as many as are asked for, without those seen before.
            highest[self._known] = math.inf
            points = np.argsort(-highest, kind="stable")[: self._asked]
            points = points[~self._known[points]]
            if len(points) and highest[points].min() <= 0.5 * _NEVER:
                break
            solved = self._solved(grid, path, points, checks, highest)
            if solved is None:
                break
            price, burns, dear = solved
            path = grid.path(burns)
            finish = self._judged(grid, path)
            if finish is not None and (result is None or price < result.price):
                result = _Found(price, burns, finish, checks, dear)
            if price > (1.0 - _CONVERGED) * last or (turn >= _PATIENT and price > _HOPELESS * best):
                break
            last = price
        return result

    def _polished(self, best: _Found) -> Burns | None:
        """The flight once more with checks as they are, and burns in any period around those found.

        None: it inspects too little.
        """
        found = best.burns.reshape(len(self._starts), -1, 3)
        used = np.flatnonzero(np.abs(found).max(axis=(0, 2)))
        slots = self._grid.slots[used, None] + np.arange(-_AROUND, _AROUND + 1)
        slots = slots[(slots >= 0) & (slots < int(self._within / self._period))]
        # Some starts need no burn; a program without any has no form.
        slots = np.unique([0, *slots])
        grid = self._gridded(self._check_time, slots)
        # The same flight on the finer grid.
        burns = np.zeros((len(found), len(slots), 3))
        burns[:, np.searchsorted(slots, self._grid.slots[used])] = found[:, used]
        polished = self._descend(grid, grid.path(burns.ravel()))
        if polished is None:
            return None
        changes = polished.burns.reshape(burns.shape)
        kept = np.flatnonzero(np.abs(changes).max(axis=(0, 2)))
        finish = float(grid.times[polished.finish])
        return Burns(polished.price, slots[kept], changes[:, kept], finish)

    def _judged(self, grid: _Grid, path: np.ndarray) -> int | None:
        """Check at which paths (D, T, 3) (m) have inspected enough.

        None: never, or one comes too near to the target or to another, or leaves before.
        """
        seen = (path @ self._normals.T + grid.base > 0.0).any(axis=0)
        count = (np.logical_or.accumulate(seen, axis=0) | self._known).sum(axis=1)
        if count[-1] < self._asked:
            return None
        finish = int(np.argmax(count >= self._asked))
        path = path[:, : finish + 1]
        distance = np.linalg.norm(path, axis=2)
        # Tangents are between two checks of the search: a part of the margin is for what they miss.
        margin = 0.5 * (self._nearest - self._task.keep_out)
        near = distance.min() < self._nearest - margin
        for i, j in self._pairs:
            near |= np.linalg.norm(path[i] - path[j], axis=1).min() < self._apart - margin
        return None if near or distance.max() > self._farthest + margin else finish

    def _solved(
        self,
        grid: _Grid,
        path: np.ndarray,
        points: np.ndarray,
        checks: np.ndarray,
        highest: np.ndarray,
    ) -> tuple[float, np.ndarray, np.ndarray] | None:
        """Price, burns (3 D K,), and dear points of the program that a path begins; None: no flight.

        Args:
            grid: times of checks and burns.
            path: (D, T, 3), whose tangents keep out of the balls.
            points: that are to be seen, (M,).
            checks: at which every point is seen, (points,), see `_Found`.
            highest: height of the path above each horizon then, m.
        """
        count, instants = path.shape[:2]
        size = grid.effect.shape[2]
        normals = self._normals[points]
        who, when = np.divmod(checks[points], instants)
        last = when.max(initial=0) + 1

        def row(directions: np.ndarray, craft: Any, at: np.ndarray) -> np.ndarray:
            """What burns (3 D K,) add to positions along directions (M, 3), of these craft at these instants."""
            result = np.zeros((len(directions), count, size))
            effect = np.einsum("mi,mik->mk", directions, grid.effect[at])
            result[np.arange(len(directions)), craft] = effect
            return result.reshape(len(directions), count * size)

        rows = [row(normals, who, when)]
        least = self._task.surface_distance + self._above
        sides = [least - np.einsum("mi,mi->m", normals, grid.free[who, when])]
        begins = [highest[points] < _LAZY]
        # Where a path is near the ball or far away, or near another, until the last point is seen.
        for i, j in [*((i, None) for i in range(count)), *self._pairs]:
            way, free = path[i, :last], grid.free[i, :last]
            limits = [(1.0, self._nearest), (-1.0, -self._farthest)]
            if j is not None:
                way, free = way - path[j, :last], free - grid.free[j, :last]
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
        matrix, side = np.concatenate(rows), np.concatenate(sides)
        used = np.concatenate(begins)
        if not len(matrix):
            return 0.0, np.zeros(count * size), points
        if not used.any():
            used[0] = True

        # With few constraints first, then with those that the flight breaks too. The last column eases all.
        size = matrix.shape[1]
        costs = np.append(np.ones(2 * size), _EASING)
        matrix = np.hstack([matrix, -matrix, np.ones((len(matrix), 1))])
        ease = 0.0
        for _ in range(_CUTS):
            program = linprog(
                costs,
                A_ub=-matrix[used],
                b_ub=-side[used],
                bounds=[(0.0, self._most)] * (2 * size) + [(0.0, ease)],
                method="highs-ds",
                options={"presolve": False},
            )
            if program.status == 2 and ease == 0.0:
                ease = math.inf
                continue
            if program.status != 0:
                return None
            burns = program.x[:size] - program.x[size:-1]
            broken = (matrix @ program.x < side - 1e-6) & ~used
            if not broken.any():
                prices = np.zeros(len(side))
                prices[used] = -program.ineqlin.marginals
                return float(program.fun), burns, points[prices[: len(points)] > _MATTERS]
            used |= broken
        return None


@dataclass(frozen=True)
class _Grid:
    """Instants of a search and what burns do until then."""

    slots: np.ndarray
    """Control periods that may have a burn, (K,)."""
    times: np.ndarray
    """(T,) s."""
    free: np.ndarray
    """Positions without burns, (D, T, 3) m."""
    effect: np.ndarray
    """Change of the position by a change of velocity in each slot along each axis, (T, 3, 3 K) s."""
    base: np.ndarray
    """What the height above each horizon has beside a . p, (T, points) m: -R, and `_NEVER` without light."""

    def path(self, burns: np.ndarray) -> np.ndarray:
        """Positions (D, T, 3) m of flights with burns (3 D K,) m/s."""
        burns = burns.reshape(len(self.free), -1)
        used = np.flatnonzero(burns.any(axis=0))
        return self.free + np.moveaxis(self.effect[:, :, used] @ burns[:, used].T, 2, 0)
