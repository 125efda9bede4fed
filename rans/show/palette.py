"""Colours of figures and pages, and which of them a contestant has."""

from __future__ import annotations

BLUE = "#0072B2"
ORANGE = "#E69F00"
GREEN = "#009E73"
RED = "#D55E00"
PURPLE = "#CC79A7"
SKY = "#56B4E9"
INK = "#1F2933"
GREY = "#7B8794"
LINES = "#E4E7EB"
"""Colours of Okabe and Ito ("Color Universal Design", 2008), and neutral ones, which dark pages change."""

FOUND = "#A0603C"
RELAXED = "#7A6FD0"
"""Colours of the best controls found and of relaxed optima, which no contestant has."""

_MARKS = (
    (BLUE, "o"),
    (ORANGE, "s"),
    (GREEN, "D"),
    (PURPLE, "^"),
    (RED, "v"),
    (SKY, "P"),
    ("#999933", "o"),
    ("#AA4499", "s"),
    ("#44AA99", "D"),
    ("#CC6677", "^"),
)
"""After the colours above, the last four are of Paul Tol ("Colour Schemes", 2021)."""


def series_style(k: int) -> tuple[str, str]:
    """Colour and marker of contestant k, the same in every chart; from the eleventh on they repeat."""
    return _MARKS[k % len(_MARKS)]
