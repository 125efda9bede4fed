"""Impulse below which no flight passes keep-out zones and stays at the goal: branch and bound.

Flight and zones are seen along the way, from the start to the goal. A zone that moves across the way stays at one
distance along it, which every flight that arrives reaches for the first time at some instant. There the flight is
beside the zone: in the plane to its left or to its right, in space in some sector around it. A side or a sector
and a span of time make a `Waypoint`. Branches halve spans and sectors; the least bound of all is a bound.
"""

from __future__ import annotations

import heapq
import itertools
import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from rans.extend import Scenario, Spacecraft, Timing, certificates, last_fifth
from rans_missions.convex.waypoints import Waypoint, least_impulse_through
from rans_missions.tasks import Avoid

_CAP = 1.0
"""Speed of flights that the branches bound, m/s; faster ones spend at least the mass times it, which is more."""
_HASTE = 5.0
"""Bounded flights are up to so many times as fast as the mean of the straight way: who arrives soon is fast."""
_NARROW = 1.0 / 64.0
"""Part of the time, or of a turn, that is not halved again."""
_PROGRAMS = 2000
"""Largest number of cone programs of a start, about 1.5 ms each."""


class _Zone(NamedTuple):
    """A keep-out zone."""

    along: float
    """Distance of its centre along the way, m."""
    centre: np.ndarray
    """(d,) at the start, in W, m."""
    v: np.ndarray
    """(d,) m/s"""
    radius: float
    """No flight that is outside at every check is nearer to the centre at any instant, m."""


class _Passing(NamedTuple):
    """When and where a flight passes a zone."""

    first: float
    """s"""
    last: float
    """s"""
    middle: float
    """Direction from the zone, an angle around the way; in the plane 0 or pi, rad."""
    half: float
    """Half of the sector, rad."""


_Branch = tuple[_Passing | None, ...]
"""What is asked of a flight at each zone; None: nothing."""


