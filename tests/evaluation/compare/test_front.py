"""Fronts by hand: places on a broken line, who dominates whom, and multiples of bounds."""

from __future__ import annotations

import math
from copy import deepcopy
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rans.evaluation.compare import certified
from rans.evaluation.compare.bounds import Bound, Event
from rans.evaluation.compare.contest import Contest, Contestant, Entry
from rans.evaluation.compare.front import Front, Point, certify_front, judged, least, point
from rans.show.pages.comparison_charts import front_chart
from rans.show.pages.comparison_page import page
from rans.show.tables.comparison_tables import to_json
from rans.show.tables.front_tables import front_table, sentences
from tests.support.comparisons import NOBODY, comparison, entry

LINE = [Point(5.0, 20.0, 0.01, 1.0), Point(10.0, 10.0, 0.03, 0.9), Point(20.0, 4.0, 0.02, 1.0)]
HORIZONS = (2.0, 5.0)


@pytest.mark.parametrize(
    ("what", "given", "limit", "place"),
    [
        (
            "impulse",
            "time",
            6.0,
            (6.0, 18.0, 0.014, 0.98),
        ),  # a fifth of the way from the first to the second
        ("impulse", "time", 10.0, LINE[1]),
        ("impulse", "time", 99.0, LINE[2]),
        ("impulse", "time", 4.9, None),
        ("time", "impulse", 7.0, (15.0, 7.0, 0.025, 0.95)),  # half-way from the second to the third
        ("time", "impulse", 99.0, LINE[0]),
        ("time", "impulse", 3.9, None),
    ],
)
def test_places_on_a_line(
    what: str, given: str, limit: float, place: tuple[float, ...] | None
) -> None:
    found = least(LINE, what, given, limit)
    assert found == (place and pytest.approx(place))


def test_a_line_may_bend_back() -> None:
    """Slower and dearer at first: until 6.25 s, where the last piece is down at 20 again, nothing is won."""
    line = [Point(5.0, 20.0, 0.0, 1.0), Point(6.0, 22.0, 0.0, 1.0), Point(8.0, 6.0, 0.0, 1.0)]
    assert least(line, "impulse", "time", 6.2) == line[0]
    assert least(line, "impulse", "time", 7.0) == pytest.approx((7.0, 14.0, 0.0, 1.0))
    assert least(line, "time", "impulse", 21.0) == line[0]


@pytest.mark.parametrize(
    ("other", "dominates"),
    [
        (Point(6.0, 20.0, 0.02, 0.9), True),  # 18 N s in 6 s, 5 s with 20 N s
        (Point(6.0, 20.0, 0.012, 0.9), False),  # but an error of 0.014 in 6 s
        (Point(6.0, 20.0, 0.02, 0.99), False),  # but there from 98 % only in 6 s
        (Point(6.0, 18.0, 1.0, 0.0), False),  # on the line
        (Point(4.0, 99.0, 1.0, 0.0), False),
        (Point(99.0, 3.0, 1.0, 0.0), False),  # quicker; thriftier than all
        (Point(30.0, 4.5, 0.1, 0.5), True),
    ],
)  # slower than all, and dearer than the last
def test_who_is_dominated(other: Point, dominates: bool) -> None:
    assert judged(LINE, other).dominates == dominates


def named(name: str, trade_off: float | None = None, **changes: Any) -> Entry:
    """See `entry`: there after 1 s, 2 s and never; in all 2, 1 and 0 N s, of which 1 and 1 until there."""
    return replace(entry(), contestant=Contestant(name, NOBODY, "", "", trade_off), **changes)


def answers(own: tuple[float, float] = (0.4, 0.6)) -> list[Bound]:
    """Of all three starts: nobody in 0.5 s, 0.2 N s by each horizon; and for 1 and 2 s of the first two."""
    found = [
        Bound(k, horizon, 0.5 if horizon is None else 0.2)
        for k in range(3)
        for horizon in (None, *HORIZONS)
    ]
    return [
        Bound(1, 2.0, own[1]) if (one.start, one.horizon) == (1, 2.0) else one
        for one in (*found, Bound(0, 1.0, own[0]))
    ]


def front(*entries: Entry, **changes: Any) -> Front:
    flight = entries[0].flight
    return Front(
        Contest(flight.craft, flight.task, flight.timing, 1, 3), HORIZONS, [*entries], **changes
    )


