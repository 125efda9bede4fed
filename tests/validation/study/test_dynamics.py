"""Checks of single moments against Drake: what they measure, and what they call the worst."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from rans.model.spacecraft import Spacecraft
from rans.reference.plant import Plant
from tests.support.crafts import nasty_planar, nasty_spatial
from tests.support.torquer import TURNED, TorquerInDrake
from validation.study import dynamics
from validation.study.checks import Check
from validation.study.dynamics import (
    _acceleration_check,
    acceleration_checks,
    disturbance_checks,
    mass_checks,
    thruster_checks,
    wrench_checks,
)

PLANE = nasty_planar()
SPACE = nasty_spatial()
both = pytest.mark.parametrize("craft", [PLANE, SPACE], ids=["plane", "space"])


def judge(monkeypatch: pytest.MonkeyPatch, name: str, error: np.ndarray) -> None:
    """Drake, off by something."""
    true = getattr(Plant, name)
    monkeypatch.setattr(Plant, name, lambda self, *arguments: true(self, *arguments) + error)


@both
def test_the_worst_thruster_is_named(craft: Spacecraft, monkeypatch: pytest.MonkeyPatch) -> None:
    """A newton too much for thruster 2 along x, half a newton metre for thruster 3 about the last axis."""
    error = np.zeros((len(craft.thrusters), 3 if craft is PLANE else 6))
    error[2, 0] = 1.0
    error[3, -1] = 0.5
    judge(monkeypatch, "thruster_wrenches", error)
    force, torque = thruster_checks(craft)
    assert (force.value, force.worst, force.unit) == (pytest.approx(1.0), "thruster 2", "N")
    assert (torque.value, torque.worst, torque.unit) == (pytest.approx(0.5), "thruster 3", "N m")


@both
def test_the_worst_command_is_named(craft: Spacecraft, monkeypatch: pytest.MonkeyPatch) -> None:
    error = np.zeros((7, 3 if craft is PLANE else 6))
    error[5, -1] = -0.25
    judge(monkeypatch, "wrenches", error)
    force, torque = wrench_checks(craft, 1, 7)
    assert force.passed
    assert (torque.value, torque.worst) == (pytest.approx(0.25), "command 5")


def test_only_the_largest_thruster_loosens_the_bound() -> None:
    """1e-12 up to 1 N, however many thrusters there are; 4e-12 for one of 4 N."""
    weak = replace(PLANE, thrusters=tuple(replace(t, force=0.4) for t in PLANE.thrusters))
    strong = replace(weak, thrusters=(replace(weak.thrusters[0], force=4.0), *weak.thrusters[1:]))
    assert [thruster_checks(craft)[0].tolerance for craft in (weak, strong)] == [
        1e-12,
        pytest.approx(4e-12),
    ]


@both
def test_mass_and_inertia_are_compared_by_their_own_size(
    craft: Spacecraft, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A millionth of the mass, of the largest moment, and a coupling of a micrometre's worth of mass."""
    size = craft.dimension
    largest = craft.inertia[2][2] if size == 2 else np.abs(np.array(craft.inertia)).max()
    for row, column, error in (
        (0, 0, craft.mass),
        (size, size, largest),
        (0, size, craft.mass),
        (size, 0, craft.mass),
    ):
        off = np.zeros((craft.degrees_of_freedom,) * 2)
        off[row, column] = 1e-6 * error
        with monkeypatch.context() as patched:
            judge(patched, "mass_matrix", off)
            [check] = mass_checks(craft)
        # Drake's largest moment is what is divided by, and that may be the one that is off.
        assert check.value == pytest.approx(1e-6, rel=1e-5)


def test_accelerations_are_compared_by_the_largest_or_by_what_cancels() -> None:
    """Rows differ by 0 and 5 where Drake's are at most 10: one half; of at least 20: a quarter."""
    drake = np.array([[6.0, 8.0], [3.0, 0.0]])
    ours = drake + np.array([[0.0, 0.0], [3.0, -4.0]])
    first = _acceleration_check("linear", ours, drake, 0.0, "Because.")
    assert (first.name, first.value, first.worst) == (
        "accelerations: linear",
        pytest.approx(0.5),
        "state 1",
    )
    assert _acceleration_check("linear", ours, drake, 20.0, "").value == pytest.approx(0.25)


def test_accelerations_are_of_every_effector(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ours agree with Drake's to rounding where a torquer turns the craft too, and fail where Drake's is weaker."""
    assert [check.passed for check in acceleration_checks(TURNED, 1, 8)] == [True, True]
    true = TorquerInDrake.values
    monkeypatch.setattr(TorquerInDrake, "values", lambda *given: 0.999 * true(*given))
    assert [check.passed for check in acceleration_checks(TURNED, 1, 8)] == [True, False]


@both
def test_disturbances_are_as_strong_as_said(
    craft: Spacecraft, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Up to 0.5 N and 0.1 N m per axis, either way."""
    given: list[np.ndarray] = []

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
    checks: list[Check] = disturbance_checks(craft, 1, 60)
    assert all(check.passed for check in checks)
    forces = given[0][:, : craft.dimension]
    torques = given[0][:, craft.dimension :]
    for part, most in ((forces, 0.5), (torques, 0.1)):
        assert 0.9 * most < part.max() <= most  # the largest of 60 is short of it by a sixtieth
        assert -most <= part.min() < -0.9 * most
