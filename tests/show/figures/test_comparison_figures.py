"""What the figures of a comparison draw: the flights and bounds behind them are worked out by hand."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from rans.evaluation.compare.bounds import Bound
from rans.evaluation.compare.contest import Contestant
from rans.evaluation.compare.relaxed import Relaxed
from rans.evaluation.compare.run import Comparison
from rans.evaluation.measure.statistics import Estimate
from rans.optimal.trajectory.objectives import MaximumReward, MinimumFuel, MinimumTime
from rans.show.figures.comparison_figures import (
    final_error_curves,
    plane,
    shares_and_latency,
    side_by_side,
)
from rans.show.figures.panels import BLUE, ORANGE, RED
from rans.show.tables.comparison_tables import RETURN
from tests.support.comparisons import NOBODY, comparison, entry, points
from tests.support.evaluation_flights import flight_of

HORIZONS = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0)
"""0.24, 0.32, 0.4, 0.6, 0.8 and all of 5 s, s: whole periods of 0.5 s."""


def bounded(**changes: Any) -> Comparison:
    """Starts 0 and 1: times of 0.4 and 0.6 s, thrust-times of 3 and 5 over the horizon, and 2 more found."""
    bounds = [Bound(k, None, time, time, 2.0) for k, time in ((0, 0.4), (1, 0.6))]
    bounds += [Bound(k, None, 0.1, kind="settling") for k in (0, 1)]
    bounds += [
        Bound(k, h, share / h, share / h, share / h + 2.0)
        for k, share in ((0, 3.0), (1, 5.0))
        for h in HORIZONS
    ]
    return comparison(certified=bounds, **changes)


def test_the_plane_draws_bounds_below_what_was_found() -> None:
    found = bounded()
    assert found.horizons() == HORIZONS
    axes, _ = plane(found).axes
    drawn = points(axes)
    assert [x for x, _ in drawn["certified least time to arrive"]] == [
        0.5,
        0.5,
    ]  # the median of 0.4 and 0.6
    assert drawn["certified least thrust-time at these times"] == [
        pytest.approx([h, 4.0 / h]) for h in HORIZONS
    ]
    assert drawn["best on/off controls found, replayed"] == [
        pytest.approx([h, 4.0 / h + 2.0]) for h in HORIZONS
    ]
    (impossible,) = (patch for patch in axes.patches if "impossible" in str(patch.get_label()))
    assert impossible.get_extents().x1 == pytest.approx(
        axes.transData.transform((0.5, 1.0))[0], rel=1e-9
    )
    # there after 1 and 2 s, both with 1 N s; the third start, from where it never gets there, has no bound
    assert drawn["agent"] == [[1.5, 1.0]]
    assert (axes.get_xlabel(), axes.get_ylabel()) == (
        "time of first arrival, s",
        "thrust-time until then, N s",
    )
    assert axes.get_title(loc="left").endswith("medians over 2 starts")


def test_the_plane_counts_all_starts_where_no_bound_is_known() -> None:
    """Relaxed points are medians of what was solved, and say so; curves go through the medians of weights."""
    one = Relaxed(MinimumTime(), 0, "solved", True, 0.1, 4.0, 3.0, 7.0, 30.0, 1e-4)
    fuel, reward = (
        replace(one, objective=kind, arrival=6.0, thrust=2.0)
        for kind in (MinimumFuel(5.0, 0.5), MaximumReward(5.0, 0.5))
    )
    other = replace(one, start=1, arrival=6.0, thrust=9.0)
    lost = replace(one, start=2, solved=False)
    rows = {"time": [one, other, lost], "fuel": [fuel] * 3, "reward": [reward] * 3}
    axes, _ = plane(comparison(relaxed=rows, curve=[entry()])).axes
    drawn = points(axes)
    assert drawn["agent (2 of 3 arrive)"] == [
        [2.0, 1.0]
    ]  # 1 s, 2 s and never; 1 N s, 1 N s and never
    # the greatest reward arrives nowhere: two points
    assert drawn["relaxed thrust, exact goal (no controller, where found)"] == [
        [5.0, 8.0],
        [6.0, 2.0],
    ]
    assert drawn["LQR, 1 weight"] == [[2.0, 1.0]]
    assert "medians over 3 starts" in axes.get_title(loc="left")


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
        "first": {RETURN: Estimate(80.0, 70.0, 95.0), "latency, ms": Estimate(2.0, 1.0, 4.0)},
        "second": {RETURN: Estimate(60.0, 50.0, 65.0), "latency, ms": Estimate(20.0, 10.0, 30.0)},
    }
    shares, latency = shares_and_latency(board).axes
    for axes, key in ((shares, RETURN), (latency, "latency, ms")):
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


def test_without_returns_only_latency_is_drawn() -> None:
    (only,) = shares_and_latency({"first": {"latency, ms": Estimate(2.0, 1.0, 4.0)}}).axes
    assert only.get_title(loc="left") == "latency"


def test_flights_side_by_side_have_one_scale() -> None:
    """From the same start, the second for twice as long; its fourth thruster is open at last."""
    commands = np.zeros((20, 3, 8))
    commands[-1, 2, 3] = 1.0
    longer = flight_of(np.full((21, 3), 2.0), 0.0, commands)
    figure = side_by_side([("one", entry().flight, 2), ("two", longer, 2)])
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


def test_who_comes_next_has_another_look() -> None:
    found = bounded()
    again = Contestant("second", NOBODY, "observation", "none")
    found.entries.append(replace(found.entries[0], contestant=again))
    axes, _ = plane(found).axes
    looks = {
        str(bar.get_label()): (bar.lines[0].get_color(), bar.lines[0].get_marker())  # type: ignore[attr-defined]
        for bar in axes.containers
    }
    assert looks == {"agent": (BLUE, "o"), "second": (ORANGE, "s")}
    rings = next(x for x in axes.get_lines() if str(x.get_label()).startswith("best on/off"))
    assert rings.get_markeredgecolor() == RED