def test_where_somebody_stands() -> None:
    """Who is never there counts with all 5 s; errors of 1, 1 and 900 cm."""
    assert point(entry()) == pytest.approx((8 / 3, 1.0, 9.02 / 3, 2 / 3))


def test_multiples_are_of_bounds_of_the_same_starts_and_times() -> None:
    found = front(named("agent"), certified=answers())
    assert found.events(0) == [Event(), Event(horizon=2.0), Event(horizon=5.0), Event(horizon=1.0)]
    assert found.events(2) == [Event(), Event(horizon=2.0), Event(horizon=5.0)]  # never there
    assert found.starts() == [0, 1, 2]
    # 2 and 1 N s in all, 1 and 1 until there, of 0.4 and 0.6. The first is there in twice the least time, and
    # spends 2.5 times what 1 s takes; the second in four times, and spends 1 / 0.6 times what 2 s take.
    assert found.multiple(found.entries[0]) == pytest.approx(
        (3.0, 2.0, 0.5, 1.5, (2.0 + 1.0 / 0.6) / 2.0, 2)
    )
    assert found.front() == pytest.approx(
        {Event(): 0.5, Event(horizon=2.0): 1.0 / 3, Event(horizon=5.0): 0.2}
    )
    assert not list(found.impossible())
    unknown = front(
        named("agent"), certified=answers()[:-1]
    )  # the first one's own time is not known
    assert unknown.starts() == [1, 2]
    assert front(named("agent")).multiple(found.entries[0]) is None
    assert front(named("agent")).front() == {}


@given(
    st.integers(1, 25), st.integers(0, 24), st.lists(st.floats(0.0, 1.0), min_size=25, max_size=25)
)
def test_behind_the_front_by_trying_factors(own: int, least_time: int, falls: list[float]) -> None:
    """All bounds known, in periods of 0.5 s: a little more is excluded, a little less is not."""
    one = named("agent")
    vars(one)["arrival"] = np.array([0.5 * own, math.inf, math.inf])
    spent = float(one.arrival_thrust[0])
    bounds = np.cumsum(falls)[::-1]  # by the end of period 1, 2, ..., never more than before
    bounds = bounds * min(1.0, spent / (bounds[own - 1] or 1.0))  # the flight itself beats none
    found = front(
        one,
        certified=[
            Bound(0, None, 0.5 * min(least_time, own)),
            *(Bound(0, 0.5 * k, float(bound)) for k, bound in enumerate(bounds, 1)),
        ],
    )

    def excluded(factor: float) -> bool:
        periods = math.floor(own / factor)
        return periods < min(least_time, own) or spent / factor < bounds[max(periods, 1) - 1]

    factor = found.behind(one, 0)
    assert math.isinf(factor) or excluded(factor * (1.0 + 1e-9))
    assert not excluded(min(factor, 1e9) * (1.0 - 1e-9))


def test_from_a_start_that_moves_nobody_can_wait() -> None:
    found = front(named("agent"), certified=answers())
    vars(found.contest)["starts"] = moved = deepcopy(found.contest.starts)
    moved.start.v.x[0] = 0.01
    assert math.isinf(found.behind(found.entries[0], 0))
    assert found.behind(found.entries[0], 1) == pytest.approx(1.0 / 0.6)


@pytest.mark.parametrize("wrong", [(1.1, 0.6), (0.4, 1.1)])
def test_who_beats_a_bound_is_found_out(wrong: tuple[float, float]) -> None:
    told = list(front(named("agent"), certified=answers(wrong)).impossible())
    assert told == [
        f"agent beats the certified front from start {wrong.index(1.1)}: the certificate or a "
        "flight is wrong."
    ]


def trade_offs() -> Front:
    """A line from 1 N s to a half, and somebody beside it who needs four times that."""
    fast = named("agent#0", 0.0)
    thrifty = named("agent#1", 1.0)
    dear = named("dear")
    thrifty.flight.commands[:] *= 0.5
    dear.flight.commands[:] *= 4.0
    return front(thrifty, dear, fast, named("held#0.5", 0.5), certified=answers())


def test_indicators_of_a_line_by_hand() -> None:
    """The thrifty position is there after 1, 2 s and never, with 0.5 N s.

    Of the first start 0.2 N s are certified by 2 and 5 s: it spends 2.5 times that, more than the corner's
    0.4 N s. Of the second 0.6 and 0.2 N s: 2.5 times the latter, and it dominates 3 s x 0.7 N s up to the
    corner (5 s, 1.2 N s), where the bounds leave 4.5 x 0.6 + 3 x 0.4. From the third nothing arrives.
    """
    found = trade_offs()
    indicators = found.indicators(found.lines()["agent"])
    assert indicators is not None
    assert indicators.epsilon == pytest.approx(2.5)
    assert indicators.hypervolume == pytest.approx(2.1 / 3.9 / 3)
    assert (indicators.first, indicators.last, indicators.starts) == (2.0, 5.0, 3)
    assert front(named("agent")).indicators([named("agent")]) is None


