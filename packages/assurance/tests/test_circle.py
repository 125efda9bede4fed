"""Flights around a circle: the planner's picks worked out by hand, made-up motion, and a simple tracker."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, strategies as st
from rans_assurance.circle import RADIUS, START_SPREAD, LookAhead, Progress, fly_circle, tracked

from rans import Spacecraft, Timing, TrackVelocity
from rans.episode.flight import Flight
from rans.model.dynamics import PlanarState
from rans.model.fields import Heading, Vec2
from rans.model.spacecraft_file import load_spacecraft

PLATFORM = load_spacecraft("floating-platform")
FLYER = load_spacecraft("free-flyer")


class Tracker:
    """Opens all nozzles that push along the velocity still to gain; they come in pairs that do not turn.

    A pair changes the velocity by 2 * 1 N * 0.2 s / 5.32 kg = 0.075 m/s: it is opened from half of that.
    """

    name = "pairs"

    def __init__(self, craft: Spacecraft) -> None:
        self.directions = np.array([t.direction for t in craft.thrusters])

    def reset(self, count: int) -> None: ...

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        gain = np.stack((goal.v - state.v).columns(), axis=1)
        axes = [state.attitude.rotate(type(state.p)(*unit)) for unit in np.eye(gain.shape[1])]
        body = np.stack([(gain * np.stack(a.columns(), axis=1)).sum(axis=1) for a in axes], axis=1)
        return (body @ self.directions[:, : body.shape[1]].T > 0.0376).astype(float)


def flown(planner: LookAhead, craft: Spacecraft = PLATFORM) -> Flight:
    tracker = Tracker(craft)
    run: Any = SimpleNamespace(
        craft=craft, task=TrackVelocity(), controller=tracker, timing=Timing()
    )
    return fly_circle(run, planner, 5, 4)


def columns(vector: Any) -> np.ndarray:
    return np.stack(vector.columns(), axis=2)


def by_hand(flights: int) -> Flight:
    """Up to two flights with a look-ahead of 0.15 m: 0.4 rad of approach, then a lap.

    One takes a quarter of the lap a period, 3 cm and then 4 cm outside. The other never leaves the approach.
    """
    quarter = 0.5 * math.pi
    angles = np.array([[0.0, *(0.4 + quarter * np.arange(5)), 6.7], [0.0, *[0.1] * 6]]).T
    outside = np.array([[0.9, 0.03, 0.03, 0.04, 0.04, 0.9, 0.9], [*[0.9] * 5, -0.2, 0.9]]).T
    speed = np.array([[9.0, 9.0, 0.5, 0.5, 0.3, 0.3, 9.0], [*[9.0] * 6, 0.8]]).T
    angles, outside, speed = (x[:, :flights] for x in (angles, outside, speed))
    zero = np.zeros((7, flights))
    away = RADIUS + outside
    place = Vec2(away * np.cos(angles), away * np.sin(angles))
    states = PlanarState(place, Heading(zero), Vec2(speed, zero), zero)
    goals = PlanarState(
        Vec2(zero, zero), Heading(zero), Vec2(zero + 0.4, zero), zero, Progress(angles)
    )
    thrusters = np.zeros((6, flights, 8))
    thrusters[1:3, 0, :4] = 1.0
    timing = Timing(control_period=0.5, episode_steps=6)
    return Flight(PLATFORM, TrackVelocity(), timing, states, goals, thrusters, "by hand")


def test_the_closest_point_if_none_is_within_the_distance():
    planner = LookAhead(speed=0.5)
    progress, command = planner.plan(np.array([(2.0, 0.0, 1.0)]), np.zeros(1))
    assert progress == [0.0]
    assert command[0] == pytest.approx(0.5 * np.array([-0.5, 0.0, -1.0]) / math.hypot(0.5, 1.0))


def test_a_point_that_obeys_exactly_follows_the_circle():
    """It settles where its command is a tangent: radius^2 + 0.25^2 = 1.5^2, 2.1 cm inside the path."""
    planner = LookAhead()
    period = 0.01
    position = np.array([(1.4, -0.1)])
    progress = np.zeros(1)
    for _ in range(round(30.0 / period)):
        progress, command = planner.plan(position, progress)
        position = position + period * command
    error = planner.cross_track(position, progress)
    assert error == pytest.approx([1.5 - math.sqrt(1.5**2 - 0.25**2)], abs=3e-4)
    # 1.479 m are flown while the path goes on by 1.5 m; the start takes a few centimetres
    assert progress[0] * RADIUS == pytest.approx(30.0 * 0.25 * 1.5 / 1.479, rel=0.02)


@given(st.integers(0, 2**31), st.floats(0.02, 1.5), st.sampled_from([2, 3]))
def test_progress_never_goes_back_nor_jumps(seed, distance, dimension):
    """Wherever it is blown to: progress grows by a window at most, and the command keeps its length."""
    planner = LookAhead(0.3, distance)
    position = np.random.default_rng(seed).normal(0.0, 1.5, (3, dimension))
    before = np.array([0.0, 3.0, planner.end - 0.01])
    after, command = planner.plan(position, before)
    assert ((after >= before) & (after <= before + planner.window)).all()
    lengths = np.linalg.norm(command, axis=1)
    assert lengths == pytest.approx(np.where(after < planner.end, 0.3, 0.0))


def test_the_distance_is_from_the_part_near_the_flight():
    """Half a lap away it is from the end of that part, 0.25 m along: by the law of cosines."""
    planner = LookAhead()
    place = np.array([(1.6, 0.0, 0.0), (1.5, 0.0, -0.2)])
    assert planner.cross_track(place, np.array([0.1, math.tau])) == pytest.approx([0.1, 0.2])
    off = math.pi - 0.25 / 1.5
    far = math.sqrt(1.6**2 + 1.5**2 - 2.0 * 1.6 * 1.5 * math.cos(off))
    assert planner.cross_track(place[:1], np.array([math.pi])) == pytest.approx([far])


def test_errors_by_hand():
    """The approach does not count; a flight that is still in it is judged by its last instant."""
    planner = LookAhead(speed=0.4, distance=0.15)
    # 0.5, 0.5, 0.3, 0.3 m/s at the ends of the periods; half of the thrusters in two of four periods.
    first = {
        "solved": 100.0,
        "cross-track RMS": 100 * math.sqrt((2 * 0.03**2 + 2 * 0.04**2) / 4),
        "cross-track maximum": 4.0,
        "velocity error": 10.0,
        "speed error": 10.0,
        "duration": 2.5,
        "duty": 25.0,
    }
    alone = tracked(by_hand(1), planner)
    assert {name: row.value for name, row in alone.items()} == pytest.approx(first)
    # The second is 20 cm off and 0.4 m/s too fast at its last instant, and fires nothing.
    both = tracked(by_hand(2), planner)
    assert (both["solved"].value, both["duration"].value) == (50.0, math.inf)
    assert both["cross-track maximum"].value == pytest.approx(20.0)
    assert both["cross-track RMS"].value == pytest.approx((first["cross-track RMS"] + 20.0) / 2)
    assert both["speed error"].value == both["velocity error"].value == pytest.approx(25.0)


@pytest.mark.parametrize("craft", [PLATFORM, FLYER], ids=lambda craft: craft.name)
def test_a_simple_tracker_follows_the_circle(craft):
    """A perfect one is 2.1 cm inside; with pulses of 7.5 cm/s it should stay within three times that.

    Flights start near the first point, at rest, each in its own place and attitude, and rest at the end.
    """
    planner = LookAhead()
    flight = flown(planner, craft)
    found = tracked(flight, planner)
    assert 0.1 < found["cross-track RMS"].value < 6.0
    # 1 m of approach and 9.42 m of lap at 0.25 m/s: 41.7 s, and some for the start and for detours
    assert 38.0 < found["duration"].value < 50.0
    velocities = columns(flight.states.v)
    # never faster than commanded by more than a pulse along each axis
    pulse = 0.075 * math.sqrt(craft.dimension)
    assert np.linalg.norm(velocities, axis=2).max() < 0.25 + 1.5 * pulse
    offset = columns(flight.states.p)[0] - np.array([RADIUS, 0.0, 0.0])[: craft.dimension]
    assert np.linalg.norm(offset, axis=1).max() <= START_SPREAD
    assert len(np.unique(offset[:, 0])) == 4
    assert not velocities[0].any()
    arrived = flight.goals.notes.angle >= planner.end
    assert arrived[-1].all()
    assert not columns(flight.goals.v)[arrived].any()
    # what a pair cannot undo: 0.0376 m/s along each axis
    rest = 0.0376 * math.sqrt(craft.dimension)
    assert np.linalg.norm(velocities[-1], axis=1).max() < rest + 1e-9


@pytest.mark.parametrize(("look_ahead", "solved"), [(0.3, 100.0), (1.35, 0.0)])
def test_a_lap_that_is_cut_is_none(look_ahead, solved):
    """By hand: around a circle of 1.5 m at sqrt(1.5^2 - L^2), 0.98 and 0.44 of its radius."""
    planner = LookAhead(distance=look_ahead)
    flight = flown(planner)
    assert flight.goals.notes.angle.max() >= planner.end  # the planner counts both as done
    assert tracked(flight, planner)["solved"].value == solved
