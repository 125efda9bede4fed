"""Figures as files: inks that follow the choice of the reader."""

import re

from matplotlib.figure import Figure

from rans.show.figures.svg import svg


def test_dark_pages_have_light_inks_and_no_ground():
    figure = Figure()
    figure.subplots()
    text = svg(figure)
    rule = re.search(r"@media screen and \(prefers-color-scheme: dark\)\{(.*?)\}\}", text)
    assert rule is not None
    assert '[style*="fill: #1f2933"]{fill:#e4e7eb!important}' in rule[1]
    assert text.count("prefers-color-scheme") == 1
