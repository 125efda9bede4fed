"""What the charts of a comparison hold: the flights and bounds behind them are worked out by hand."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from rans.evaluation.compare.bounds import Bound
from rans.evaluation.compare.run import Comparison
from rans.show.figures.chart_figure import save_chart
from rans.show.pages.chart import Chart
from rans.show.pages.comparison_charts import plane_chart
from rans.show.pages.comparison_page import page
from tests.support.comparisons import comparison, entry
from tests.support.evaluation_flights import flight_of

HORIZONS = (1.5, 2.0, 3.0, 4.0, 5.0)
"""1.2, 1.6, 2, 3 and 4 times a least time of 1 s, and all of 5 s, in whole periods of 0.5 s."""


def bounded(**changes: Any) -> Comparison:
    """Starts 0 and 1: times of 0.4 and 0.6 s, impulses of 3 and 5 over the horizon, and 2 more found."""
    bounds = [Bound(k, None, time, time, 2.0) for k, time in ((0, 0.4), (1, 0.6))]
    bounds += [Bound(k, None, 0.1, kind="settling") for k in (0, 1)]
    bounds += [
        Bound(k, h, share / h, share / h, share / h + 2.0)
        for k, share in ((0, 3.0), (1, 5.0))
        for h in HORIZONS
    ]
    found = comparison(certified=bounds, **changes)
    vars(found)["least_time"] = 1.0  # what is kept once it was computed
    return found


def drawn(chart: Chart) -> dict[str, list[tuple[float, float]]]:
    return {one.name: [(mark.x, mark.y) for mark in one.marks] for one in chart.series}


def test_the_plane_draws_bounds_below_what_was_found():
    found = bounded()
    assert found.horizons() == HORIZONS
    chart = plane_chart(found)
    marks = drawn(chart)
    assert marks["certified least impulse at these times"] == [
        pytest.approx((h, 4.0 / h)) for h in HORIZONS
    ]
    assert marks["best on/off controls found, replayed"] == [
        pytest.approx((h, 4.0 / h + 2.0)) for h in HORIZONS
    ]
    ((low, high),) = chart.shaded
    assert (low, high) == (0.0, 0.5)  # the median of 0.4 and 0.6
    assert "impossible: the median is at least 0.50 s" in chart.caption
    # there after 1 and 2 s, both with 1 N s; the third start, from where it never gets there, has no bound
    assert marks["agent"] == [(1.5, 1.0)]
    assert "medians over 2 starts" in chart.caption


def test_a_chart_is_written_for_papers(tmp_path):
    files = save_chart(plane_chart(bounded()), tmp_path / "compare")
    assert [file.name for file in files] == ["compare.svg", "compare.pdf"]
    assert "<svg" in files[0].read_text("utf-8")
    pdf = files[1].read_bytes()
    assert pdf.startswith(b"%PDF")
    assert b"/Type3" not in pdf  # fonts that publishers refuse


def test_one_start_has_no_median_and_no_interval():
    flown = entry()
    alone = replace(flown, flight=flight_of(np.full((11, 1), 0.01), 0.0, np.zeros((10, 1, 8))))
    contest = replace(comparison().contest, episodes=1)
    one = Comparison(contest, [alone])
    chart = plane_chart(one)
    assert "median" not in chart.caption
    assert "interval" not in chart.caption
    html = page(one).html()
    assert "medians over 1 start" not in html
    assert not re.search(r"(\d[\d.]*) to \1 ", html)
    assert "Final errors" not in html
