"""Figures as files: panels that stand alone, and inks that follow the reader's choice."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET

import pytest
from matplotlib.figure import Figure

from rans.errors import ConfigError
from rans.show.figures.figures import evaluation_figure, styled
from rans.show.figures.panels import legend_beside
from rans.show.figures.svg import panels, svg, without_scripts
from rans.show.pages.page import Picture
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


def test_our_own_pictures_only_draw() -> None:
    text = svg(two_panels())
    assert panels(without_scripts(text)) == panels(text)


@pytest.mark.parametrize(
    ("picture", "sentence"),
    [
        ("no picture", "it is no SVG"),
        ("<html/>", "begins with the element"),
        (PLAIN.format("<script>alert(1)</script>"), "holds the element '.*script'"),
        (
            PLAIN.format(
                '<foreignObject><p xmlns="http://www.w3.org/1999/xhtml"/></foreignObject>'
            ),
            "foreignObject",
        ),
        (
            PLAIN.format('<g><animate attributeName="href" to="javascript:alert(1)"/></g>'),
            "animate",
        ),
        (PLAIN.format('<a href="http://example.org"/>'), "the element '.*a'"),
        (PLAIN.format('<rect onclick="alert(1)"/>'), "onclick"),
        (PLAIN.format('<rect onLoad="alert(1)"/>'), "onload"),
        (PLAIN.format('<use xlink:href="http://example.org/a.svg#b"/>'), "fetch something"),
        (PLAIN.format('<image href="file:///etc/passwd"/>'), "fetch something"),
        (PLAIN.format('<image href="data:image/svg+xml;base64,AAAA"/>'), "fetch something"),
        (PLAIN.format('<rect style="fill: url( http://example.org )"/>'), "fetch something"),
        (PLAIN.format("<rect fill=\"url('http://example.org')\"/>"), "fetch something"),
        (PLAIN.format("<style>@import 'http://example.org';</style>"), "style could fetch"),
        (PLAIN.format("<style>*{fill: u\\72l(http://example.org)}</style>"), "style could fetch"),
        ('<!DOCTYPE svg [<!ENTITY a "aaaa">]>' + PLAIN.format("&a;"), "declares entities"),
        (PLAIN.format("<g>" * 3000 + "</g>" * 3000), "it is no SVG"),
    ],
)
def test_pictures_that_do_more_than_to_draw_are_refused(picture: str, sentence: str) -> None:
    with pytest.raises(ConfigError, match=sentence):
        without_scripts(picture)


def test_nothing_is_left_but_the_drawing() -> None:
    """Instructions to a browser go, and links within the picture stay."""
    told = (
        '<?xml version="1.0"?><?xml-stylesheet href="http://example.org/a.css"?><!-- note -->'
        + PLAIN.format(
            '<metadata><any xmlns="http://example.org"/></metadata><defs><path id="a"/></defs>'
            '<use xlink:href="#a" clip-path="url(#b)"/>'
        )
    )
    kept = without_scripts(told)
    assert "example.org" not in kept
    assert "note" not in kept
    assert 'href="#a"' in kept
    assert "url(#b)" in kept


def test_panels_are_counted() -> None:
    """Within each other, each would repeat all that it holds."""
    group = '<g id="panel 0 0 1 1">'
    many = PLAIN.format(group * 200 + "</g>" * 200)
    assert panels(many) == [many]
