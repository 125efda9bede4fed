"""Goal sets of tasks: who must rest."""

from dataclasses import replace

import pytest

from rans import GoToPosition, TrackVelocity
from rans.model.fields import Vec2
from rans.tasks.goal_set import arrived
from tests.support.evaluation_flights import flight_of


@pytest.mark.parametrize(
    ("speed", "spin", "there"),
    [
        ((0.0, 0.0), 0.0, True),
        ((0.03, 0.03), 0.08, True),
        ((0.04, 0.04), 0.0, False),
        ((0.0, 0.0), -0.09, False),
    ],
)
def test_who_is_at_a_pose_must_rest(speed, spin, there):
    """5 cm/s and 5 degrees/s = 0.0873 rad/s; (4, 4) cm/s is 5.7 cm/s fast."""
    flight = flight_of([[0.01]] * 2, 0.0, None, speed, spin)
    assert arrived(flight.task, flight.states, flight.goals).tolist() == [[there]] * 2


def test_only_what_is_asked_for_must_rest():
    """At a position spin is free; a velocity to track has no place to rest at."""
    spinning = flight_of([[0.01]] * 2, 90.0, spin=1.0, task=GoToPosition())
    assert arrived(spinning.task, spinning.states, spinning.goals).all()
    moving = flight_of([[3.0]] * 2, 0.0, speed=(0.04, 0.0), spin=1.0, task=TrackVelocity())
    assert arrived(moving.task, moving.states, moving.goals).all()


def test_spin_at_rest_is_relative_to_the_goal():
    """A goal that spins is met by who spins with it."""
    flight = flight_of([[0.01]] * 2, 0.0, spin=0.5)
    goals = replace(flight.goals, w=flight.goals.w + 0.5)
    assert arrived(flight.task, flight.states, goals).all()
    assert not arrived(flight.task, flight.states, flight.goals).any()
    moving = flight_of([[0.01]] * 2, 0.0, speed=(0.3, 0.0))
    goals = replace(moving.goals, v=Vec2(moving.goals.v.x + 0.3, moving.goals.v.y))
    assert arrived(moving.task, moving.states, goals).all()