class Search:
    """Branch and bound of the impulse below which no flight wins from a start; no node is dropped unproved.

    Whoever is near the goal at both ends of the last fifth has braked. The attitude is left out,
    and so are zones that do not move across the way from start to goal, or are not between them. Flights faster
    than a cap spend at least the mass times it.

    Args:
        craft: one that `least_impulse_through` bounds.
        task: among whose zones it flies.
        one: start at rest and goal, of floats.
        timing: control period, checks and length of the episode.
    """

    def __init__(self, craft: Spacecraft, task: Avoid, one: Scenario, timing: Timing) -> None:
        start: Any = one.start
        goal: Any = one.goal
        self._craft = craft
        self._from = np.array(start.p.columns(), float)
        place = np.array(goal.p.columns(), float)
        near = task.tolerances()["position"]
        steps = timing.episode_steps
        self._time = timing.control_period * (steps + 1 - last_fifth(steps))
        ends = self._time, timing.control_period * steps
        self._ends = [Waypoint(t, t, place, near) for t in ends]
        distance = float(np.linalg.norm(place - self._from))
        self._cap = max(_CAP, _HASTE * distance / self._time)
        self._ahead = (place - self._from) / distance
        # What is across the way: one direction in the plane, two in space.
        self._across = np.linalg.svd(self._ahead[None])[2][1:]
        zones = []
        for zone in goal.notes.zones:
            centre, v = (np.array(x.columns(), float) for x in (zone.centre, zone.v))
            along = float(self._ahead @ centre)
            beside = abs(float(self._ahead @ v)) * self._time < 1e-8
            if beside and self._ahead @ self._from < along < self._ahead @ place - near:
                radius = self._between_checks(float(zone.radius), v, timing)
                zones.append(_Zone(along, centre, v, radius))
        self._zones = sorted(zones, key=lambda zone: zone.along)

    def _between_checks(self, radius: float, v: np.ndarray, timing: Timing) -> float:
        """How near to a zone's centre a flight comes that is outside at every check, m.

        Between two checks it is near a chord, whose ends are outside: no nearer than half of it leaves
        (Pythagoras), and full thrust bends the path by a t^2 / 8. The zone moves at v (d,) m/s.
        """
        apart = timing.control_period / timing.checks
        chord = (self._cap + float(np.linalg.norm(v))) * apart
        push = certificates().greatest_force(self._craft) / self._craft.mass
        return math.sqrt(max(0.0, radius**2 - 0.25 * chord**2)) - push * apart**2 / 8.0

    def bound(self) -> float:
        """The least bound of the branches that are left, N s.

        It holds wherever the search ends, so `_PROGRAMS` may be smaller.
        """
        nothing: _Branch = (None,) * len(self._zones)
        most = self._craft.mass * self._cap
        count = itertools.count()
        left: list[tuple[float, int, _Branch]] = [(self._value(nothing), next(count), nothing)]
        tried = 1
        while left and left[0][0] < most:
            least, _, branch = left[0]
            best: tuple[list[float], list[tuple[float, _Branch]]] | None = None
            for parts in self.splits(branch):
                tried += len(parts)
                found = [(max(least, self._value(part)), part) for part in parts]
                score = sorted(value for value, _ in found) or [math.inf]
                if best is None or score > best[0]:
                    best = score, found
            if best is None or tried > _PROGRAMS:
                break
            heapq.heappop(left)
            for value, part in best[1]:
                heapq.heappush(left, (value, next(count), part))
        return max(0.0, min(most, left[0][0] if left else math.inf))

    def splits(self, branch: _Branch) -> Iterator[list[_Branch]]:
        """Ways to split a branch, each into parts that together have all of its flights.

        No flight may be lost between parts: spans and sectors share their edges.
        """
        for k, passing in enumerate(branch):
            parts: list[list[_Passing]] = []
            if passing is None:
                sectors = 2 if len(self._across) == 1 else 4
                half = 0.0 if sectors == 2 else math.pi / sectors
                middles = (2.0 * math.pi * j / sectors for j in range(sectors))
                parts = [[_Passing(0.0, self._time, middle, half) for middle in middles]]
            else:
                first, last, middle, half = passing
                if last - first > _NARROW * self._time:
                    then = 0.5 * (first + last)
                    parts.append([passing._replace(last=then), passing._replace(first=then)])
                if half > 2.0 * math.pi * _NARROW:
                    half *= 0.5
                    parts.append([_Passing(first, last, middle + x, half) for x in (-half, half)])
            for choice in parts:
                changed = [(*branch[:k], part, *branch[k + 1 :]) for part in choice]
                ordered = (_in_order(one, self._time) for one in changed)
                yield [one for one in ordered if one is not None]

    def waypoints(self, branch: _Branch) -> list[Waypoint]:
        """Where (m) and when (s) the flights of a branch pass zones: parts of planes that all these flights cross.

        The bound holds only if each part has every place in which a flight of the branch may cross its plane in the
        span: its radius is what a flight can reach until then, and `behind` is how far the zone moves meanwhile.
        """
        points = []
        for zone, passing in zip(self._zones, branch, strict=True):
            if passing is None:
                continue
            first, last, middle, half = passing
            angles = (math.cos(middle), math.sin(middle))[: len(self._across)]
            out = np.array(angles) @ self._across
            # A sector is ahead of the plane through the corners of its arc.
            beside = zone.centre + zone.v * 0.5 * (first + last)
            beside = beside + zone.radius * math.cos(half) * out
            moved = 0.5 * (last - first) * abs(float(out @ zone.v))
            far = self._cap * last + float(np.linalg.norm(beside - self._from))
            points.append(Waypoint(first, last, beside, far, out, moved, self._ahead))
        return points

    def _value(self, branch: _Branch) -> float:
        """Bound of the flights of a branch, N s."""
        points = [*self.waypoints(branch), *self._ends]
        return least_impulse_through(self._craft.mass, self._from, points)


def _in_order(branch: _Branch, time: float) -> _Branch | None:
    """A branch whose spans are cut to the order in which zones are passed; None: it has no flights.

    The zones of a branch are in the order in which they are passed along the way, so that instants may not go back.
    """
    known = [k for k, passing in enumerate(branch) if passing is not None]
    spans = np.array([(0.0, time) if passing is None else passing[:2] for passing in branch])
    spans[:, 0] = np.maximum.accumulate(spans[:, 0])
    spans[:, 1] = np.minimum.accumulate(spans[::-1, 1])[::-1]
    if (spans[:, 0] > spans[:, 1]).any():
        return None
    cut = list(branch)
    for k in known:
        passing = branch[k]
        assert passing is not None
        cut[k] = passing._replace(first=float(spans[k, 0]), last=float(spans[k, 1]))
    return tuple(cut)
