"""What a comparison's tables, page and files say, of flights whose every figure is worked out by hand."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from rans.evaluation.compare.bounds import Bound
from rans.evaluation.compare.contest import Contestant, Entry
from rans.evaluation.compare.run import Comparison
from rans.model.fields import map_leaves
from rans.show.pages.comparison_page import page
from rans.show.tables.comparison_tables import (
    RETURN,
    dominations,
    gaps,
    scoreboard,
    to_json,
    verdict,
)
from tests.support.comparisons import NOBODY, comparison
from tests.support.evaluation_flights import flight_of


def certified(best: float) -> list[Bound]:
    """Every question about the first two starts: the bound, and twice as much found."""
    horizons = comparison().horizons()
    settling = [Bound(k, None, best / 2, best / 2, kind="settling") for k in (0, 1)]
    return settling + [
        Bound(k, horizon, best, best, 2 * best) for k in (0, 1) for horizon in (None, *horizons)
    ]


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("solved, %", 200 / 3),
        ("settling time, s", 2.0),
        ("first in the goal set, s", 2.0),
        ("impulse until then, N s", 1.0),  # 1, 1 and never: the middle one
        ("impulse of the episode, N s", 1.0),  # of 2, 1 and 0
        ("position error, cm", 902 / 3),
    ],
)
def test_scores_by_hand(key, value):
    assert scoreboard(comparison())["agent"][key].value == pytest.approx(value)


def test_a_task_to_the_end_of_the_episode_says_how_many_broke_a_limit():
    """One of three flights is inside a zone at one instant; of a task without limits nothing is said."""
    found = comparison()
    assert "limit broken, %" not in scoreboard(found)["agent"]
    entry = next(one for one in found.entries if one.name == "agent")
    margins = np.ones((len(entry.flight.commands), 3))
    margins[0, 2] = -0.01
    limited = replace(entry, flight=replace(entry.flight, margins={"zone": margins}))
    vars(limited.flight)["verdict"] = entry.flight.verdict  # that of a task without limits
    found.entries[:] = [limited]
    assert scoreboard(found)["agent"]["limit broken, %"].value == pytest.approx(100 / 3)


def beside(count: int = 12, /, **others: tuple[float, float]) -> Comparison:
    """Flights to the goal: "ours" arrives after 5 s with 3 N s, the others as given, each less a little."""
    found = comparison()
    entries = []
    for name, (time, impulse) in {"ours": (5.0, 3.0), **others}.items():
        steps = np.arange(41)[:, None] * 0.5
        late = time + np.where(np.arange(count) < 6, 0.0, 1.0)
        distance = np.where(steps >= late, 0.01, 1.0)
        commands = np.zeros((40, count, 8))
        commands[: round(impulse / 0.5), :, 0] = 1.0
        flight = flight_of(distance, 0.0, commands)
        flight = replace(flight, timing=replace(flight.timing, control_period=0.5))
        entries.append(Entry(Contestant(name, NOBODY, "", ""), flight))
    contest = replace(found.contest, episodes=count, timing=entries[0].flight.timing)
    return Comparison(contest, entries)


@pytest.mark.parametrize(
    ("others", "taken", "relation"),
    [
        ({"x": (4.0, 2.0)}, "x", "quicker and cheaper than ours"),
        ({"x": (4.0, 2.0), "y": (3.0, 1.0)}, "y", "quicker and cheaper than ours and x"),
        ({"x": (6.0, 4.0)}, "ours", "quicker and cheaper than x"),
        ({"x": (5.0, 4.0)}, "ours", "not significantly slower than x, at 0.75 of its impulse"),
        ({"x": (5.0, 4.0), "slow": (9.0, 1.5)}, "ours", "not significantly slower than x, at"),
        ({"x": (4.0, 4.0)}, "ours", "nobody is shown to be quicker and cheaper"),
        # It stays where it is, for nothing.
        ({"idle": (1e3, 0.0)}, "ours", "nobody is shown to be quicker and cheaper"),
    ],
)
def test_a_comparison_says_first_whom_to_take(others, taken, relation):
    first, *rest = verdict(beside(**others))
    assert first.startswith(f"Take {taken} (")
    assert relation in first
    assert len(rest) <= 2
    assert ("idle (0 %)" in " ".join(rest)) == ("idle" in others)


def test_who_does_not_always_arrive_dominates_nobody():
    """Quicker and cheaper in eleven of twelve flights; the last one never arrives."""
    found = beside(x=(4.0, 2.0))
    theirs = found.entries[1]
    assert dominations(found) == [("x", "ours")]

    def lost(field):
        field = field.copy()
        field[:, 11] = field[0, 11]
        return field

    moved = map_leaves(lost, theirs.flight.states)
    found.entries[1] = replace(theirs, flight=replace(theirs.flight, states=moved))
    assert dominations(found) == []
    assert verdict(found)[0].startswith("Take ours")
    assert "x (91.7 %)" in verdict(found)[-1]


def test_the_page_of_a_comparison_says_it_first():
    found = beside(x=(4.0, 2.0), y=(3.0, 1.0))
    assert page(found).hero == " ".join(verdict(found))


@pytest.mark.parametrize(
    ("count", "said"), [(1, "from 1 start: at 95 %"), (5, "from 5 starts: "), (6, "Take x")]
)
def test_fewer_than_six_starts_show_nothing(count, said):
    """x is better from every start, and of five differences all have one sign by chance in one case of sixteen."""
    found = beside(count, x=(4.0, 2.0))
    assert dominations(found) == ([("x", "ours")] if count == 6 else [])
    assert said in verdict(found)[0]


def test_an_advantage_from_a_few_starts_is_not_claimed():
    """Sooner from half of the starts and later from the other half: neither is quicker."""
    found = beside(x=(5.0, 3.0))
    theirs = found.entries[1]
    moved = map_leaves(lambda x: np.roll(x, 6, axis=1), theirs.flight.states)
    found.entries[1] = replace(theirs, flight=replace(theirs.flight, states=moved))
    assert "nobody is shown to be quicker and cheaper" in verdict(found)[0]


def test_the_mean_of_thrust_is_no_median():
    found = comparison()
    found.entries[0].flight.commands[:, 2, 0] = 1.0  # 5 N s: 2, 1 and 5 have a mean of 2.67
    board = scoreboard(found)["agent"]
    assert board["impulse of the episode, N s"].value == pytest.approx(8 / 3)


def test_gaps_leave_out_what_has_no_bound():
    """Arrived after 1 and 2 s where nobody can before 0.5 s; a bound of 0 says nothing about thrust."""
    bounds = [
        replace(b, hull=0.0, lower=0.0) if b.horizon and b.start else b for b in certified(0.5)
    ]
    found = gaps(comparison(certified=bounds))
    assert found["first time in the goal set"]["agent"].tolist() == [2.0, 4.0]
    assert found["first time in the goal set"]["best found"].tolist() == [2.0, 2.0]
    assert found["settling time"]["agent"].tolist() == [4.0, 8.0]  # of a bound of 0.25 s
    assert "best found" not in found["settling time"]
    assert all(
        len(ratios["agent"]) == 1 for question, ratios in found.items() if "impulse" in question
    )


@pytest.mark.usefixtures("undrawn")
def test_a_multiple_of_the_bound_is_the_median_of_multiples():
    """1 s over 0.25 s and 2 s over 1 s: 4 and 2; the medians of both, 1.5 s over 0.625 s, would give 2.4."""
    bounds = [
        replace(b, hull=0.1, lower=1.0 if b.start else 0.25, upper=9.0) for b in certified(0.1)
    ]
    rows = tables_of(page(comparison(certified=bounds)))["Times the bound, median"]
    assert rows[0][:2] == ["agent", "3 (2 of 2)"]


def tables_of(shown: Any) -> dict[str, list[list[Any]]]:
    return {
        table.title: [list(row) for row in table.rows] for s in shown.sections for table in s.tables
    }


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(
    ("best", "passed", "proven"), [(0.5, True, "0 of 2"), (3.0, False, "0 of 2")]
)
def test_the_page_says_whether_a_bound_is_beaten(best, passed, proven):
    shown = page(comparison(certified=certified(best)))
    assert (passed, f"flights that beat a certified bound: {0 if passed else 2}") in shown.checks
    assert shown.passed is passed
    rows = tables_of(shown)["The bounds (s and N s)"]
    assert rows[0] == ["first time in the goal set", best, 2 * best, proven]
    assert rows[1] == ["settling time", best / 2, None, None]


@pytest.mark.usefixtures("undrawn")
def test_a_closed_gap_is_proven_optimal():
    bounds = [replace(b, upper=b.best) if b.start else b for b in certified(0.5)]
    assert (
        tables_of(page(comparison(certified=bounds)))["The bounds (s and N s)"][0][-1] == "1 of 2"
    )


def test_the_file_says_who_settled():
    """Settled is not arrived: a flight that leaves again has arrived."""
    found = comparison()
    found.entries[0].flight.states.p.x[-1, 1] -= 1.0
    table = to_json(found, "text")
    each = [
        (row["arrival"], row["arrival_for_good"], row["thrust_to_arrive"])
        for row in table["per_start"]["contestants"]["agent"]
    ]
    assert each == [(1.0, 1.0, 1.0), (2.0, math.inf, 1.0), (math.inf, math.inf, math.inf)]
    (row,) = table["summary"]
    assert (row["solved"], row["starts"], row["mean_impulse"]) == (1, 3, pytest.approx(1.0))
    assert RETURN not in to_json(found, "")["estimates"]["agent"]
