"""Charts of pages: where marks stand, what they say, and that names are no mark-up."""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from dataclasses import replace

import pytest

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


def places(chart: Chart) -> dict[str, tuple[float, float]]:
    """Where the mark with each text stands."""
    found = re.findall(
        r'aria-label="([^"]*)" transform="translate\(([\d.]+) ([\d.]+)\)', chart.svg()
    )
    return {text: (float(x), float(y)) for text, x, y in found}


def test_equal_ratios_are_equal_ways_on_logarithmic_axes() -> None:
    at = places(CHART)
    first, second, third = at["one: 1 s"], at["late"], at["&lt;i&gt;"]
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
    assert at["&lt;i&gt;"][0] - at["late"][0] == pytest.approx(
        2 * (at["late"][0] - at["one: 1 s"][0]), abs=0.2
    )


def test_what_never_happens_is_not_drawn_and_names_are_text() -> None:
    text = CHART.svg()
    assert "never" not in text
    assert "<b>" not in text
    assert "<i>" not in text
    root = ET.fromstring(text.replace("<svg ", '<svg xmlns="http://www.w3.org/2000/svg" ', 1))
    assert root.get("aria-label") == "A & B"
    titles = [one.text for one in root.iter(f"{SVG}title")]
    assert titles == ["impossible", "one: 1 s", "late", "<i>"]


def test_the_shaded_range_ends_where_its_bound_is() -> None:
    """1.5 lies between 1 and 2 as log 1.5 between 0 and log 2."""
    at = places(CHART)
    x, width = map(
        float, re.findall(r'class="shade" x="([\d.]+)" .*?width="([\d.]+)"', CHART.svg())[0]
    )
    share = math.log(1.5) / math.log(2.0)
    expected = at["one: 1 s"][0] + share * (at["late"][0] - at["one: 1 s"][0])
    assert x + width == pytest.approx(expected, abs=0.2)


def test_a_page_has_a_button_for_every_series_and_fetches_nothing() -> None:
    page = Page("t", [Section("s", charts=[CHART])]).html()
    assert len(re.findall(r"<button[^>]*data-series", page)) == 2
    assert "&lt;b&gt;</button>" in page
    assert not re.search(r"(?:src|href)=.https?:|@import", page)


def test_a_chart_of_nothing_is_left_out() -> None:
    empty = replace(CHART, series=[Series("one", [], "red")])
    assert empty.is_empty
    assert '<figure class="chart">' not in Page("t", [Section("s", charts=[empty])]).html()
