"""The learning curve of a training."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from rans.show.pages.chart import Chart, Mark, Series
from rans.show.palette import series_style

Rows = Sequence[Mapping[str, Any]]
"""Lines of ``metrics.jsonl``."""


_MOST_POINTS = 100
"""Of a learning curve."""


def learning_charts(rows: Rows) -> Iterator[Chart]:
    """Charts of ``success`` (0 to 1) and ``return/<term>`` over ``steps``, from lines of ``metrics.jsonl``.

    There is none of one row, as an imitation that solves its task has it.
    """
    if len(rows) < 2:
        return

    def series(key: str, factor: float, colour: str, name: str) -> Series:
        points = [
            (row["steps"], factor * row[key]) for row in rows if key in row and "steps" in row
        ]
        points = points[:: math.ceil(len(points) / _MOST_POINTS) or 1]
        marks = [Mark(x, y) for x, y in points]
        return Series(name, marks, colour, "." if len(marks) == 1 else "", "solid")

    seconds = [float(row["seconds"]) for row in rows if "seconds" in row]
    took = f" ({seconds[-1]:.3g} s in all)" if seconds else ""
    yield Chart(
        f"environment steps{took}",
        "episodes, %",
        [series("success", 100.0, series_style(0)[0], "solved")],
        "Episodes solved while training.",
        y_range=(0.0, 100.0),
    )
    terms = sorted({key for row in rows for key in row if key.startswith("return/")})
    yield Chart(
        "environment steps",
        "mean return of an episode",
        [
            series(term, 1.0, series_style(k)[0], term.removeprefix("return/"))
            for k, term in enumerate(terms)
        ],
        "Return by term while training.",
    )
