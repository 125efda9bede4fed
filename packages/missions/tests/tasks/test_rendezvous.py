"""Rendezvous: hand-worked margins of its cone, and starts, also those of hold."""

import math

import pytest
from rans_missions.tasks import Hold, Rendezvous

from rans.episode.scenario import scenarios
from rans.model.spacecraft_file import load_spacecraft
from tests.support.orbit_states import at, goal_of


def test_the_cone_opens_behind_the_target_and_ends_at_100_m():
    """Its apex is 2 m before the target: a ball of 1 m fits between its sides there."""
    task = Rendezvous()
    goal = goal_of((0.0, 0.0, 0.0))
    margin = task.constraints(at((0.0, 0.0, 0.0), (0.0,) * 3), goal)["cone"]
    assert margin.item() == pytest.approx(1.0, abs=1e-6)
    beside = task.constraints(at((0.0, 30.0, 0.0), (0.0,) * 3), goal)["cone"]
    assert beside.item() == pytest.approx(2.0 * 0.5 - 30.0 * math.cos(math.pi / 6), abs=1e-6)
    assert task.constraints(at((0.0, 200.0, 0.0), (0.0,) * 3), goal)["cone"].item() > 0.0


@pytest.mark.parametrize("task", [Hold(), Rendezvous()], ids=["hold", "rendezvous"])
def test_starts_keep_every_limit_and_plans_come_before_deadlines(task):
    starts = scenarios(task, load_spacecraft(task.spacecraft), 1, 512)
    for margin in task.constraints(starts.start, starts.goal).values():
        assert margin.min() > 0.0
    assert not task.done(starts.start, starts.goal).any()
    plan = starts.goal.notes
    assert (plan.arrival <= plan.deadline).all()
    assert (plan.arrival > 0.0).all()
    assert not plan.won.any()
