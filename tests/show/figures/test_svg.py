"""Figures as files: inks that follow the reader's choice, and images in which nothing runs."""

from __future__ import annotations

import re

from matplotlib.figure import Figure

from rans.show.figures.svg import svg
from rans.show.pages.page import Page, Picture, Section
from tests.support.browser import live


def test_dark_pages_have_light_inks_and_no_ground() -> None:
    figure = Figure()
    figure.subplots()
    text = svg(figure)
    rule = re.search(r"@media screen and \(prefers-color-scheme: dark\)\{(.*?)\}\}", text)
    assert rule is not None
    assert '[style*="fill: #1f2933"]{fill:#e4e7eb!important}' in rule[1]
    assert text.count("prefers-color-scheme") == 1


def test_a_picture_of_a_stranger_stands_in_an_image_alone() -> None:
    """No browser runs a script of an image, or fetches what it names."""
    hostile = "<svg><script>hostile()</script><image href='http://example.org/a.png'/></svg>"
    html = Page("a", [Section("c", pictures=[Picture.of(hostile, "d")])]).html()
    assert "hostile()" not in html
    assert live(html) == []
    assert re.findall(r'<img[^>]* src="([^"]{30})', html) == ["data:image/svg+xml;base64,PHN2"]
