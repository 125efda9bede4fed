"""Default weights of LQR and MPC where starts are hundreds of metres away."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from rans.evaluation.measure.metrics import solved
from rans.flight import fly
from rans.model.spacecraft_file import load_spacecraft
from rans.optimal.control.lqr import LQR
from rans.optimal.control.mpc import MPC
from rans.optimal.control.regulator import distance_scale
from rans.scenario import scenarios
from rans.tasks import Dock, GoToPose, Hold


def test_near_starts_keep_the_weights() -> None:
    assert distance_scale(GoToPose(), load_spacecraft("floating-platform")) == 1.0
    assert distance_scale(GoToPose(), load_spacecraft("free-flyer")) == 1.0


@pytest.mark.slow
def test_the_lqr_spends_little_more_than_a_dash_from_afar() -> None:
    """A dash along each axis speeds up half of the way and brakes the other: 2 m sqrt(a d)."""
    task = Hold()
    craft = load_spacecraft("vbar-chaser")
    starts = scenarios(task, craft, 3, 8)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".* does not know the constraints .*")
        flight = fly(craft, task, LQR(craft, task, task.timing), starts, task.timing)
    force = craft.thrusters[0].force
    spent = flight.commands.sum(axis=(0, 2)) * force * task.timing.control_period
    way = np.abs((starts.start.p - starts.goal.p).columns())
    dash = 2.0 * craft.mass * np.sqrt(force / craft.mass * way).sum(axis=0)
    assert (spent < 1.5 * dash).all()


@pytest.mark.slow
def test_the_mpc_docks_below_the_speed_limit() -> None:
    task = Dock()
    craft = load_spacecraft("afrl-deputy")
    starts = scenarios(task, craft, 5, 2)
    flight = fly(craft, task, MPC(craft, task, task.timing), starts, task.timing)
    assert solved(flight).all()
    assert not flight.violated().any()
