"""Bounds per start: in order with each other and with what was found, and why there is no certificate."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from rans_bounds.goal_set import goal_set
from rans_bounds.hull import staying_time
from rans_bounds.problem import SearchEffort, Unreachable
from rans_bounds.starts import (
    Question,
    bound,
    bounds_in_parallel,
    no_certificate,
    no_tube,
    question,
    staying_set,
)
from rans_bounds.transfers import bounds_table

from rans import ConfigError
from rans.episode.scenario import Scenario, each, scenarios
from rans.evaluation.compare.bounds import Bound, Event
from rans.model.fields import Heading, Vec2
from rans.model.spacecraft import Propellant, Spacecraft
from rans.model.spacecraft_file import load_spacecraft
from rans.tasks import GoToPose, GoToPosition, Task
from rans.tasks.goal_set import aims
from tests.support import plugins

plugins.register()
PLATFORM = load_spacecraft("floating-platform")
TASK = GoToPose(spawn_distance=(0.5, 0.6))


def asked(craft: Spacecraft, task: Task, starts: Scenario, horizon: float | None) -> list[Bound]:
    common = (craft, tuple(sorted(aims(task))), goal_set(task), 0.2, horizon, SearchEffort(5.0))
    questions = [Question(*common, one) for one in each(starts)]
    ticks: list[int] = []
    found = [
        answer
        for _, answer in bounds_in_parallel(questions, range(len(questions)), 1, ticks.append)
    ]
    assert len(ticks) == len(found) == len(questions)
    return found


@pytest.mark.parametrize(
    ("craft", "task", "reason"),
    [
        (load_spacecraft("free-flyer-shared"), TASK, "share no supply"),
        (replace(PLATFORM, thrust_sharing="split"), TASK, "thrust_sharing"),
        (PLATFORM, GoToPosition(), "ask for a pose"),
    ],
    ids=["space", "shared", "position"],
)
def test_where_no_certificate_exists_hull_and_tube_count(craft, task, reason):
    assert reason in no_certificate(craft, aims(task), 0.2)
    found = asked(craft, task, scenarios(task, craft, 5, 2), 10.0)
    assert all(answer.lower is None and answer.best >= answer.hull > 0 for answer in found)
    assert [answer.best for answer in found] == pytest.approx(
        [  # whole pulses of 0.2 N s
            math.ceil(max(answer.hull, answer.tube or 0.0) / 0.2) * 0.2 for answer in found
        ]
    )
    table = bounds_table("no", "N s", found, [math.nan, 5.0])
    assert len(table.rows) == 2
    # Only a task that asks for a pose has a tube bound.
    has_tube = craft.dimension == 3 or "attitude" in aims(task)
    assert all((answer.tube is not None) == has_tube for answer in found)
    assert ("tube bound" in table.columns) == has_tube


def test_a_craft_with_propellant_has_no_bound_and_settling_in_space_no_tube():
    tank = replace(PLATFORM, propellant=Propellant(1.0, 60.0))
    with pytest.raises(ConfigError, match="constant mass; it has propellant"):
        bound(0, one_start(craft=tank))
    assert "propellant" in no_tube(tank, aims(TASK))
    craft = load_spacecraft("astrobee-iss")
    task = GoToPose(evaluation_distance=(2.0, 2.5)).for_evaluation()
    [start] = each(scenarios(task, craft, 5, 1))
    effort = SearchEffort(1.0)
    answer = bound(0, question(craft, task, 0.2, Event("settling"), effort, start))
    assert answer.tube is None
    assert answer.best >= answer.hull > 0.0


def test_a_horizon_too_short_for_anything_is_certified():
    start = scenarios(replace(TASK, spawn_distance=(3.0, 4.0)), PLATFORM, 5, 1)
    [answer] = asked(PLATFORM, TASK, start, 2.0)
    assert answer.lower == answer.upper == answer.hull == math.inf
    assert answer.hull == math.inf


def test_a_spin_that_no_pulse_stops_has_no_certificate():
    """Halfway between two spins of the lattice, 0.303 rad/s apart; the goal set allows 0.087 rad/s."""
    [one] = each(scenarios(TASK, PLATFORM, 5, 1))
    spinning = replace(one, start=replace(one.start, w=0.15))
    question = Question(
        PLATFORM, tuple(sorted(aims(TASK))), goal_set(TASK), 0.2, None, SearchEffort(5.0), spinning
    )
    [(_, answer)] = bounds_in_parallel([question], [7], 1)
    assert (answer.start, answer.lower, answer.upper) == (7, None, math.inf)
    assert answer.hull > 0
    assert answer.best == pytest.approx(math.ceil(answer.hull / 0.2) * 0.2)  # whole periods


def one_start(**changes: Any) -> Question:
    [one] = each(scenarios(TASK, PLATFORM, 5, 1))
    question = Question(
        PLATFORM, tuple(sorted(aims(TASK))), goal_set(TASK), 0.2, None, SearchEffort(5.0), one
    )
    return question._replace(**changes)


def test_while_a_gap_is_open_only_its_lower_end_is_proven():
    assert Bound(0, None, 1.0, 2.0, 3.0).best == 2.0
    assert Bound(0, None, 2.5, 2.0, 3.0).best == 2.5  # both are proofs
    assert Bound(0, None, 1.0, tube=1.5).best == 1.5
    assert Bound(0, None, 1.0, 2.0, tube=1.5).best == 2.0
    assert Bound(0, None, 1.01, unit=0.2).best == pytest.approx(1.2)
    assert Bound(0, None, 1.0 - 1e-15, unit=0.2).best == pytest.approx(1.0)
    assert Bound(0, None, math.inf, unit=0.2).best == math.inf


def test_bounds_of_settling_are_below_those_of_arrival():
    """Within 5 cm and 5 degrees at a speed that allows to stay, no rest asked; no control is claimed."""
    [one] = each(scenarios(TASK, PLATFORM, 5, 1))
    settles, arrives = (
        bound(0, question(PLATFORM, TASK, 0.2, Event(kind), SearchEffort(5.0), one))
        for kind in ("settling", "arrival")
    )
    assert settles.lower is not None
    assert arrives.lower is not None
    assert 0 < settles.hull <= settles.lower < arrives.lower
    assert settles.best == pytest.approx(round(settles.best / 0.2) * 0.2)
    assert (settles.event, settles.upper, settles.commands) == (Event("settling"), math.inf, None)
    assert arrives.commands is not None


def test_no_sequence_settles_before_its_bound():
    """All 59,049 of ten periods of 1 N pairs ahead, back and none, 25 cm from the goal, by the exact sums."""
    steps = 10
    period = 0.2
    push = 2.0 / PLATFORM.mass
    told = np.array(list(itertools.product((-1.0, 0.0, 1.0), repeat=steps))) * push
    speed = np.cumsum(np.c_[np.zeros(len(told)), told], axis=1) * period
    way = (speed[:, :-1] + 0.5 * told * period) * period
    place = np.cumsum(np.c_[np.full(len(told), -0.25), way], axis=1)
    stays = np.logical_and.accumulate((np.abs(place) < 0.05)[:, ::-1], axis=1)[:, ::-1]
    settling = (~stays).sum(axis=1) * period
    watched = steps * period - staying_time(PLATFORM, staying_set(PLATFORM, TASK, period), period)
    least = settling[settling <= watched].min()
    [one] = each(scenarios(TASK, PLATFORM, 5, 1))
    near = replace(one, start=replace(one.goal, p=Vec2(one.goal.p.x - 0.25, one.goal.p.y)))  # type: ignore[union-attr]
    found = bound(0, question(PLATFORM, TASK, period, Event("settling"), SearchEffort(1.0), near))
    assert 0.5 * least < found.lower <= least + 1e-9  # diagonal pairs push 1.4 times as hard


@pytest.mark.slow
def test_a_bound_does_not_depend_on_the_clock(monkeypatch):
    """Every call of a clock takes an hour: a slow machine finds the same bounds and commands."""
    asked = [one_start(horizon=6.0), one_start()]
    quick = [bound(0, one) for one in asked]
    for name in ("process_time", "perf_counter", "monotonic", "time"):
        monkeypatch.setattr(f"time.{name}", itertools.count(0, 3600).__next__)
    slow = [bound(0, one) for one in asked]
    assert [replace(one, seconds=0.0) for one in slow] == [
        replace(one, seconds=0.0) for one in quick
    ]


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"horizon": 10.1}, r"whole control periods of 0\.2 s, got 10\.1 s"),
        ({"horizon": math.nan}, "whole control periods"),
        ({"period": 0.0}, r"control period .* above 0, got 0\.0"),
        ({"period": math.nan}, "control period .* above 0"),
    ],
)
def test_times_that_bound_nothing(changes, sentence):
    with pytest.raises(ConfigError, match=sentence):
        list(bounds_in_parallel([one_start(**changes)], [0], 1))


@pytest.mark.parametrize(
    ("field", "value"), [("v", Vec2(math.inf, 0.0)), ("attitude", Heading(math.nan))]
)
def test_what_is_not_finite_is_not_bounded(field, value):
    """It would compare with nothing, and so look impossible at every horizon."""
    question = one_start(horizon=4.0)
    one = question.scenario
    for name in ("start", "goal"):
        wrong = replace(one, **{name: replace(getattr(one, name), **{field: value})})
        with pytest.raises(ConfigError, match=f"finite {name}"):
            list(bounds_in_parallel([question._replace(scenario=wrong)], [0], 1))


def test_a_missing_package_proves_nothing(monkeypatch):
    """Only a proof makes a bound infinite; whatever else stops the search is an error."""

    def missing(*_):
        raise ConfigError("install numba")

    monkeypatch.setattr("rans_bounds.plane.dual.Relaxation._tables", missing)
    for horizon in (None, 10.0):
        with pytest.raises(ConfigError, match="install numba"):
            list(bounds_in_parallel([one_start(horizon=horizon)], [0], 1))


def test_least_time_is_searched_beyond_that_of_a_slow_craft(monkeypatch):
    """Twice the time that no spacecraft beats, and two seconds: 3,600 times the mass needs 60 times as long."""
    asked = []

    def search(proves, problem, steps, *rest):
        asked.append(steps)
        raise Unreachable("not today")

    monkeypatch.setattr("rans_bounds.starts.certified_least_time", search)
    usual = one_start()
    heavy = replace(PLATFORM, mass=3600.0 * PLATFORM.mass)
    slow = usual._replace(craft=heavy)
    for one in (usual, slow):
        least = bound(0, one).hull
        [steps] = asked
        asked.clear()
        assert 0.2 * steps == pytest.approx(2.0 * least + 2.0, abs=0.2)
    assert least > 30.0  # the search of all crafts ended at 25 s


@pytest.mark.parametrize("distance", [30.0, 1e6])
def test_a_start_far_away_has_the_bound_of_the_hull(distance):
    """A lattice so large is not searched. Four nozzles at 45 degrees push ahead half of the way, then back.

    The tolerances of position and speed save 1 % of 15 s.
    """
    (one,) = each(scenarios(TASK, PLATFORM, 2023, 1))
    far = replace(one, start=replace(one.start, p=Vec2(distance, 0.0)))
    answer = bound(0, question(PLATFORM, TASK, 0.2, Event(), SearchEffort(1.0), far))
    push = 4.0 / math.sqrt(2.0) / PLATFORM.mass
    assert answer.upper == math.inf
    assert answer.best == pytest.approx(2.0 * math.sqrt(distance / push), rel=0.02)
