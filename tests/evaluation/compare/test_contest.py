"""The goal set and the scores of flights that can be worked out on paper."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from rans_bounds.goal_set import goal_set

from rans import LQR, ConfigError, GoToPose, Timing
from rans.episode.flight import Flight
from rans.evaluation.compare.bounds import Event
from rans.evaluation.compare.contest import Contest, Contestant, Entry
from rans.model.dynamics import PlanarState
from rans.model.fields import Heading, Vec2, map_leaves
from rans.model.spacecraft_file import load_spacecraft
from rans.tasks.goal_set import arrived
from tests.support.evaluation_flights import flight_of
from tests.support.states import planar

CRAFT = load_spacecraft("floating-platform")
CONTEST = Contest(CRAFT, GoToPose().for_evaluation(), Timing(), 5, 3)


def entry_of(flight: Flight) -> Entry:
    return Entry(Contestant("x", LQR(flight.craft, flight.task, flight.timing), "", ""), flight)


def test_goal_set_is_that_of_the_certificate():
    """Around the goal, about a fifth of random states are in the set; both must name the same ones."""
    random = np.random.default_rng(2)
    count = 4000
    x, y = random.uniform(-0.06, 0.06, (2, count))
    u, v = random.uniform(-0.05, 0.05, (2, count))
    angle, w = random.uniform(-0.1, 0.1, (2, count))
    states = PlanarState(Vec2(x + 1.0, y), Heading(angle + math.pi), Vec2(u, v), w).normalised()
    goal = planar(1.0, heading=-math.pi)
    goals = goal_set(CONTEST.task)
    ours = arrived(CONTEST.task, map_leaves(lambda f: np.asarray(f)[None], states), goal)[0]
    theirs = [
        goals.contains(map_leaves(lambda f, k=k: float(f[k]), states), goal) for k in range(count)
    ]
    np.testing.assert_array_equal(ours, theirs)
    assert 0.1 < ours.mean() < 0.9


PATH = [1.0, 0.5, 0.2, 0.04, 0.06, 0.2, 0.04, 0.03]
"""Distances, m: in the goal set after three periods, out, and back after six."""


def test_scores_worked_out():
    """At the goal at 1.5 s, out again, back at 3 s to stay. Two thrusters of 1 N open in periods 1 to 3,
    one in period 5, of half a second each."""
    distance = np.array([PATH]).T
    commands = np.zeros((7, 1, 8))
    commands[0:3, 0, 0:2] = commands[4, 0, 5] = 1.0
    entry = entry_of(flight_of(distance, 0.0, commands))
    assert (entry.arrival[0], entry.settling[0]) == (1.5, 3.0)
    assert (entry.arrival_thrust[0], entry.thrust[0]) == (3.0, 3.5)
    away = entry_of(flight_of(distance + 1.0, 0.0, commands))
    assert (away.arrival_thrust[0], away.thrust[0]) == (math.inf, 3.5)
    # Out of the set at 2 s, but there before: it could have waited half a second and be there at 2 s.
    assert [entry.thrust_by(t)[0] for t in (1.0, 1.5, 2.0, 3.0)] == [math.inf, 3.0, 3.0, 3.5]
    assert entry.errors["position"][0] == pytest.approx(0.03)


def test_who_begins_moving_cannot_wait():
    """The same path of a craft that moves from the beginning counts at the very instants only."""
    distance = np.array([PATH]).T
    moving = entry_of(flight_of(distance, 0.0, speed=(0.03, 0.0)))
    assert [moving.thrust_by(t)[0] for t in (1.5, 2.0, 3.0)] == [0.0, math.inf, 0.0]


def test_who_was_in_the_goal_set_once_need_not_stay():
    """In the set at 1.5 s, out at 2 s, back from 3 s to the end; the second flight is out at the end."""
    second = [1.0, 0.5, 0.2, 0.04, 0.04, 0.04, 0.04, 0.06]
    entry = entry_of(flight_of(np.transpose([PATH, second]), 0.0))
    assert entry.arrival.tolist() == [1.5, 1.5]
    assert entry.staying.tolist() == [3.0, math.inf]


def test_amounts_are_of_their_event():
    """Arrives at 1.5 s, settles at 3 s."""
    distance = np.array([PATH]).T
    entry = entry_of(flight_of(distance, 0.0))
    assert entry.amounts(Event()).tolist() == [1.5]
    assert entry.amounts(Event("settling")).tolist() == [3.0]
    with pytest.raises(ConfigError, match="for arrival only"):
        entry.amounts(Event("settling", 3.0))
    assert [event.text for event in (Event(), Event("settling"), Event(horizon=2.4))] == [
        "first time in the goal set",
        "settling time",
        "impulse by 2.4 s",
    ]


def test_who_turns_unseen_has_not_settled_at_an_attitude():
    """Half a turn in a period of half a second are 2 pi rad/s: looks may miss whole turns from there on."""
    for spin, value in ((6.2, 0.0), (6.3, math.inf), (-6.3, math.inf)):
        turning = entry_of(flight_of(np.full((4, 1), 0.01), 0.0, spin=spin))
        assert turning.settling.tolist() == [0.0]
        assert turning.amounts(Event("settling")).tolist() == [value]


@pytest.mark.parametrize("periods", [43, 81, 86, 91])
def test_thrust_by_a_whole_number_of_periods(periods):
    """0.2 s times these, over 0.2 s again, is just below the whole number; one pulse of 1 N a period."""
    commands = np.zeros((100, 1, 8))
    commands[:, 0, 0] = 1.0
    flight = replace(
        flight_of(np.full((101, 1), 0.01), 0.0, commands), timing=Timing(0.2, episode_steps=100)
    )
    entry = entry_of(flight)
    assert entry.thrust_by(periods * 0.2) == pytest.approx([0.2 * periods])
    assert entry.amounts(Event(horizon=periods * 0.2)) == pytest.approx([0.2 * periods])
    with pytest.raises(ConfigError, match="whole control periods"):
        entry.thrust_by(periods * 0.2 + 0.1)


def test_forces_count_in_thrust_time():
    """Thrusters of 2 N and 0.5 N open for one period of 0.5 s each: 1.25 N s; the goal is reached between."""
    forces = [2.0, 0.5] + [1.0] * 6
    stronger = tuple(replace(t, force=f) for t, f in zip(CRAFT.thrusters, forces, strict=True))
    commands = np.zeros((3, 2, 8))
    commands[0, 0, 0] = commands[1, 0, 1] = 1.0
    distance = np.array([[1.0, 1.0], [0.5, 0.5], [0.01, 0.5], [0.01, 0.01]])
    flight = replace(flight_of(distance, 0.0, commands), craft=replace(CRAFT, thrusters=stronger))
    entry = Entry(Contestant("x", LQR(CRAFT, flight.task, flight.timing), "", ""), flight)
    np.testing.assert_allclose(entry.spent[:, 0], [0.0, 1.0, 1.25, 1.25])
    assert entry.arrival.tolist() == [1.0, 1.5]
    assert entry.arrival_thrust.tolist() == [1.25, 0.0]
    assert entry.name == "x"


def test_shared_thrust_counts_once():
    """Two open nozzles share the worth of one: 0.5 N s in a period of half a second."""
    commands = np.zeros((2, 1, 8))
    commands[:, 0, :2] = 1.0
    flight = flight_of([[1.0]] * 3, 0.0, commands, craft="floating-platform-shared")
    assert entry_of(flight).thrust.tolist() == [1.0]
