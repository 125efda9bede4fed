"""Pictures of the pages that are made of boxes and arrows, drawn from the rows of schemes.toml."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from rans.show.figures.figures import styled
from rans.show.figures.plotting import Axes, FancyBboxPatch, Figure
from rans.show.palette import BLUE, GREY, INK, ORANGE

PALE = "#DCE6F0"
"""Fill of a craft and of boxes, which dark pages change (`rans.show.figures.svg`)."""
_HALF = (1.1, 0.4)
"""Half the width and the height of a box."""
_SCALE = 0.78
"""Inches of a unit of the coordinates."""
_COLOURS = {"ink": INK, "grey": GREY, "blue": BLUE, "orange": ORANGE}
_WRITTEN = {"ha": "center", "va": "center", "color": "ink", "fontsize": 8}


def arrow(
    axes: Axes,
    begin: Sequence[float] | np.ndarray,
    end: Sequence[float] | np.ndarray,
    colour: str = INK,
) -> None:
    """Draw an arrow."""
    axes.annotate(
        "",
        xy=(end[0], end[1]),
        xytext=(begin[0], begin[1]),
        arrowprops={
            "arrowstyle": "-|>",
            "color": colour,
            "linewidth": 1.6,
            "shrinkA": 0,
            "shrinkB": 0,
        },
    )


@styled
def scheme(row: Mapping[str, Any]) -> Figure:
    """A diagram of boxes, 0.8 high, of arrows from edge to edge, and of further marks; see schemes.toml."""
    width, height = row["size"]
    inches = row.get("inches", (_SCALE * width, _SCALE * height))
    figure = Figure(figsize=tuple(inches), layout="constrained")
    axes = figure.add_subplot()
    axes.set(xlim=(0.0, width), ylim=(0.0, height))
    if "inches" not in row:
        axes.set_aspect("equal")
    axes.axis("off")
    for text, x, y, *half in row.get("boxes", ()):
        wide = half[0] if half else _HALF[0]
        patch = FancyBboxPatch(
            (x - wide, y - _HALF[1]),
            2.0 * wide,
            2.0 * _HALF[1],
            boxstyle="round,pad=0,rounding_size=0.12",
            facecolor=PALE,
            edgecolor=GREY,
        )
        axes.add_patch(patch)
        axes.text(x, y, text, ha="center", va="center", color=INK, fontsize=10)
    for first, second, *text in row.get("ways", ()):
        _way(axes, row["boxes"][first], row["boxes"][second], "".join(text))
    for mark in row.get("marks", ()):
        _mark(axes, dict(mark))
    return figure


def _way(axes: Axes, first: Sequence[Any], second: Sequence[Any], text: str) -> None:
    """An arrow from the edge of a box to that of another, and its text."""
    along = np.subtract(second[1:3], first[1:3])
    begin = np.array(first[1:3]) + along * _reach(along, first)
    end = np.array(second[1:3]) - along * _reach(along, second)
    arrow(axes, begin, end)
    middle = 0.5 * (begin + end)
    level = abs(along[1]) < 1e-9
    # The text is right of an arrow: above one that falls, below one that rises.
    slope = np.sign(along[0] * along[1])
    axes.text(
        middle[0] + (0.0 if level else 0.08),
        middle[1] + (0.1 if level else 0.0),
        text,
        ha="center" if level else "left",
        va="bottom" if level else ("bottom", "center", "top")[int(slope) + 1],
        color=INK,
        fontsize=8,
    )


def _reach(along: np.ndarray, box: Sequence[Any]) -> float:
    """The share of a way between centres that lies within a box."""
    half = box[3] if len(box) > 3 else _HALF[0]
    sides = zip((half, _HALF[1]), along, strict=True)
    return min(h / abs(w) if abs(w) > 1e-9 else np.inf for h, w in sides)


def _mark(axes: Axes, style: dict[str, Any]) -> None:
    """An arrow, a text, a line or dots, or a span of x."""
    kind = next(iter(style))
    value = style.pop(kind)
    if kind == "text":
        style = {**_WRITTEN, **style}
    style["color"] = _COLOURS[style.get("color", "ink")]
    if kind == "arrow":
        arrow(axes, value[0], value[1], style["color"])
    elif kind == "text":
        x, y = style.pop("at")
        axes.text(x, y, value, **style)
    elif kind == "line":
        axes.plot(*value, **style)
    else:
        axes.axvspan(value[0], value[1], **style)


SCHEMES: dict[str, Callable[[], Figure]] = {
    name: partial(scheme, row)
    for name, row in tomllib.loads(Path(__file__).with_suffix(".toml").read_text("utf-8")).items()
}
"""Functions of figures by the names of their files."""
