"""The goal set and the scores of flights that can be worked out on paper."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rans.evaluation.compare.bounds import goal_set
from rans.evaluation.compare.contest import Contest, Contestant, Entry, arrived
from rans.evaluation.fly.user_policies import user_policy
from rans.flight import Flight
from rans.model.dynamics import PlanarState
from rans.model.fields import Heading, Vec2, map_leaves
from rans.model.spacecraft_file import load_spacecraft
from rans.model.timing import Timing
from rans.optimal.control.lqr import LQR
from rans.tasks import GoToPose, GoToPosition, TrackVelocity
from tests.evaluation.flights import flight_of

CRAFT = load_spacecraft("floating-platform")
CONTEST = Contest(CRAFT, GoToPose().for_evaluation(), Timing(), 5, 3)


def entry_of(flight: Flight) -> Entry:
    return Entry(Contestant("x", LQR(flight.craft, flight.task, flight.timing), "", ""), flight, np.zeros(1))


def test_goal_set_is_that_of_the_certificate() -> None:
    """Around the goal, about a fifth of random states are in the set; both must name the same ones."""
    random, count = np.random.default_rng(2), 4000
    x, y = random.uniform(-0.06, 0.06, (2, count))
    u, v = random.uniform(-0.05, 0.05, (2, count))
    angle, w = random.uniform(-0.1, 0.1, (2, count))
    states = PlanarState(Vec2(x + 1.0, y), Heading(angle + math.pi), Vec2(u, v), w).normalised()
    goal = PlanarState(Vec2(1.0, 0.0), Heading(-math.pi), Vec2(0.0, 0.0), 0.0)
    goals = goal_set(CONTEST.task)
    ours = arrived(CONTEST.task, map_leaves(lambda f: np.asarray(f)[None], states), goal)[0]
    theirs = [goals.contains(map_leaves(lambda f, k=k: float(f[k]), states), goal) for k in range(count)]
    np.testing.assert_array_equal(ours, theirs)
    assert 0.1 < ours.mean() < 0.9


@pytest.mark.parametrize(("speed", "spin", "there"), [
    ((0.0, 0.0), 0.0, True), ((0.03, 0.03), 0.08, True),
    ((0.04, 0.04), 0.0, False), ((0.0, 0.0), -0.09, False),
])
def test_who_is_at_a_pose_must_rest(speed: tuple[float, float], spin: float, there: bool) -> None:
    """5 cm/s and 5 degrees/s = 0.0873 rad/s; (4, 4) cm/s is 5.7 cm/s fast."""
    flight = flight_of([[0.01]] * 2, 0.0, None, speed, spin)
    assert arrived(flight.task, flight.states, flight.goals).tolist() == [[there]] * 2


def test_only_what_is_asked_for_must_rest() -> None:
    """At a position spin is free; a velocity to track has no place to rest at."""
    spinning = flight_of([[0.01]] * 2, 90.0, spin=1.0, task=GoToPosition())
    assert arrived(spinning.task, spinning.states, spinning.goals).all()
    moving = flight_of([[3.0]] * 2, 0.0, speed=(0.04, 0.0), spin=1.0, task=TrackVelocity())
    assert arrived(moving.task, moving.states, moving.goals).all()


def test_scores_worked_out() -> None:
    """At the goal at 1.5 s, out again, back at 3 s to stay. Two thrusters of 1 N open in periods 1 to 3,
    one in period 5, of half a second each."""
    distance = np.array([[1.0, 0.5, 0.2, 0.04, 0.06, 0.2, 0.04, 0.03]]).T
    commands = np.zeros((7, 1, 8))
    commands[0:3, 0, 0:2] = commands[4, 0, 5] = 1.0
    entry = entry_of(flight_of(distance, 0.0, commands))
    assert (entry.arrival[0], entry.settling[0]) == (1.5, 3.0)
    assert (entry.arrival_thrust[0], entry.thrust[0]) == (3.0, 3.5)
    assert [entry.thrust_by(t)[0] for t in (1.0, 1.5, 2.0, 3.0)] == [math.inf, 3.0, math.inf, 3.5]
    assert entry.duty[0] == pytest.approx(7 / 56)
    assert entry.errors["position"][0] == pytest.approx(0.03)


def test_who_never_arrives_is_infinitely_late() -> None:
    entry = entry_of(flight_of(np.full((4, 2), 1.0), 0.0))
    assert entry.arrival.tolist() == entry.arrival_thrust.tolist() == [math.inf] * 2
    assert entry.thrust.tolist() == [0.0] * 2


def test_both_engines_fly_the_same_starts() -> None:
    """A controller without feedback on rounding: its flights agree to 1e-9 m in both engines."""
    policy = user_policy("python:tests.evaluation.policies:idle", CRAFT, GoToPose())
    timing = Timing(episode_steps=5)
    fast, drake = (Contest(CRAFT, CONTEST.task, timing, 5, 3, engine).fly(policy).flight
                   for engine in ("fast", "drake"))
    assert (fast.engine, drake.engine) == ("fast", "drake")
    for ours, theirs in zip(fast.states.p.columns(), drake.states.p.columns(), strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-9)


def test_latency_is_of_every_action() -> None:
    latencies = CONTEST.latencies(LQR(CRAFT, CONTEST.task, CONTEST.timing))
    assert latencies.shape == (3 * 25,)  # three starts, a fifth of 125 steps
    assert (latencies > 0).all()
