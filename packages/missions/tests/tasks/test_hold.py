"""Approach to a hold point: hand-worked margins, and equilibria of the orbit."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from rans_missions.convex.rendezvous import Meeting, least_margin, rendezvous, trajectory
from rans_missions.tasks import Hold
from rans_missions.tasks.hold import HoldPlan

from rans.episode.scenario import each, scenarios
from rans.episode.step import Setup, World, step
from rans.model.fields import leaves
from rans.model.spacecraft_file import load_spacecraft
from tests.support.orbit_states import at, goal_of

CHASER = load_spacecraft("vbar-chaser")
SHUT = (0.0,) * 6


def hold_goal() -> Any:
    """The hold point with 1,000 s to the deadline, of a craft that is not there yet."""
    goal = goal_of((0.0, -100.0, 0.0))
    return replace(goal, notes=HoldPlan(**vars(goal.notes) | {"held": np.zeros(1) - 1.0}))


def test_at_rest_on_the_orbit_behind_the_target_is_held_after_ten_minutes():
    """There nothing pulls; 6 m radially outwards it is too far away, and drifts backwards at 1.5 n x."""
    world = World(Setup(CHASER, Hold(), Hold.timing))
    goal = hold_goal()
    episode = world.begin(at((0.0, -104.0, 0.0), (0.0,) * 3), goal)
    # The first check at which it is within the tolerances is at 1 s, and 600 s later is in the 61st period.
    for period in range(1, 62):
        outcome = step(world, episode, SHUT)
        episode = outcome.episode
        assert outcome.done is not None
        assert outcome.done.item() == (period == 61)
    assert episode.state.p.y.item() == -104.0
    away = step(world, world.begin(at((6.0, -100.0, 0.0), (0.0,) * 3), goal), SHUT)
    assert away.episode.goal.notes.held.item() < 0.0


def test_an_arrival_counts_from_before_the_deadline_and_again_after_every_excursion():
    task = Hold()
    inside, outside = (at((0.0, y, 0.0), (0.0,) * 3) for y in (-101.0, -106.0))

    def after(goal, state, seconds):
        return task.remember(task.later(goal, seconds), state)

    # Out for a moment after 590 s: the ten minutes begin anew.
    goal = after(after(hold_goal(), inside, 1.0), inside, 590.0)
    goal = after(after(goal, outside, 1.0), inside, 10.0)
    assert not task.done(inside, after(goal, inside, 20.0)).item()
    # It has come back at 602 s, before the deadline of 1,000 s, and stays past it.
    late = after(goal, inside, 450.0)
    assert not task.done(inside, late).item()
    assert not task.failed(inside, late).item()
    assert task.done(inside, after(late, inside, 150.0)).item()
    assert task.failed(outside, after(late, outside, 1.0)).item()
    # Who arrives after the deadline fails, however long it stays.
    too_late = after(after(hold_goal(), outside, 1005.0), inside, 1.0)
    assert task.failed(inside, too_late).item()
    assert not task.done(inside, after(too_late, inside, 700.0)).item()


def test_the_ball_is_kept_out_of_between_two_commands():
    """Along a chord that passes the target at 40 m, of which both ends are outside."""
    world = World(Setup(CHASER, Hold(), Hold.timing))
    goal = hold_goal()
    crossed = step(world, world.begin(at((40.0, -31.0, 0.0), (0.0, 6.2, 0.0)), goal), SHUT)
    # It begins and ends 50.6 m from the target; at the first second it is 24.8 m along the chord from its middle.
    assert crossed.failed.item()
    assert crossed.margins["keep-out"].item() == pytest.approx(
        math.hypot(40.0, 24.8) - 50.0, abs=0.02
    )
    assert np.linalg.norm(leaves(crossed.episode.state.p)) > 50.0


def test_a_way_around_the_ball_is_found_and_costs_more_than_the_bound():
    """From the far side the cheapest way leads through the ball."""
    task = Hold(deadline=(300.0, 300.0))
    (one,) = each(scenarios(task, CHASER, 1, 1))
    meeting = Meeting.of(CHASER, task, one.goal)
    start = np.array([0.0, 160.0, 0.0, 0.0, 0.0, 0.0])
    answer = rendezvous(meeting, start, 300.0)
    assert least_margin(meeting.limits, trajectory(meeting, start, answer.free)) < 0.0
    assert answer.transfer is not None
    assert least_margin(meeting.limits, trajectory(meeting, start, answer.transfer)) >= 0.0
    assert answer.transfer.impulse > answer.lower
