"""A chart as a value: marks that say what they are, in series that are shown and hidden together.

Matplotlib draws it for papers and for pages (`rans.show.figures.chart_figure`). In a page the chart is complete
without scripts, and a mark's text appears where the pointer rests; the page's script adds readouts for the keyboard
and buttons for series.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from rans.show.markup import Markup


class Mark(NamedTuple):
    """A point with its interval, and what it says."""

    x: float
    y: float
    text: str
    x_interval: tuple[float, float] | None = None
    y_interval: tuple[float, float] | None = None


@dataclass(frozen=True)
class Series:
    """Marks of one kind, which are shown and hidden together."""

    name: str
    marks: Sequence[Mark]
    colour: str
    """A CSS colour, such as var(--ink)."""
    marker: str = "o"
    """Of Matplotlib; "ring" is a circle, others that it does not have are discs."""
    line: str = ""
    """What joins the marks: "", "solid" or "dotted"."""

    @property
    def finite(self) -> list[Mark]:
        """The marks that have a place."""
        return [mark for mark in self.marks if math.isfinite(mark.x) and math.isfinite(mark.y)]


@dataclass(frozen=True)
class Chart:
    """Series over two axes. Marks that are not finite are left out.

    Attributes:
        x_label: with its unit.
        y_label: with its unit.
        caption: below the chart, and read out to those who cannot see it.
        shaded: ranges of x, each with its meaning.
        logarithmic: whether both axes are.
        y_range: bounds of y; None: those of the marks.
    """

    x_label: str
    y_label: str
    series: Sequence[Series]
    caption: str
    shaded: Sequence[tuple[float, float, str]] = ()
    logarithmic: bool = False
    y_range: tuple[float, float] | None = None

    @property
    def is_empty(self) -> bool:
        """Whether there is nothing to draw."""
        return not any(True for _ in self._marks())

    def svg(self) -> Markup:
        """The text of the SVG element, of names and numbers that are escaped."""
        from rans.show.figures.chart_figure import (
            inline,
        )  # a page without charts needs no Matplotlib

        return inline(self)

    def _marks(self) -> Iterator[Mark]:
        for series in self.series:
            yield from series.finite
