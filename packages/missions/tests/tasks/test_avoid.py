"""Keep-out zones on the way to a pose: where they are drawn, how they move, and what entering one costs."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from rans_missions.script import Script
from rans_missions.tasks import Avoid
from rans_missions.tasks.avoid import Zones

from rans import Timing
from rans.episode.drawing import columns
from rans.episode.flight import fly
from rans.episode.scenario import scenarios
from rans.episode.step import Setup, World, step
from rans.episode.verdict import Failure
from rans.model.dynamics import PlanarState
from rans.model.fields import Heading, Vec2, leaves
from rans.model.random import Draws, seed_words
from rans.model.spacecraft_file import load_spacecraft
from rans.reference.flight import fly_in_drake
from rans.tasks import GoToPose, observation
from rans.tasks.rewards import Transition
from rans.tasks.shapes import Ball

PLATFORM = load_spacecraft("floating-platform")
FLYER = load_spacecraft("free-flyer")
COUNT = 2000


def entered(task: Avoid, drawn: Any, seconds: float) -> np.ndarray:
    """Who would enter a zone on a straight flight to the goal in a time, (N,)."""
    found = np.zeros(len(drawn.start.p.x), dtype=bool)
    for share in np.linspace(0.0, 1.0, 201):
        place = columns(drawn.start.p) * (1.0 - share)
        for zone in task.later(drawn.goal, seconds * float(share)).notes.zones:
            found |= np.linalg.norm(columns(zone.centre) - place, axis=1) < zone.radius
    return found


@pytest.mark.parametrize("craft", [PLATFORM, FLYER], ids=["plane", "space"])
def test_zones_never_come_near_start_or_goal(craft):
    """At any time of an episode, the fastest zones included."""
    task = Avoid(zone_speed=(0.0, 0.3))
    drawn = scenarios(task, craft, seed=3, count=COUNT)
    for time in np.linspace(0.0, 25.0, 11):
        for zone in task.later(drawn.goal, float(time)).notes.zones:
            for point in (drawn.start.p, drawn.goal.p):
                distance = np.linalg.norm(columns(zone.centre) - columns(point), axis=1)
                # Positions of a few metres carry 1e-15, a normalised direction 1e-12.
                assert (distance - zone.radius >= task.clearance - 1e-9).all()


@pytest.mark.parametrize("craft", [PLATFORM, FLYER], ids=["plane", "space"])
def test_zones_are_in_the_way(craft):
    """Radii and speeds fill their ranges; most straight flights to the goal in 12 s would enter a zone."""
    task = Avoid(zone_speed=(0.01, 0.04))
    drawn = scenarios(task, craft, seed=3, count=COUNT)
    radii = np.concatenate([zone.radius for zone in drawn.goal.notes.zones])
    assert (radii.min(), radii.max()) == pytest.approx((0.3, 0.5), abs=0.001)
    speeds = np.concatenate(
        [np.linalg.norm(columns(zone.v), axis=1) for zone in drawn.goal.notes.zones]
    )
    assert (speeds.min(), speeds.max()) == pytest.approx((0.01, 0.04), abs=0.001)
    assert entered(task, drawn, 12.0).mean() > (0.7 if craft is PLATFORM else 0.5)


def test_start_and_goal_are_those_of_go_to_pose():
    """Zones are drawn after them, so that agents and bounds without zones have the same starts."""
    settings: Any = {"spawn_distance": (2.2, 4.5)}
    here: Any = scenarios(Avoid(**settings), PLATFORM, seed=5, count=16)
    there: Any = scenarios(GoToPose(**settings), PLATFORM, seed=5, count=16)
    assert np.array_equal(here.start.p.x, there.start.p.x)
    assert np.array_equal(here.goal.attitude.angle, there.goal.attitude.angle)


def one_zone(centre: tuple[float, float], velocity: tuple[float, float] = (0.0, 0.0)) -> Any:
    """Start at x = -1 m at 0.4 m/s along x, and a goal at the origin with one zone of 0.2 m."""
    start = PlanarState(Vec2(-1.0, 0.0), Heading(0.0), Vec2(0.4, 0.0), 0.0)
    goal = PlanarState(Vec2(0.0, 0.0), Heading(0.0), Vec2(0.0, 0.0), 0.0)
    return start, replace(goal, notes=Zones((Ball(Vec2(*centre), Vec2(*velocity), 0.2),)))


def test_the_reward_at_a_rim_and_inside():
    """At the rim the whole price, 0.15 m away 1/e of it, inside no more than at the rim."""
    task = Avoid(zones=1, zone_weight=0.5)
    shut = (0.0,) * 8
    for x, expected in ((0.2, -0.5), (0.35, -0.5 / np.e), (0.1, -0.5)):
        start, goal = one_zone((0.0, 0.0))
        state = replace(start, p=Vec2(x, 0.0))
        terms = task.reward(Transition(state, goal, shut, shut))
        assert terms["zones"] == pytest.approx(expected, abs=1e-9)
    assert "zones" not in Avoid(zone_weight=0.0).reward(Transition(start, goal, shut, shut))


def test_entering_a_zone_between_two_commands_ends_the_episode():
    """At 0.4 m/s the four looks of a period of 0.5 s are 5 cm apart; the zone begins 0.11 m ahead."""
    task = Avoid(zones=1)
    world = World(Setup(PLATFORM, task, Timing(0.5, episode_steps=10, checks=4)))
    ahead = step(world, world.begin(*one_zone((-0.69, 0.0))), (0.0,) * 8)
    assert bool(ahead.failed)
    # It was 0.15 m on, 0.04 m deep, when the episode ended; the period's end would be 0.09 m deep.
    assert float(ahead.margins["zone 1"]) == pytest.approx(-0.04, abs=1e-9)
    assert float(ahead.terms["violation"]) == -20.0
    beside = step(world, world.begin(*one_zone((-0.8, 0.21))), (0.0,) * 8)
    assert not bool(beside.failed)
    # A zone that flees at the same speed is never reached, one that comes is met at once.
    fleeing = step(world, world.begin(*one_zone((-0.79, 0.0), (0.4, 0.0))), (0.0,) * 8)
    assert float(fleeing.margins["zone 1"]) == pytest.approx(0.01, abs=1e-9)
    coming = step(world, world.begin(*one_zone((-0.6, 0.0), (-1.2, 0.0))), (0.0,) * 8)
    assert bool(coming.failed)


def test_the_observation_has_no_order_of_zones():
    task = Avoid()
    drawn = scenarios(task, PLATFORM, seed=7, count=64)
    turned = replace(drawn.goal, notes=Zones(drawn.goal.notes.zones[::-1]))
    here = observation(task, drawn.start, drawn.goal)
    there = observation(task, drawn.start, turned)
    assert all(np.array_equal(a, b) for a, b in zip(here, there, strict=True))


@pytest.mark.parametrize("flying", [fly, fly_in_drake])
def test_flights_that_enter_are_violated(flying):
    """Without a command each stays at its start; thrown at the goal straight ahead most meet a zone."""
    task = Avoid(zone_speed=(0.0, 0.0))
    starts = scenarios(task, PLATFORM, seed=1, count=16)
    thrown = replace(starts, start=replace(starts.start, v=starts.start.p.scale(-0.1)))
    shut = Script(np.zeros((50, 16, 8)))
    flight = flying(PLATFORM, task, shut, thrown, replace(task.timing, episode_steps=50))
    lost = entered(task, thrown, 10.0)
    assert flight.violated().tolist() == lost.tolist()
    assert lost.sum() > 8
    assert (flight.verdict.failure()[lost] == Failure.VIOLATED).all()


def test_single_precision_knows_where_zones_are():
    """In the plane the part of a direction across the way may be tiny, and its side is all that counts."""
    count = 20_000
    real = [
        Avoid().sample(own.random(2, own.first))[1].notes
        for dtype in (np.float32, np.float64)
        for own in [Draws(*seed_words(3), np.arange(count, dtype=np.int32), 0, dtype)]
    ]
    for single, double in zip(*map(leaves, real), strict=True):
        # Sums of a few metres in single precision.
        np.testing.assert_allclose(single, double, rtol=0, atol=4e-6)
        assert single.dtype == np.float32
