"""Axes that show quantities and not rounding errors: a least span for each unit, and no hidden offset."""

from __future__ import annotations

import math
from typing import Any

from rans.show.figures.plotting import Figure

_LEAST = {
    "m": 1e-3,
    "cm": 0.1,
    "m/s": 1e-3,
    "cm/s": 0.1,
    "deg": 0.1,
    "rad": 1e-3,
    "deg/s": 0.1,
    "rad/s": 1e-3,
    "N": 1e-3,
    "N s": 1e-3,
    "kg": 1e-3,
    "s": 0.01,
    "%": 0.1,
}
"""Least spans of axes by their unit: less than a tenth of what a laboratory measures, and a thousand times the
tolerances of solvers (1e-6 and less), whose remains would else fill a panel."""
_LEAST_OF_OTHERS = 1e-6
"""Least span of an axis without one of these units."""
_LEAST_PART = 1e-3
"""Least span as a part of the largest magnitude: a value that varies by less is the same to every reader."""
_LEAST_FACTOR = 2.0
"""Least ratio of the ends of a logarithmic axis."""


def widened(low: float, high: float, label: str) -> tuple[float, float]:
    """Ends of a linear axis at least as far apart as its unit, the last word of its label, and its values ask for.

    >>> widened(0.2, 0.2 + 1e-9, "speed, m/s")
    (0.1995000005, 0.2005000005)
    """
    least = _LEAST.get(label.rpartition(", ")[2], _LEAST_OF_OTHERS)
    least = max(least, _LEAST_PART * max(abs(low), abs(high)))
    if not math.isfinite(high - low) or abs(high - low) >= least:
        return low, high
    middle = 0.5 * (low + high)
    half = math.copysign(0.5 * least, high - low)
    return middle - half, middle + half


def widened_logarithmic(low: float, high: float) -> tuple[float, float]:
    """Ends of a logarithmic axis of which one is at least twice the other."""
    if not low > 0.0 or not 1.0 / _LEAST_FACTOR < high / low < _LEAST_FACTOR:
        return low, high
    middle = math.sqrt(low * high)
    side = math.sqrt(_LEAST_FACTOR) ** math.copysign(1.0, high - low)
    return middle / side, middle * side


def settle(figure: Figure) -> None:
    """Widen the axes of a figure that show less than their unit's least span, and write numbers without offset."""
    for axes in figure.axes:
        for name in ("x", "y", "z"):
            _settle_axis(axes, name)


def _settle_axis(axes: Any, name: str) -> None:
    """Widen the limits of an axis as far as its numbers need, which are printed without an offset."""
    axis = getattr(axes, f"{name}axis", None)
    if axis is None or not axes.axison:
        return
    low, high = getattr(axes, f"get_{name}lim")()
    if axis.get_scale() == "log":
        new = widened_logarithmic(low, high)
    else:
        new = widened(low, high, axis.label.get_text())
        formatter = axis.get_major_formatter()
        if hasattr(formatter, "set_useOffset"):
            formatter.set_useOffset(False)
    if new != (low, high):
        getattr(axes, f"set_{name}lim")(*new)
