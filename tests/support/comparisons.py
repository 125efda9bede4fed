"""A comparison of flights whose every figure is worked out by hand, and the points of its figures."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Patch

from rans.evaluation.compare.contest import Contest, Contestant, Entry
from rans.evaluation.compare.run import Comparison
from tests.support.evaluation_flights import flight_of

NOBODY: Any = None
"""Whoever flew: the flights are there already."""


def entry() -> Entry:
    """Three episodes of ten steps of 0.5 s: at the goal from 1 s on, from 2 s on, and lost beyond 8 m.

    The first opens one thruster of 1 N for 2 s, the second for 1 s, the third never.
    """
    distance = np.full((11, 3), 0.01)
    distance[:2, 0] = distance[:4, 1] = 1.0
    distance[:, 2] = 9.0
    commands = np.zeros((10, 3, 8))
    commands[:4, 0, 0] = commands[:2, 1, 0] = 1.0
    contestant = Contestant("agent", NOBODY, "observation", "none")
    return Entry(contestant, flight_of(distance, 0.0, commands))


def comparison(**changes: Any) -> Comparison:
    flown = entry()
    contest = Contest(flown.flight.craft, flown.flight.task, flown.flight.timing, 1, 3)
    return Comparison(contest, [flown], **changes)


def points(axes: Axes) -> dict[str, list[list[float]]]:
    """By their names in the legend, the points of lines and of marks with error bars."""
    return {
        name: np.asarray(getattr(drawn, "lines", [drawn])[0].get_xydata()).tolist()
        for drawn, name in zip(*axes.get_legend_handles_labels(), strict=True)
        if not isinstance(drawn, Patch)
    }
