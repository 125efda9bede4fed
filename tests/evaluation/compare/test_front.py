"""Fronts by hand: places on a broken line, who dominates whom, and multiples of bounds."""

from __future__ import annotations

import math
from copy import deepcopy

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rans.evaluation.compare import certified
from rans.evaluation.compare.bounds import Bound, Event
from rans.evaluation.compare.front import Point, certify_front, judged, least, point
from tests.support.comparisons import entry
from tests.support.fronts import answers, front, named, trade_offs

LINE = [Point(5.0, 20.0, 0.01, 1.0), Point(10.0, 10.0, 0.03, 0.9), Point(20.0, 4.0, 0.02, 1.0)]


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
