"""A chart as a value, which Matplotlib draws for papers and for pages (`rans.show.figures.chart_figure`)."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple


class Mark(NamedTuple):
    """A point with its intervals."""

    x: float
    y: float
    x_interval: tuple[float, float] | None = None
    y_interval: tuple[float, float] | None = None


@dataclass(frozen=True)
class Series:
    """Marks of one kind; the intervals along y of a line without a marker are a band."""

    name: str
    marks: Sequence[Mark]
    colour: str
    """A CSS colour, such as var(--ink)."""
    marker: str = "o"
    """Marker as Matplotlib names it; "ring" is an open circle, "" no marker, and an unknown name a disc."""
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
        shaded: ranges of x that are provably impossible.
        logarithmic: the axes that are: "", "y" or "xy".
        y_range: bounds of y; None: those of the marks.
    """

    x_label: str
    y_label: str
    series: Sequence[Series]
    caption: str
    shaded: Sequence[tuple[float, float]] = ()
    logarithmic: str = ""
    y_range: tuple[float, float] | None = None

    @property
    def is_empty(self) -> bool:
        """Whether there is nothing to draw."""
        return not any(True for _ in self._marks())

    def _marks(self) -> Iterator[Mark]:
        for series in self.series:
            yield from series.finite
