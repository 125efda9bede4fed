"""Charts of trainings and of flights over time."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from rans.episode.flight import Flight
from rans.show.pages.chart import Chart, Mark, Series
from rans.show.palette import BLUE, GREEN, ORANGE, RED, series_style
from rans.tasks.quantities import QUANTITIES

Rows = Sequence[Mapping[str, Any]]
"""Lines of ``metrics.jsonl``."""


_MOST_POINTS = 100
"""Largest number of points of a learning curve; a curve over the time of a flight has up to twice as many."""
_FLOOR = 0.01
"""Least error that is shown, in its display unit: a logarithmic axis has no place for 0."""


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


def flight_charts(flight: Flight) -> Iterator[Chart]:
    """Charts of all episodes: errors beside their tolerances, angular speed, rewards, and use of the thrusters."""
    tolerances = flight.task.tolerances()
    for quantity, error in flight.errors().items():
        factor, unit = QUANTITIES[quantity].display
        shown = np.maximum(factor * error, _FLOOR)
        bounds = []
        if quantity in tolerances:
            ends = [Mark(float(t), factor * tolerances[quantity]) for t in flight.times[[0, -1]]]
            bounds.append(Series("tolerance", ends, RED, "", "dotted"))
        label = f"{quantity} error, {unit}"
        yield _over_time(label, flight.times, shown, np.argmin, np.argmax, bounds, logarithmic="y")
    spin = np.linalg.norm(np.asarray(flight.states.spin()), axis=0)
    yield _over_time("angular speed, rad/s", flight.times, spin, np.argmin, np.argmax)
    rewards = np.sum(list(flight.rewards().values()), axis=0)
    yield _over_time("reward per step", flight.times[1:], rewards, np.argmax, np.argmin)
    what, label, used = ("thruster", "open time an episode, s", flight.openings)
    if not flight.craft.thrusters:
        what, label = ("wheel", "share of the largest torque times time, s")
        used = np.abs(flight.commands)
    seconds = used.sum(axis=0) * flight.timing.control_period
    marks = [
        Mark(float(k), middle, None, (low, high))
        for k, (low, middle, high) in enumerate(np.percentile(seconds, (5, 50, 95), axis=0).T)
    ]
    series = Series("median, and 5 to 95 % of the episodes", marks, BLUE)
    yield Chart(what, label, [series], f"Use of each {what}.")


def _over_time(
    label: str,
    times: np.ndarray,
    values: np.ndarray,
    best: Callable[[np.ndarray], np.intp],
    worst: Callable[[np.ndarray], np.intp],
    further: Sequence[Series] = (),
    logarithmic: str = "",
) -> Chart:
    """Mean and spread over episodes of values (T, N), and the episodes whose means over time are best and worst."""
    kept = slice(None, None, len(times) // _MOST_POINTS or 1)
    low, high = np.percentile(values, (5, 95), axis=1)
    ranking = values.mean(axis=0)
    columns = (times, values.mean(axis=1), low, high)
    mean = [Mark(t, y, None, (a, b)) for t, y, a, b in np.stack(columns, axis=1)[kept].tolist()]
    extremes = [
        Series(name, [*map(Mark, times[kept], values[kept, pick(ranking)])], colour, "", "solid")
        for name, pick, colour in (("worst episode", worst, ORANGE), ("best episode", best, GREEN))
    ]
    middle = Series("mean (shaded: 5 to 95 %)", mean, BLUE, "", "solid")
    caption = f"{label.partition(',')[0].capitalize()} of all episodes."
    return Chart("time, s", label, [*extremes, middle, *further], caption, logarithmic=logarithmic)
