"""A chart of a page as SVG: its marks say their values, series can be hidden, and it prints as it stands.

Colours follow the reader's choice of light or dark. Without scripts the chart is complete, and a mark's text
appears where the pointer rests; the page's script adds readouts for the keyboard and buttons for series.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from rans.show.figures.axes import widened, widened_logarithmic
from rans.show.figures.plotting import LogLocator, MaxNLocator
from rans.show.markup import Markup, drawing, text

WIDTH = 720.0
HEIGHT = 400.0
_LEFT = 64.0
_RIGHT = 16.0
_TOP = 16.0
_BOTTOM = 52.0
_LOG_MARKS = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0)
"""Multiples of powers of ten that have a tick."""


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
    """o, s, D, ^, v, x, _ or "", as in Matplotlib; others are discs."""
    line: str = ""
    """What joins the marks: "", "solid" or "dotted"."""


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
        if self.is_empty:
            return drawing(())
        x_axis = _Axis.of(self._xs(), self.x_label, self.logarithmic, _LEFT, WIDTH - _RIGHT)
        bounds = self.y_range or tuple(self._ys())
        y_axis = _Axis.of(
            bounds, self.y_label, self.logarithmic, HEIGHT - _BOTTOM, _TOP, bool(self.y_range)
        )
        parts = [
            f'<svg viewBox="0 0 {WIDTH:g} {HEIGHT:g}" role="group" aria-label="{text(self.caption)}">',
            *self._ground(x_axis, y_axis),
        ]
        for k, series in enumerate(self.series):
            parts += _drawn(series, k, x_axis, y_axis)
        return drawing((*parts, "</svg>"))

    def _marks(self) -> Iterator[Mark]:
        for series in self.series:
            yield from _finite(series.marks)

    def _xs(self) -> Iterator[float]:
        yield from (high for _, high, _ in self.shaded)
        for mark in self._marks():
            yield from (mark.x, *(x for x in mark.x_interval or () if math.isfinite(x)))

    def _ys(self) -> Iterator[float]:
        for mark in self._marks():
            yield from (mark.y, *(y for y in mark.y_interval or () if math.isfinite(y)))

    def _ground(self, x_axis: _Axis, y_axis: _Axis) -> Iterator[str]:
        """Shaded ranges, grid, ticks and labels."""
        bottom = HEIGHT - _BOTTOM
        for low, high, meaning in self.shaded:
            left = min(max(x_axis.at(low), _LEFT), WIDTH - _RIGHT)
            right = min(max(x_axis.at(high), _LEFT), WIDTH - _RIGHT)
            yield (
                f'<rect class="shade" x="{left:.1f}" y="{_TOP:g}" width="{right - left:.1f}" '
                f'height="{bottom - _TOP:g}"><title>{text(meaning)}</title></rect>'
            )
        for value in x_axis.ticks:
            x = x_axis.at(value)
            yield f'<line class="grid" x1="{x:.1f}" x2="{x:.1f}" y1="{_TOP:g}" y2="{bottom:g}"/>'
            yield (
                f'<text x="{x:.1f}" y="{bottom + 18:g}" text-anchor="middle">{tick_label(value)}</text>'
            )
        for value in y_axis.ticks:
            y = y_axis.at(value)
            yield f'<line class="grid" x1="{_LEFT:g}" x2="{WIDTH - _RIGHT:g}" y1="{y:.1f}" y2="{y:.1f}"/>'
            yield f'<text x="{_LEFT - 8:g}" y="{y + 4:.1f}" text-anchor="end">{tick_label(value)}</text>'
        middle = (_LEFT + WIDTH - _RIGHT) / 2
        yield (
            f'<text x="{middle:g}" y="{HEIGHT - 10:g}" text-anchor="middle">{text(self.x_label)}</text>'
        )
        yield (
            f'<text transform="translate(15 {(_TOP + bottom) / 2:g}) rotate(-90)" text-anchor="middle">'
            f"{text(self.y_label)}</text>"
        )


class _Axis(NamedTuple):
    """Scale of an axis: positions of values in the picture, and ticks."""

    at: Callable[[float], float]
    ticks: Sequence[float]

    @classmethod
    def of(
        cls,
        values: Iterable[float],
        label: str,
        logarithmic: bool,
        first: float,
        last: float,
        exact: bool = False,
    ) -> _Axis:
        """An axis from one place of the picture to another, with room around the values unless exact."""
        # A logarithm has no place for 0, such as the impulse of wheels alone: it stands at the low end.
        numbers = [x for x in values if x > 0.0 or not logarithmic] or [1.0]
        scale = math.log10 if logarithmic else float
        ends = min(numbers), max(numbers)
        low, high = map(scale, widened_logarithmic(*ends) if logarithmic else widened(*ends, label))
        if not exact:
            room = 0.06 * (high - low) or 0.1 * abs(high) or 0.1
            low, high = low - room, high + room

        def at(value: float) -> float:
            position = scale(value) if value > 0.0 or not logarithmic else low
            return first + (position - low) / (high - low) * (last - first)

        if logarithmic:
            locator = LogLocator(subs=_LOG_MARKS, numticks=20)
            marks = locator.tick_values(10.0**low, 10.0**high)
            inside = [float(x) for x in marks if low <= math.log10(x) <= high]
            step = math.ceil(len(inside) / 9)
            return cls(at, inside[::step])
        marks = MaxNLocator(6).tick_values(low, high)
        return cls(at, [float(x) for x in marks if low - 1e-9 <= x <= high + 1e-9])


def tick_label(value: float) -> str:
    """A tick's number; millions as "5 M", thousands from 10,000 on as "20 k".

    >>> number(2_500_000.0), number(20_000.0), number(0.3), number(-0.0)
    ('2.5 M', '20 k', '0.3', '0')
    """
    if abs(value) >= 1e6:
        return f"{value / 1e6:g} M"
    if abs(value) >= 1e4:
        return f"{value / 1e3:g} k"
    return f"{round(value, 9) + 0.0:g}"


def _finite(marks: Sequence[Mark]) -> list[Mark]:
    return [mark for mark in marks if math.isfinite(mark.x) and math.isfinite(mark.y)]


def _drawn(series: Series, k: int, x_axis: _Axis, y_axis: _Axis) -> Iterator[str]:
    """A group of one series: its line, intervals and marks."""
    marks = _finite(series.marks)
    yield f'<g class="series" data-series="{k}" style="color:{text(series.colour)}">'
    if series.line and len(marks) > 1:
        points = " ".join(f"{x_axis.at(m.x):.1f},{y_axis.at(m.y):.1f}" for m in marks)
        dash = ' stroke-dasharray="2 4"' if series.line == "dotted" else ""
        yield f'<polyline class="line" points="{points}"{dash}/>'
    for mark in marks:
        x, y = x_axis.at(mark.x), y_axis.at(mark.y)
        for interval, axis, along in (
            (mark.x_interval, x_axis, True),
            (mark.y_interval, y_axis, False),
        ):
            if interval is not None and all(map(math.isfinite, interval)):
                low, high = (axis.at(value) for value in interval)
                ends = (low, y, high, y) if along else (x, low, x, high)
                yield '<line class="bar" x1="{:.1f}" y1="{:.1f}" x2="{:.1f}" y2="{:.1f}"/>'.format(
                    *ends
                )
        said = text(mark.text)
        yield (
            f'<g class="point" tabindex="0" role="img" aria-label="{said}" '
            f'transform="translate({x:.1f} {y:.1f})"><title>{said}</title>{_marker(series.marker)}</g>'
        )
    yield "</g>"


def _marker(kind: str) -> str:
    """The symbol of a mark around the origin."""
    shapes = {
        "s": '<rect x="-5" y="-5" width="10" height="10"/>',
        "D": '<path d="M0-7 7 0 0 7-7 0Z"/>',
        "^": '<path d="M0-7 6.5 5-6.5 5Z"/>',
        "v": '<path d="M0 7 6.5-5-6.5-5Z"/>',
        "x": '<path class="stroke" d="M-5-5 5 5M-5 5 5-5"/>',
        "_": '<path class="stroke" d="M-9 0H9"/>',
        "ring": '<circle class="stroke" r="5"/>',
        ".": '<circle r="2.5"/>',
        "": '<circle class="unseen" r="6"/>',
    }
    return shapes.get(kind, '<circle r="5.5"/>')
