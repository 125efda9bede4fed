"""Charts of pages: where marks stand, what they say, and that names are no mark-up."""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from dataclasses import replace

import pytest

from rans.show.figures.chart_figure import charts_figure
from rans.show.pages.chart import Chart, Mark, Series
from rans.show.pages.page import Page, Section

SVG = "{http://www.w3.org/2000/svg}"
CHART = Chart(
    "time, s",
    "impulse, N s",
    [
        Series("one", [Mark(1.0, 10.0, "one: 1 s"), Mark(2.0, 20.0, "late", (1.5, 3.0))], "red"),
        Series("<b>", [Mark(4.0, 40.0, "<i>"), Mark(math.inf, 1.0, "never")], "blue", "s"),
    ],
    "A & B",
    [(0.0, 1.5, "impossible")],
    logarithmic=True,
)


def parts(chart: Chart, tag: str) -> list[ET.Element]:
    return [*ET.fromstring(chart.svg()).iter(f"{SVG}{tag}")]


def places(chart: Chart) -> dict[str, tuple[float, float]]:
    """Where the mark with each text stands."""
    return {
        mark.get("aria-label", ""): (float(mark.get("x", "")), float(mark.get("y", "")))
        for mark in parts(chart, "use")
        if mark.get("class") == "point"
    }


def test_equal_ratios_are_equal_ways_on_logarithmic_axes() -> None:
    at = places(CHART)
    first, second, third = at["one: 1 s"], at["late"], at["<i>"]
    for k, sign in ((0, 1), (1, -1)):  # upwards is less in a picture
        assert sign * (second[k] - first[k]) > 0
        assert second[k] - first[k] == pytest.approx(third[k] - second[k], abs=0.2)


def test_nothing_stands_at_the_low_end_of_a_logarithm() -> None:
    """Craft of wheels alone spend no impulse."""
    marks = [Mark(1.0, 0.0, "wheels"), Mark(2.0, 5.0, "thrusters")]
    at = places(replace(CHART, series=[Series("one", marks, "red")]))
    assert at["wheels"][1] > at["thrusters"][1]
    at = places(replace(CHART, series=[Series("one", marks[:1], "red")]))
    assert all(map(math.isfinite, at["wheels"]))


def test_on_linear_axes_differences_are() -> None:
    at = places(replace(CHART, logarithmic=False, shaded=()))
    assert at["<i>"][0] - at["late"][0] == pytest.approx(
        2 * (at["late"][0] - at["one: 1 s"][0]), abs=0.2
    )


def test_what_never_happens_is_not_drawn_and_names_are_text() -> None:
    text = CHART.svg()
    assert "never" not in text
    assert "<b>" not in text
    assert "<i>" not in text
    root = ET.fromstring(text)
    assert root.get("aria-label") == "A & B"
    titles = [one.text for one in root.iter(f"{SVG}title")]
    assert titles == ["impossible", "one: 1 s", "late", "<i>"]


def test_the_shaded_range_ends_where_its_bound_is() -> None:
    """1.5 lies between 1 and 2 as log 1.5 between 0 and log 2."""
    at = places(CHART)
    (band,) = (
        shape
        for group in parts(CHART, "g")
        if group.find(f"{SVG}title") is not None
        for shape in group.iter(f"{SVG}path")
    )
    edge = max(float(x) for x in re.findall(r"[ML] ([\d.]+) ", band.get("d", "")))
    share = math.log(1.5) / math.log(2.0)
    expected = at["one: 1 s"][0] + share * (at["late"][0] - at["one: 1 s"][0])
    assert edge == pytest.approx(expected, abs=0.2)


def test_a_page_has_a_button_for_every_series_and_fetches_nothing() -> None:
    page = Page("t", [Section("s", charts=[CHART])]).html()
    assert len(re.findall(r"<button[^>]*data-series", page)) == 2
    assert "&lt;b&gt;</button>" in page
    assert not re.search(r"(?:src|href)=.https?:|@import", page)


def test_who_beats_a_bound_is_seen_left_of_it() -> None:
    """A mark within the shaded range stands inside the axes, whose labels are left of 0."""
    for logarithmic in (False, True):
        chart = replace(CHART, logarithmic=logarithmic, shaded=[(0.0, 3.9, "impossible")])
        at = places(chart)
        others = [float(text.get("x", 0.0)) for text in parts(chart, "text")]
        assert at["one: 1 s"][0] > min(others)


def test_a_name_with_a_dollar_is_no_mathematics_and_an_unknown_marker_is_a_disc() -> None:
    series = Series("$x_", [Mark(1.0, 2.0, "a"), Mark(2.0, 3.0, "b")], "var(--soft)", "no such")
    chart = replace(CHART, x_label="$m\x01, s", series=[series])
    assert any("$m" in (text.text or "") for text in parts(chart, "text"))
    assert len(places(chart)) == 2
    charts_figure([chart]).draw_without_rendering()


def test_a_chart_of_nothing_is_left_out() -> None:
    empty = replace(CHART, series=[Series("one", [], "red")])
    assert empty.is_empty
    assert '<figure class="chart">' not in Page("t", [Section("s", charts=[empty])]).html()
