"""Charts of a comparison's page: time against impulse, above what is certified to be impossible."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from rans.evaluation.compare.bounds import Event
from rans.evaluation.compare.contest import Entry
from rans.evaluation.compare.run import Comparison
from rans.evaluation.measure.statistics import Bootstrap
from rans.show.pages.chart import Chart, Mark, Series
from rans.show.palette import FOUND, RELAXED, series_style

INK = "var(--ink)"
GREY = "var(--soft)"


def plane_chart(comparison: Comparison) -> Chart:
    """First time in the goal set and impulse until then: bounds, controls found and contestants, by medians.

    All are over the same starts: the certified ones if there are any, otherwise all.
    """
    certified = comparison.certified_starts(Event())
    starts = certified or list(range(comparison.contest.episodes))
    bootstrap = Bootstrap(len(starts))
    series = [*_relaxed(comparison, starts)]
    series += [
        _contestant(entry, starts, bootstrap, k) for k, entry in enumerate(comparison.entries)
    ]
    shaded = []
    bound = ""
    if certified:
        least = float(np.median(comparison.bounds(Event())[0]))
        what = "the median" if len(starts) > 1 else "the time"
        shaded.append((0.0, least))
        bound = f"; the shaded times are provably impossible: {what} is at least {least:.2f} s"
        series = [*_certified(comparison, starts), *series]
    return Chart(
        "first in the goal set, s",
        "impulse until then, N s",
        series,
        f"First time in the goal set{_over(len(starts))}{bound}.",
        shaded,
        logarithmic="xy",
    )


def _over(count: int) -> str:
    """Of how many starts marks are; one start has neither a median nor an interval."""
    return f", medians over {count:,} starts with 95 % intervals" if count > 1 else " from 1 start"


def _certified(comparison: Comparison, starts: list[int]) -> Iterator[Series]:
    """Least impulse at each horizon that is bounded from these starts, and the best controls that were found."""
    horizons = [
        horizon
        for horizon in comparison.horizons()
        if comparison.certified_starts(Event(horizon=horizon)) == starts
    ]
    if not horizons:
        return
    lower, upper = np.transpose(
        [
            [np.median(bound) for bound in comparison.bounds(Event(horizon=horizon))]
            for horizon in horizons
        ]
    )
    yield Series(
        "certified least impulse at these times",
        [Mark(h, y) for h, y in zip(horizons, lower, strict=True)],
        INK,
        "_",
        "dotted",
    )
    if np.isfinite(upper).any():
        yield Series(
            "best on/off controls found, replayed",
            [Mark(h, y) for h, y in zip(horizons, upper, strict=True)],
            FOUND,
            "ring",
        )


def _relaxed(comparison: Comparison, starts: Sequence[int]) -> Iterator[Series]:
    """Median time and impulse of optima of throttled thrust from these starts; none where none is solved."""
    marks = []
    lost = False
    for rows in comparison.relaxed.values():
        chosen = [rows[k] for k in starts if rows[k].solved]
        if chosen and chosen[0].objective in ("time", "fuel"):
            lost = lost or len(chosen) < len(starts)
            x, y = (
                float(np.median([getattr(row, key) for row in chosen]))
                for key in ("arrival", "thrust")
            )
            marks.append(Mark(x, y))
    if marks:
        suffix = ", where found" if lost else ""
        yield Series(f"relaxed thrust, exact goal (no controller{suffix})", marks, RELAXED, "x")


def _contestant(entry: Entry, starts: Sequence[int], bootstrap: Bootstrap, k: int) -> Series:
    """A contestant's median first time in the goal set, s, and median impulse until then, N s, in style k.

    They are over these starts, with 95 % intervals where there are several; the name says from how many of them it
    gets there, if not from all.
    """
    colour, marker = series_style(k)
    x, y = (bootstrap.median(values[starts]) for values in (entry.arrival, entry.arrival_thrust))
    count = int(np.isfinite(entry.arrival[starts]).sum())
    name = entry.name + ("" if count == len(starts) else f" ({count} of {len(starts)} get there)")
    if len(starts) == 1:
        mark = Mark(x.value, y.value)
    else:
        mark = Mark(x.value, y.value, (x.low, x.high), (y.low, y.high))
    return Series(name, [mark], colour, marker)


def margin_charts(entries: Sequence[Entry]) -> Iterator[Chart]:
    """Least margin of every constraint over all starts, in each control period: below zero it is violated."""
    for name in entries[0].flight.margins:
        series = []
        for k, entry in enumerate(entries):
            least = entry.flight.margins[name].min(axis=1)
            marks = [Mark(*pair) for pair in zip(entry.flight.times[1:], least, strict=True)]
            series.append(Series(entry.name, marks, series_style(k)[0], "", "solid"))
        caption = f"Least margin of {name} over all starts; below zero it is violated."
        yield Chart("time, s", f"margin of {name}, SI units", series, caption)
