"""Flights held against bounds, both made by hand."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from rans import TASKS, GoToPose, Timing
from rans.cli.compare import _show
from rans.evaluation.compare.bounds import Bound, Event
from rans.evaluation.compare.contest import Contestant, Entry
from rans.evaluation.compare.run import Comparison
from rans.evaluation.fly.user_policy import user_policy
from rans.evaluation.problems import Problem
from rans.show.pages.comparison_page import page
from rans.show.tables.comparison_tables import gap_table, gaps
from tests.support.contests import CONTEST, IDLE
from tests.support.evaluation_flights import flight_of


@pytest.mark.usefixtures("undrawn")
def test_a_task_may_bound_one_event_alone(monkeypatch, capsys):
    def add(comparison, **_: object) -> None:
        comparison.certified += [Bound(1, None, 2.2), Bound(1, 0.7, 1.0), Bound(2, None, 1.0)]

    own = Problem(lambda _: True, add)
    monkeypatch.setattr("rans.evaluation.compare.run.bounding", lambda _: own)
    found = by_hand(2.0, 1.0, {})
    found.certified.clear()
    found.fly({}, ["optimal"])
    assert found.certified_starts() == [1]
    assert list(gaps(found)) == ["first time in the goal set"]
    assert ["impulse by 0.7 s" in found.failures[0], "start 2" in found.failures[1]] == [True, True]
    assert found.failures[2:] == found.impossible()
    assert "start 1" in found.failures[2]
    _show(found, full=False)
    assert "Times what is certified as least" in capsys.readouterr().out
    assert "Gaps to the certified bounds" in [section.title for section in page(found).sections]


def test_a_package_that_bounds_nothing_is_named(monkeypatch):
    own = Problem(lambda _: True, lambda *_, **__: None)
    monkeypatch.setattr("rans.evaluation.compare.run.bounding", lambda _: own)
    found = Comparison(CONTEST)
    found.fly({}, ["optimal"])
    assert ["gave neither a bound nor a reason" in note for note in found.notes] == [True]


def by_hand(
    arrival: float, thrust: float, bounds: dict[float | None, Bound], settling: float = 0.1
) -> Comparison:
    """Two starts; a flight that is in the goal set from an instant on, having spent as much until then."""
    steps = CONTEST.timing.episode_steps
    distance = np.where(np.arange(steps + 1)[:, None] * 0.2 >= arrival - 1e-9, [[0.01, 0.01]], 1.0)
    commands = np.zeros((steps, 2, 8))
    commands[: round(thrust / 0.2), :, 0] = 1.0
    flight = replace(flight_of(distance, 0.0, commands), timing=CONTEST.timing)
    found = Comparison(replace(CONTEST, episodes=2))
    who = Contestant("x", user_policy(IDLE, CONTEST.craft, CONTEST.task), "", "")
    found.entries.append(Entry(who, flight))
    for start in (0, 1):
        for horizon in (None, *found.horizons()):
            given = (
                bounds.get(horizon, Bound(start, horizon, 0.1))
                if start
                else Bound(start, horizon, 0.1)
            )
            found.certified.append(replace(given, start=start, horizon=horizon))
        found.certified.append(Bound(start, None, settling, kind="settling"))
    return found


def test_each_flight_is_held_against_the_bound_of_its_event():
    """Arrives at 2 s and spends 1 N s, then rests; horizons of 3, 4, 5 and 6 s for a least time of 2.5 s."""
    loose = by_hand(2.0, 1.0, {})
    assert loose.horizons() == pytest.approx((3.0, 4.0, 5.0, 6.0))
    assert loose.impossible() == []
    last = loose.horizons()[-2]
    said = ["x beats the certified bound from start 1: the certificate or a flight is wrong."]
    # 1.8 N s by 5 s is more than the 1 N s spent, though less than the 2 s of arrival
    assert by_hand(2.0, 1.0, {last: Bound(1, last, 1.8)}).impossible() == said
    assert by_hand(2.0, 1.0, {None: Bound(1, None, 1.8)}).impossible() == []
    assert by_hand(2.0, 1.0, {None: Bound(1, None, 2.2)}).impossible() == said
    assert by_hand(2.0, 3.0, {last: Bound(1, last, 2.5)}).impossible() == []
    assert by_hand(2.0, 1.0, {}, settling=2.2).impossible() == [
        said[0].replace("start 1", f"start {k}") for k in (0, 1)
    ]
    # an open gap: what the best controls found need is no bound
    assert by_hand(2.0, 1.0, {None: Bound(1, None, 1.0, 1.8, 2.6)}).impossible() == []
    # exactly at the bound, but for rounding
    assert by_hand(2.0, 1.0, {last: Bound(1, last, 1.0 + 1e-12)}).impossible() == []


def test_bounds_are_lower_and_upper_ends():
    gap = by_hand(2.0, 1.0, {None: Bound(1, None, 1.0, 1.8, 2.6)})
    lower, upper = gap.bounds(Event())
    assert (lower.tolist(), upper.tolist()) == ([0.1, 1.8], [math.inf, 2.6])
    thrusts = [Event(horizon=h) for h in gap.horizons()]
    assert gap.events() == [Event(), Event("settling"), *thrusts]
    ratios = gaps(gap)
    assert ratios["first time in the goal set"]["x"] == pytest.approx([20.0, 2.0 / 1.8])
    assert ratios["impulse by 5 s"]["x"] == pytest.approx([10.0, 10.0])
    late = by_hand(3.4, 1.0, {})
    assert np.isinf(gaps(late)["impulse by 3 s"]["x"]).all()


def test_horizons_scale_with_the_craft():
    """Starts of the platform are 3 to 4 m away; four nozzles of 1 N at 45 degrees push 5.32 kg.

    From rest to rest within 5 cm and 5 cm/s: 2 sqrt(3.5 m / 0.53 m/s^2) = 5.1 s, rounded to 5. Four times
    the mass needs twice that, and the last horizon is the end of the episode.
    """
    usual = Comparison(replace(CONTEST, timing=Timing(), task=GoToPose().for_evaluation()))
    assert usual.least_time == pytest.approx(5.0)
    assert usual.horizons() == pytest.approx((6.0, 8.0, 10.0, 15.0, 20.0, 25.0))
    assert usual.horizons((2.0,)) == pytest.approx((10.0,))
    craft = usual.contest.craft
    heavy = replace(craft, mass=4.0 * craft.mass)
    slow = Comparison(replace(usual.contest, craft=heavy))
    assert slow.least_time == pytest.approx(10.0)
    assert slow.horizons() == pytest.approx((12.0, 16.0, 20.0, 25.0))
    one_period = Comparison(replace(CONTEST, timing=Timing(episode_steps=1)))
    assert one_period.horizons() == (0.2,)


def test_a_fifth_of_the_episode_stands_for_what_has_no_bound():
    """A motion with constraints has none."""
    moving = replace(CONTEST, timing=Timing(), task=TASKS["avoid"]())
    assert Comparison(moving).least_time == pytest.approx(5.0)


def test_medians_of_gaps_count_who_is_not_there():
    both = np.array([1.5, np.inf, 1.2])
    one = np.array([1.5, np.inf, np.inf])
    found = {"time": {"a": both, "b": one}, "thrust": {"a": np.array([])}}
    assert gap_table(found, "").rows == [
        ("a", "1.5 (2 of 3)", None),
        ("b", "never (1 of 3)", None),
    ]
