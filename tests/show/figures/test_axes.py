"""No axis of any figure shows rounding errors: a least span for every quantity, and no hidden offset."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib.figure import Figure

import rans.show.figures
from rans.episode.flight import Flight
from rans.model.fields import Vec2
from rans.show.charts import flight_charts
from rans.show.figures.chart_figure import charts_figure
from rans.show.figures.figures import episode_figure
from tests.support.evaluation_flights import flight_of

NOISE = 1e-9
"""Solvers and sums leave errors of this size."""
SEEN = 1e-4
"""A quantity of size 1 that varies by less than this is the same to a reader."""


def drawing_functions() -> Iterator[tuple[str, Any]]:
    modules = [
        module.name
        for module in pkgutil.iter_modules(rans.show.figures.__path__, "rans.show.figures.")
    ]
    for module in modules:
        for name, function in inspect.getmembers(importlib.import_module(module)):
            draws = inspect.isfunction(function) and not name.startswith("_")
            if draws and inspect.signature(function).return_annotation in ("Figure", Figure):
                yield name, function


def test_every_figure_has_settled_axes():
    """By the decorator `styled`: a figure that is drawn without it is found here."""
    found = dict(drawing_functions())
    assert len(found) >= 3
    bare = [name for name, function in found.items() if not hasattr(function, "__wrapped__")]
    assert bare == []


def noisy(value: float, *shape: int) -> np.ndarray:
    return value + NOISE * np.random.default_rng(1).standard_normal(shape)


def still() -> Flight:
    """Three episodes that stay where they are, but for rounding errors."""
    flight = flight_of(noisy(1.0, 11, 3), 0.0, np.zeros((10, 3, 8)))
    moved = replace(flight.states, v=Vec2(noisy(0.2, 11, 3), noisy(0.1, 11, 3)))
    return replace(flight, states=moved)


def check(figure: Figure) -> None:
    figure.draw_without_rendering()
    for axes in figure.axes:
        if not axes.axison:
            continue
        for name in ("x", "y", "z"):
            axis = getattr(axes, f"{name}axis", None)
            if axis is None:
                continue
            low, high = sorted(getattr(axes, f"get_{name}lim")())
            assert axis.get_offset_text().get_text() == "", axis.label.get_text()
            assert high - low > SEEN * max(abs(low), abs(high), 1.0), axis.label.get_text()


def test_a_flight_that_rests_has_axes_that_show_it():
    check(episode_figure(still()))
    check(charts_figure([*flight_charts(still())]))
