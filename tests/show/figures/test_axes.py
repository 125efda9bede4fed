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
from rans.evaluation.compare.optima import Optimum
from rans.flight import Flight
from rans.model.dynamics import PlanarState
from rans.model.fields import Heading, Vec2
from rans.optimal.trajectory.transcription import Trajectory
from rans.show.figures.optimal_figure import optimal_figure
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


def test_every_figure_has_settled_axes() -> None:
    """By the decorator `styled`: a figure that is drawn without it is found here."""
    found = dict(drawing_functions())
    assert len(found) > 4
    bare = [name for name, function in found.items() if not hasattr(function, "__wrapped__")]
    assert bare == []


def noisy(value: float, *shape: int) -> np.ndarray:
    return value + NOISE * np.random.default_rng(1).standard_normal(shape)


def still() -> Flight:
    """Three episodes that stay where they are, but for rounding errors."""
    flight = flight_of(noisy(1.0, 11, 3), 0.0, np.zeros((10, 3, 8)))
    moved = replace(flight.states, v=Vec2(noisy(0.2, 11, 3), noisy(0.1, 11, 3)))
    return replace(flight, states=moved)


def optimum() -> Optimum:
    """Five thrusters are open all the time, as a solver has it: each to 1e-8."""
    t = np.linspace(0.0, 1.0, 11)
    states = PlanarState(
        Vec2(t, noisy(0.0, 11)),
        Heading(noisy(0.0, 11)),
        Vec2(noisy(0.2, 11), noisy(0.0, 11)),
        noisy(0.0, 11),
    )
    commands = noisy(1.0, 10, 8)
    commands[:, 5:] = np.abs(noisy(0.0, 10, 3))
    path = Trajectory("time", "Solve_Succeeded", True, 1.0, states, commands, 0.1, 5, 0.1)
    return Optimum(0, path, 0.0)


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


def test_an_optimum_with_the_noise_of_its_solver_is_steady() -> None:
    """Five open thrusters: the axis counts from none to five, and not from 4.99999999 to 5.00000001."""
    figure = optimal_figure([optimum()])
    check(figure)
    (sums,) = (axes for axes in figure.axes if axes.get_ylabel() == "open thrusters")
    low, high = sums.get_ylim()
    assert low <= 0.0
    assert 5.0 < high < 6.0
    assert {float(tick) % 1.0 for tick in sums.get_yticks()} == {0.0}
    (paths,) = (axes for axes in figure.axes if axes.get_xlabel() == "x, m")
    assert "1 starts" not in paths.get_title(loc="left")
