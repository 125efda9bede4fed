"""Bound of flights among zones: numbers by hand, flights on either side, and splits that lose no flight."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from rans_missions.bounds.zones import Search
from rans_missions.convex import waypoints
from rans_missions.tasks import Avoid
from rans_missions.tasks.avoid import Zones
from scipy.optimize import minimize

from rans import Timing
from rans.episode.scenario import scenario
from rans.model.fields import Vec2
from rans.model.spacecraft_file import load_spacecraft
from rans.tasks.shapes import Ball

CRAFT = {2: load_spacecraft("floating-platform"), 3: load_spacecraft("free-flyer")}
TASK: Any = Avoid().for_evaluation()
TIMING = Timing(control_period=0.2, episode_steps=125, checks=4)
BRAKED, LAST = 20.2, 25.0


def _columns(vector: Any) -> np.ndarray:
    return np.array([float(x) for x in vector.columns()])


def _least(one: Any) -> float:
    """The bound of a start of the platform, N s."""
    return Search(CRAFT[2], TASK, one, TIMING).bound()


def test_who_stays_has_braked():
    """At 20.2 and at 25 s within 5 cm of the goal, d away at first: 2 d / 20.2 s, less what both balls spare.

    With q = 1 at first and -1 at 20.2 s the multipliers are 29.8 / (4.8 * 20.2) and -1 / 4.8 per second.
    """
    one = scenario(TASK, 2, 2023, 0)
    one = replace(one, goal=replace(one.goal, notes=Zones(())))
    away = float((one.goal.p - one.start.p).norm())
    by_hand = 2.0 * away / BRAKED - 0.05 * (29.8 / (4.8 * BRAKED) + 1.0 / 4.8)
    bound = _least(one)
    assert bound == pytest.approx(CRAFT[2].mass * by_hand, rel=1e-6)


def _among(*zones: tuple[float, float, float, float]) -> Any:
    """From rest 4 m along x to the origin; zones by x, y, velocity along y, and radius."""
    one: Any = scenario(TASK, 2, 2023, 0)
    notes = Zones(tuple(Ball(Vec2(x, y), Vec2(0.0, v), r) for x, y, v, r in zones))
    start = replace(one.start, p=Vec2(4.0, 0.0))
    return replace(one, start=start, goal=replace(one.goal, p=Vec2(0.0, 0.0), notes=notes))


def test_two_zones_are_passed_on_the_cheapest_sides_and_instants():
    """Every pair of sides, at the instants that a search finds: the bound is just below the cheapest."""
    zones = ((2.6, 0.25, -0.03, 0.4), (1.2, -0.2, 0.03, 0.5))
    one = _among(*zones)
    craft = CRAFT[2]
    ends = [waypoints.Waypoint(t, t, np.zeros(2), 0.05) for t in (BRAKED, LAST)]
    x = np.array([1.0, 0.0])

    def spent(instants, sides):
        way = [
            waypoints.Waypoint(
                t, t, np.array([px, py + v * t + s * r]), 9.0, np.array([0.0, s]), 0.0, x
            )
            for t, s, (px, py, v, r) in zip(instants, sides, zones, strict=True)
        ]
        return waypoints.least_impulse_through(craft.mass, np.array([4.0, 0.0]), [*way, *ends])

    cheapest = min(
        minimize(spent, (7.0, 13.0), (sides,), "Nelder-Mead", options={"maxfev": 20}).fun
        for sides in itertools.product((-1.0, 1.0), repeat=2)
    )
    bound = _least(one)
    assert 0.98 * cheapest <= bound <= cheapest
    assert bound > 1.1 * _least(_among())


def test_zones_that_are_not_in_the_way_cost_nothing():
    """Zones beside the way, behind the start, and one that moves along the way, which the bound leaves out."""
    free = _least(_among())
    for zone in ((2.0, 1.0, 0.0, 0.5), (5.0, 0.0, 0.0, 0.5), (-1.0, 0.0, 0.0, 0.5)):
        bound = _least(_among(zone))
        assert bound == pytest.approx(free, rel=1e-3)
    one = _among((2.0, 0.0, 0.0, 0.4))
    drifting = replace(one.goal.notes.zones[0], v=Vec2(-0.05, 0.0))
    one = replace(one, goal=replace(one.goal, notes=Zones((drifting,))))
    assert _least(one) == pytest.approx(free, rel=1e-9)


@pytest.mark.parametrize("dimension", [2, 3])
def test_every_split_keeps_every_flight(dimension):
    """Points at zones or farther out, as the zones are at instants in order, through random splits.

    One part of every split has their instants and directions, and its waypoints have the points. In the plane they
    are on the edge.
    """
    random = np.random.default_rng(dimension)
    for episode in range(20):
        one = scenario(TASK, dimension, 7, episode)
        ahead = _columns(one.goal.p) - _columns(one.start.p)
        ahead /= np.linalg.norm(ahead)
        zones = sorted(one.goal.notes.zones, key=lambda zone: float(_columns(zone.centre) @ ahead))
        search = Search(CRAFT[dimension], TASK, one, TIMING)
        instants = np.sort(random.uniform(5.0, BRAKED, len(zones)))
        points = []
        outwards = []
        for t, zone in zip(instants, zones, strict=True):
            aside = random.normal(size=dimension)
            aside -= ahead * (aside @ ahead)
            outwards.append(aside / np.linalg.norm(aside))
            # At 1 m/s a flight is so far inside between two checks.
            away = (float(zone.radius) - 6e-4) * random.choice([1.0, 1.0, 1.3])
            points.append(_columns(zone.centre) + t * _columns(zone.v) + away * outwards[-1])
        branch = (None,) * len(zones)
        tightest = np.inf
        while splits := list(search.splits(branch)):
            kept = []
            for part in splits[random.integers(len(splits))]:
                known = [(k, passing) for k, passing in enumerate(part) if passing is not None]
                waypoints = search.waypoints(part)
                if all(
                    passing.first <= instants[k] <= passing.last
                    and np.arccos(np.clip(waypoint.ahead @ outwards[k], -1.0, 1.0))
                    <= passing.half + 1e-7
                    for (k, passing), waypoint in zip(known, waypoints, strict=True)
                ):
                    kept.append(part)
                    for (k, _), waypoint in zip(known, waypoints, strict=True):
                        off = points[k] - waypoint.position
                        beyond = waypoint.behind + float(off @ waypoint.ahead)
                        assert beyond >= -1e-9
                        assert np.linalg.norm(off) <= waypoint.radius
                        assert abs(float(off @ waypoint.level)) <= 1e-9
                        tightest = min(tightest, beyond)
            assert kept
            branch = kept[random.integers(len(kept))]
        assert dimension == 3 or tightest < 0.01