def test_how_sure_a_line_is() -> None:
    """Better on every draw of three starts but one of 27: three times the third, from where nobody spends."""
    found = trade_offs()
    line = found.lines()["agent"]
    (dear, held) = found.others()
    quicker = named("quicker#0", 0.0)
    vars(quicker)["arrival"] = np.array([0.5, 0.5, 0.5])
    sure = found.chance([quicker, *line], dear)
    assert sure == pytest.approx(26 / 27, abs=0.02)  # 3 standard deviations of 1,000 draws
    assert found.chance(line, held) == 0.0


def test_words_and_figures_of_a_front() -> None:
    found = trade_offs()
    assert [*found.lines()] == ["agent"]  # from fast to thrifty; one position makes no line
    assert [one.name for one in found.lines()["agent"]] == ["agent#0", "agent#1"]
    assert [one.name for one in found.others()] == ["dear", "held#0.5"]
    columns, rows = front_table(found)
    assert columns[4] == "position error, cm"
    assert rows[0] == ["agent#0", "66.7", "2.67", "1", "301", "1.83", "2", "3"]
    assert [row[3] for row in rows] == ["1", "0.5", "4", "1"]
    assert [*sentences(found)] == [
        "agent does not dominate dear: in 2.667 s 0.5 N s instead of 4, but with 4 N s it is no quicker.",
        "agent does not dominate held#0.5: in 2.667 s 0.5 N s instead of 1, but with 1 N s it is no quicker.",
        "agent is behind the nearest point of the certified front, in time and impulse at once, by factors "
        "of 1.83 at 0, 1.04 at 1.",
        "agent spends, in multiples of the certified least impulse for its own times, 3.00 at 0, 1.50 at 1.",
        "agent against the whole certified front from 2 to 5 s: epsilon indicator 2.5 (median), 17.9 % of its "
        "hypervolume (mean), 3 starts.",
        "Everybody together against the whole certified front from 2 to 5 s: epsilon indicator 2.5 (median), "
        "17.9 % of its hypervolume (mean), 3 starts.",
    ]
    chart = front_chart(found)
    drawn = {one.name: [(mark.x, mark.y) for mark in one.marks] for one in chart.series}
    assert drawn["agent, trade-off at 2 positions"] == [
        pytest.approx((8 / 3, 1.0)),
        pytest.approx((8 / 3, 0.5)),
    ]
    assert drawn["dear (66.7 % get there)"] == [pytest.approx((8 / 3, 4.0))]
    bars = drawn["certified least impulse at this time from each start, mean of 3 starts"]
    assert bars == [pytest.approx((2.0, 1 / 3)), pytest.approx((5.0, 0.2))]
    assert [bounds for *bounds, _ in chart.shaded] == [[0.0, 0.5]]


@pytest.mark.usefixtures("undrawn")
def test_page_and_file_have_the_front() -> None:
    found = trade_offs()
    told = comparison(front=found)
    assert "Front of time and impulse" in [section.title for section in page(told).sections]
    read = to_json(told, "")["front"]
    assert read["points"]["agent#0"]["over_bound"]["episode"] == pytest.approx(3.0)
    assert read["dominates"] == {"agent": {"dear": False, "held#0.5": False}}
    assert read["certified"]["starts"] == [0, 1, 2]
    assert to_json(comparison(), "")["front"] is None


def test_the_budget_ends_the_search(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each answer takes 10 s of a clock of ours; what is found in time is kept."""
    clock = iter(np.arange(0.0, 1e3, 10.0))
    monkeypatch.setattr("rans.evaluation.compare.front.time.monotonic", lambda: float(next(clock)))
    monkeypatch.setattr(
        certified,
        "bounds_in_parallel",
        lambda asked, starts, *_: (
            (k, Bound(starts[k], one.horizon, 0.1)) for k, one in enumerate(asked)
        ),
    )
    for seconds, count in ((35.0, 4), (math.inf, 10), (0.0, 0)):
        found = front(named("agent"))
        certify_front(found, seconds)
        assert len(found.certified) == count
