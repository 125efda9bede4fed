"""Charts: where marks stand, and that names are texts."""

import math
from dataclasses import replace

import pytest

from rans.show.figures.chart_figure import charts_figure
from rans.show.figures.svg import svg
from rans.show.pages.chart import Chart, Mark, Series
from rans.show.pages.page import Page, Picture, Section
from tests.support.comparisons import points

CHART = Chart(
    "time, s",
    "impulse, N s",
    [
        Series("one", [Mark(1.0, 10.0), Mark(2.0, 20.0, (1.5, 3.0))], "red"),
        Series("<b>", [Mark(4.0, 40.0), Mark(math.inf, 1.0)], "blue", "s"),
    ],
    "A & B",
    [(0.0, 1.5)],
    logarithmic="xy",
)


def test_marks_stand_on_the_axes_of_the_chart_and_what_never_happens_does_not():
    (axes,) = charts_figure([CHART]).axes
    assert (axes.get_xscale(), axes.get_yscale()) == ("log", "log")
    assert points(axes) == {"one": [[1.0, 10.0], [2.0, 20.0]], "<b>": [[4.0, 40.0]]}
    (axes,) = charts_figure([replace(CHART, logarithmic="")]).axes
    assert axes.get_xscale() == "linear"


def test_nothing_stands_at_the_low_end_of_a_logarithm():
    """Craft of wheels alone spend no impulse."""
    series = Series("one", [Mark(1.0, 0.0), Mark(2.0, 5.0)], "red")
    (axes,) = charts_figure([replace(CHART, series=[series])]).axes
    (_, wheels), (_, thrusters) = points(axes)["one"]
    assert 0.0 < wheels < thrusters


@pytest.mark.parametrize("logarithmic", ["", "xy"])
def test_who_beats_a_bound_is_seen_left_of_it(logarithmic):
    chart = replace(CHART, logarithmic=logarithmic, shaded=[(0.0, 3.9)])
    (axes,) = charts_figure([chart]).axes
    low, high = axes.get_xlim()
    assert low < 1.0 < 3.9 < high
    (band,) = (one for one in axes.patches if one.get_label() == "provably impossible")
    assert band.get_extents().x1 == pytest.approx(axes.transData.transform((3.9, 1.0))[0])  # type: ignore[attr-defined]


def test_names_are_neither_mathematics_nor_mark_up_and_unknown_markers_are_discs():
    series = Series("$x_<b>", [Mark(1.0, 2.0), Mark(2.0, 3.0)], "var(--soft)", "no such")
    chart = replace(CHART, x_label="$m\x01, s", series=[series])
    assert "<b>" not in svg(charts_figure([chart]))
    html = Page("t", [Section("s", pictures=[Picture.of(replace(chart, caption="<b>"))])]).html()
    assert "<b>" not in html
    assert "&lt;b&gt;</figcaption>" in html
    assert html.count('<img src="data:image/svg+xml;base64,') == 1


def test_a_chart_of_nothing_is_empty():
    assert replace(CHART, series=[Series("one", [Mark(math.inf, 1.0)], "red")]).is_empty
    assert not CHART.is_empty
