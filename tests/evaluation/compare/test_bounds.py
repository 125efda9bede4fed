"""Bounds per start: in order with each other and with what was found, and why there is no certificate."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from rans.evaluation.compare.bounds import Bound, Question, bounds, goal_set, no_certificate, table
from rans.model.fields import Heading, Vec2
from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import load_spacecraft
from rans.optimal.certificate.certificate import Effort
from rans.optimal.trajectory.arrival import aims
from rans.optimal.trajectory.pool import each
from rans.scenario import Scenario, scenarios
from rans.tasks import GoToPose, GoToPosition, Task

PLATFORM, TASK = load_spacecraft("floating-platform"), GoToPose(spawn_distance=(0.5, 0.6))


def asked(craft: Spacecraft, task: Task, starts: Scenario, horizon: float | None) -> list[Bound]:
    common = (craft, tuple(sorted(aims(task))), goal_set(task), 0.2, horizon, Effort(5.0))
    questions = [Question(*common, one) for one in each(starts)]
    ticks: list[int] = []
    found = [answer for _, answer in bounds(questions, range(len(questions)), 1, lambda: ticks.append(1))]
    assert len(ticks) == len(found) == len(questions)
    return found


def test_hull_is_below_certificate_is_below_control_found() -> None:
    for answer in asked(PLATFORM, TASK, scenarios(TASK, PLATFORM, 5, 2), None):
        assert answer.lower is not None
        assert 0 < answer.hull <= answer.lower == answer.best <= answer.upper < 8.0


@pytest.mark.parametrize(("craft", "task", "reason"), [
    (load_spacecraft("free-flyer"), TASK, "planar motion only"),
    (replace(PLATFORM, thrust_sharing="split"), TASK, "thrust_sharing"),
    (PLATFORM, GoToPosition(), "ask for a pose"),
], ids=["space", "shared", "position"])
def test_where_no_certificate_exists_the_hull_counts(craft: Spacecraft, task: Task, reason: str) -> None:
    assert reason in no_certificate(craft, aims(task), 0.2)
    found = asked(craft, task, scenarios(task, craft, 5, 2), 10.0)
    assert all(answer.lower is None and answer.best == answer.hull > 0 for answer in found)
    assert table("no", "N s", found, [math.nan, 5.0]).row_count == 2


def test_a_horizon_too_short_for_anything_is_certified() -> None:
    start = scenarios(replace(TASK, spawn_distance=(3.0, 4.0)), PLATFORM, 5, 1)
    [answer] = asked(PLATFORM, TASK, start, 2.0)
    assert answer.lower == answer.upper == answer.hull == math.inf
    assert answer.hull == math.inf


def test_a_spin_that_no_pulse_stops_has_no_certificate() -> None:
    """Halfway between two spins of the lattice, 0.303 rad/s apart; the goal set allows 0.087 rad/s."""
    [one] = each(scenarios(TASK, PLATFORM, 5, 1))
    spinning = replace(one, start=replace(one.start, w=0.15))
    question = Question(PLATFORM, tuple(sorted(aims(TASK))), goal_set(TASK), 0.2, None, Effort(5.0), spinning)
    [(_, answer)] = bounds([question], [7], 1)
    assert (answer.start, answer.lower, answer.upper) == (7, None, math.inf)
    assert answer.best == answer.hull > 0


def test_who_is_there_already_needs_nothing() -> None:
    [one] = each(scenarios(TASK, PLATFORM, 5, 1))
    there = replace(one, start=replace(one.goal, p=Vec2(one.goal.p.x + 0.04, one.goal.p.y),  # type: ignore[union-attr]
                                       attitude=Heading(one.goal.attitude.angle)))  # type: ignore[union-attr]
    question = Question(PLATFORM, tuple(sorted(aims(TASK))), goal_set(TASK), 0.2, None, Effort(5.0), there)
    [(_, answer)] = bounds([question], [0], 1)
    assert answer.hull == answer.lower == answer.upper == 0.0
