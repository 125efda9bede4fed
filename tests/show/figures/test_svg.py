"""Figures as files: panels that stand alone, and inks that follow the reader's choice."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET

import pytest
from matplotlib.figure import Figure

from rans.errors import ConfigError
from rans.show.figures.figures import evaluation_figure, styled
from rans.show.figures.panels import legend_beside
from rans.show.figures.svg import panels, svg
from rans.show.pages.page import Page, Picture, Section
from tests.support.browser import live
from tests.support.evaluation_flights import two_episodes

PATH = "{http://www.w3.org/2000/svg}path"


@styled
def two_panels() -> Figure:
    """The same marker in both: Matplotlib defines it once, in the first. The second panel is a legend."""
    figure = Figure(figsize=(8.0, 3.0), layout="constrained")
    left, right = figure.subfigures(1, 2)  # type: ignore[misc]
    axes = left.subplots()
    axes.plot([1, 2], [3, 4], marker="D", color="#123456", label="what it is")
    legend_beside(right, axes)
    return figure


@pytest.mark.slow
def test_each_panel_is_a_file_of_its_own() -> None:
    """Eight of them, each as wide as a telephone at most, with everything that it refers to inside."""
    found = panels(svg(evaluation_figure(two_episodes())))
    assert len(found) == 8
    for text in found:
        root = ET.fromstring(text)
        ids = {one.get("id") for one in root.iter()}
        assert set(re.findall(r'(?:href="|url\()#([\w-]+)', text)) <= ids
        width, height = (float(root.get(side, "")[:-2]) for side in ("width", "height"))
        assert 200 < width < 290  # points, of 4/3 pixels each
        assert 150 < height < 290


def test_a_legend_stands_beside_its_curves() -> None:
    curve, legend = (ET.fromstring(text) for text in panels(svg(two_panels())))
    drawn = [
        [one for one in root.iter() if "#123456" in one.get("style", "")]
        for root in (curve, legend)
    ]
    assert all(drawn)
    assert len(list(legend.iter(PATH))) < len(list(curve.iter(PATH)))
    assert float(legend.get("height", "")[:-2]) < 40.0  # one line of it, no empty axes


def test_dark_pages_have_light_inks_and_no_ground() -> None:
    text = svg(two_panels())
    rule = re.search(r"@media screen and \(prefers-color-scheme: dark\)\{(.*?)\}\}", text)
    assert rule is not None
    assert '[style*="fill: #1f2933"]{fill:#e4e7eb!important}' in rule[1]
    assert text.count("prefers-color-scheme") == 1
    assert all("prefers-color-scheme" in panel for panel in panels(text))


def test_other_pictures_stay_as_they_are() -> None:
    foreign = '<svg xmlns="http://www.w3.org/2000/svg"><g id="panel"/></svg>'
    assert panels(foreign) == [foreign]
    assert len(Picture.of(foreign, "old").sources) == 1
    figure = Figure()
    figure.subplots()
    whole = svg(figure)
    assert panels(whole) == [whole]


PLAIN = (
    '<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink">{}</svg>'
)


@pytest.mark.parametrize(
    "picture",
    [
        "no picture",
        "<html/>",
        '<!DOCTYPE svg [<!ENTITY a "aaaa">]>' + PLAIN.format("&a;"),
        PLAIN.format("<g>" * 3000 + "</g>" * 2999),
    ],
)
def test_what_is_no_picture_is_a_sentence(picture: str) -> None:
    with pytest.raises(ConfigError, match="it is no SVG"):
        panels(picture)


def test_a_picture_of_a_stranger_stands_in_an_image_alone() -> None:
    """No browser runs a script of an image, or fetches what it names."""
    hostile = PLAIN.format("<script>hostile()</script><image href='http://example.org/a.png'/>")
    html = Page("a", [Section("c", pictures=[Picture.of(hostile, "d")])]).html()
    assert "hostile()" not in html
    assert live(html) == []
    assert re.findall(r'<img[^>]* src="([^"]{30})', html) == ["data:image/svg+xml;base64,PHN2"]


def test_panels_are_counted() -> None:
    """Within each other, each would repeat all that it holds."""
    group = '<g id="panel 0 0 1 1">'
    many = PLAIN.format(group * 200 + "</g>" * 200)
    assert panels(many) == [many]
