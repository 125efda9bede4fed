"""Checks of single moments against Drake: what they measure, and what they call the worst."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from rans.reference.plant import Plant
from tests.support.crafts import nasty_planar, nasty_spatial
from validation.study import dynamics
from validation.study.dynamics import (
    disturbance_checks,
    thruster_checks,
)

PLANE = nasty_planar()
SPACE = nasty_spatial()
both = pytest.mark.parametrize("craft", [PLANE, SPACE], ids=["plane", "space"])


def judge(monkeypatch: pytest.MonkeyPatch, name: str, error: np.ndarray) -> None:
    """Drake, off by something."""
    true = getattr(Plant, name)
    monkeypatch.setattr(Plant, name, lambda self, *arguments: true(self, *arguments) + error)


@both
def test_the_worst_thruster_is_named(craft, monkeypatch):
    """A newton too much for thruster 2 along x, half a newton metre for thruster 3 about the last axis."""
    error = np.zeros((len(craft.thrusters), 3 if craft is PLANE else 6))
    error[2, 0] = 1.0
    error[3, -1] = 0.5
    judge(monkeypatch, "thruster_wrenches", error)
    force, torque = thruster_checks(craft)
    assert (force.value, force.worst, force.unit) == (pytest.approx(1.0), "thruster 2", "N")
    assert (torque.value, torque.worst, torque.unit) == (pytest.approx(0.5), "thruster 3", "N m")


@both
def test_disturbances_are_as_strong_as_said(craft, monkeypatch):
    """Up to 0.5 N and 0.1 N m per axis, either way."""
    given = []

    class Pushed(Plant):
        def advance(
            self,
            states: Any,
            commands: Any,
            duration: float,
            disturbances: Any = None,
            nozzles: Any = None,
            earlier: Any = (),
            failure: Any = None,
        ) -> Any:
            given.append(disturbances)
            return super().advance(
                states, commands, duration, disturbances, nozzles, earlier, failure
            )

    monkeypatch.setattr(dynamics, "Plant", Pushed)
    checks = disturbance_checks(craft, 1, 60)
    assert all(check.passed for check in checks)
    forces = given[0][:, : craft.dimension]
    torques = given[0][:, craft.dimension :]
    for part, most in ((forces, 0.5), (torques, 0.1)):
        assert 0.9 * most < part.max() <= most  # the largest of 60 is short of it by a sixtieth
        assert -most <= part.min() < -0.9 * most
