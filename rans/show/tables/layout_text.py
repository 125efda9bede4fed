"""The thrusters of a spacecraft, drawn with characters."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rans.model.spacecraft import Spacecraft
from rans.outline import Outline

_ARROWS = "→↗↑↖←↙↓↘"
TOWARDS = "⊙"
AWAY = "⊗"
_WIDEST = 3.0
"""The farthest thruster in a picture is so many units away: of the outer radius, or longer ones."""


def layout_text(craft: Spacecraft) -> str:
    """The thrusters of a spacecraft seen along z, drawn with characters.

    Each thruster is its index with the direction of its force: an arrow, or ⊙ towards the viewer and
    ⊗ away; + is the centre of mass and the dots are the outer radius.
    """
    nozzles = Outline(craft).nozzles
    unit = max([craft.radius, *(math.hypot(*nozzle.root[:2]) / _WIDEST for nozzle in nozzles)])
    cells: dict[tuple[int, int], str] = {}
    for angle in range(0, 360, 6):
        x, y = (craft.radius / unit * f(math.radians(angle)) for f in (math.cos, math.sin))
        cells[_cell((x, y), 1.0)] = "·"
    _put(cells, (0.0, 0.0), "+")
    for index, nozzle in enumerate(nozzles):
        x, y, _ = nozzle.root.tolist()
        dx, dy, dz = (-nozzle.exhaust).tolist()
        mark = _ARROWS[round(math.atan2(dy, dx) / (math.pi / 4)) % 8]
        if abs(dz) > math.hypot(dx, dy):
            mark = TOWARDS if dz > 0 else AWAY
        _put(cells, (x / unit + 0.35 * dx, y / unit + 0.35 * dy), f"{index}{mark}")
    rows, columns = zip(*cells, strict=True)
    width = range(min(columns) - 2, max(columns) + 1)
    return "\n".join(
        "".join(cells.get((row, column), " ") for column in width)
        for row in range(min(rows), max(rows) + 1)
    )


def _cell(position: Sequence[float], width: float) -> tuple[int, int]:
    """Row and first column of a text centred at a place given in units; characters are 1 x 2."""
    return round(-8.0 * position[1]), round(16.0 * position[0] - (width - 1) / 2)


def _put(cells: dict[tuple[int, int], str], position: Sequence[float], text: str) -> None:
    """Write the text at its place, or in the first free row below."""
    row, column = _cell(position, len(text))
    span = range(column, column + len(text))
    while any(cells.get((row, c), "·") != "·" for c in span):
        row += 1
    cells.update({(row, c): letter for c, letter in zip(span, text, strict=True)})
