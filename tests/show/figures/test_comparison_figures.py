"""What the figures of a comparison draw: the flights and bounds behind them are worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from rans.evaluation.measure.statistics import Estimate
from rans.show.figures.comparison_figures import (
    final_error_curves,
    shares_and_computing_time,
    side_by_side,
)
from rans.show.palette import BLUE, ORANGE
from rans.show.tables.comparison_tables import RETURN
from tests.support.comparisons import entry, points
from tests.support.evaluation_flights import flight_of


def test_errors_and_tolerances_share_their_unit() -> None:
    """1 cm from two starts and 9 m from the third; the tolerance is 5 cm, and 5 degrees of none."""
    position, attitude = final_error_curves([entry()]).axes
    (curve,) = (x for x in position.get_lines() if x.get_label() == "agent")
    assert sorted(np.asarray(curve.get_xdata())[1:]) == pytest.approx([1.0, 1.0, 900.0])
    for axes, label in (
        (position, "position error, mean of the last fifth, cm"),
        (attitude, "attitude error, mean of the last fifth, deg"),
    ):
        assert points(axes)["tolerance"][0][0] == pytest.approx(5.0)
        assert axes.get_xlabel() == label


def test_every_contestant_has_its_row_and_colour() -> None:
    board = {
        "first": {
            RETURN: Estimate(80.0, 70.0, 95.0),
            "computing time, ms": Estimate(2.0, 1.0, 4.0),
        },
        "second": {
            RETURN: Estimate(60.0, 50.0, 65.0),
            "computing time, ms": Estimate(20.0, 10.0, 30.0),
        },
    }
    shares, latency = shares_and_computing_time(board).axes
    for axes, key in ((shares, RETURN), (latency, "computing time, ms")):
        assert axes.get_xlabel() == key
        marks = [bar.lines[0] for bar in axes.containers]  # type: ignore[attr-defined]
        assert [np.asarray(mark.get_xydata()).tolist() for mark in marks] == [
            [[row[key].value, -k]] for k, row in enumerate(board.values())
        ]
        assert [mark.get_color() for mark in marks] == [BLUE, ORANGE]
        bars = [bar.lines[2][0] for bar in axes.containers]  # type: ignore[attr-defined]
        ends = [bar.get_segments()[0][:, 0] for bar in bars]
        np.testing.assert_allclose(ends, [[row[key].low, row[key].high] for row in board.values()])
    assert [text.get_text() for text in shares.get_yticklabels()] == ["first", "second"]
    assert (shares.get_xscale(), latency.get_xscale()) == ("linear", "log")


def test_without_returns_only_computing_time_is_drawn() -> None:
    (only,) = shares_and_computing_time(
        {"first": {"computing time, ms": Estimate(2.0, 1.0, 4.0)}}
    ).axes
    assert only.get_title(loc="left") == "computing time"


def test_flights_side_by_side_have_one_scale() -> None:
    """From the same start, the second for twice as long; its fourth thruster is open at last."""
    commands = np.zeros((20, 3, 8))
    commands[-1, 2, 3] = 1.0
    longer = flight_of(np.full((21, 3), 2.0), 0.0, commands)
    figure = side_by_side([("one", entry().flight, 2), ("two", longer, 2)], 1)
    first, timeline, second, longer_timeline = figure.axes
    assert [axes.get_title(loc="left") for axes in (first, second)] == ["one", "two"]
    assert first.get_xlim() == second.get_xlim()
    assert first.get_ylim() == second.get_ylim()
    way = np.asarray(second.get_lines()[1].get_xydata())
    np.testing.assert_allclose(way, [[-2.0, 0.0]] * 21, atol=1e-12)  # 2 m west of the goal
    low, high = first.get_xlim()
    # from -9 m to the goal, and half a metre around
    assert (low, high) == pytest.approx((-9.5, 0.5))
    assert timeline.get_xlim() == longer_timeline.get_xlim() == (0.0, 10.0)
    shown = np.asarray(longer_timeline.get_images()[0].get_array())
    assert np.argwhere(shown).tolist() == [[3, 19]]
    assert list(longer_timeline.get_images()[0].get_extent())[:2] == [0.0, 10.0]
