"""The judge itself: against numbers worked by hand, and layer by layer against rans.model.dynamics."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from rans import Spacecraft, Thruster
from rans.model.actuators import ON_OFF
from rans.reference.plant import Plant
from validation.study.checks import Check
from validation.study.dynamics import (
    acceleration_checks,
    period_checks,
    thruster_checks,
    wrench_checks,
)


def lopsided(dimension: int) -> Spacecraft:
    """2 kg, 0.5 kg m^2, centre of mass at (0.1, 0, 0); pairs along x and y at odd places."""
    places = [
        ((0.5, 0.0, 0.0), (0.0, 1.0, 0.0), 3.0),
        ((0.5, 0.0, 0.0), (0.0, -1.0, 0.0), 1.0),
        ((0.0, 0.2, 0.0), (1.0, 0.0, 0.0), 4.0),
        ((0.0, 0.2, 0.0), (-1.0, 0.0, 0.0), 1.0),
        ((-0.3, 0.0, 0.0), (0.0, 1.0, 0.0), 1.0),
        ((-0.3, 0.0, 0.0), (0.0, -1.0, 0.0), 1.0),
    ]
    if dimension == 3:
        places += [((0.1, y, 0.0), (0.0, 0.0, z), 1.0) for y in (0.3, -0.4) for z in (1.0, -1.0)]
        places += [((x, 0.0, 0.0), (0.0, 0.0, z), 1.0) for x in (0.3, -0.4) for z in (1.0, -1.0)]
    inertia = ((0.5, 0.0, 0.0), (0.0, 0.4, 0.0), (0.0, 0.0, 0.5))
    return Spacecraft(
        "lopsided",
        dimension,  # type: ignore[arg-type]
        2.0,
        inertia,
        tuple(Thruster(*place) for place in places),
        centre_of_mass=(0.1, 0.0, 0.0),
    )


def test_wrenches_by_hand():
    wrenches = Plant(lopsided(2)).thruster_wrenches()
    # 3 N along y, 0.4 m ahead of the centre of mass; 4 N along x, 0.2 m to its left.
    assert wrenches[0] == pytest.approx([0.0, 3.0, 1.2], abs=1e-15)
    assert wrenches[2] == pytest.approx([4.0, 0.0, -0.8], abs=1e-15)
    up = Plant(lopsided(3)).thruster_wrenches()[6]
    # 1 N along z, 0.3 m to the left.
    assert up == pytest.approx([0.0, 0.0, 1.0, 0.3, 0.0, 0.0], abs=1e-15)


def test_planar_acceleration_by_hand():
    """Heading 90 degrees: 3 N along B's y pushes along -x of W; 1.2 N m turn 0.5 kg m^2."""
    state = np.array([[5.0, -3.0, math.pi / 2, 0.7, 0.2, 0.9]])
    command = np.eye(6)[[0]]
    found = Plant(lopsided(2)).accelerations(state, command)[0]
    assert found == pytest.approx(
        [-1.5, 0.0, 2.4], abs=1e-14
    )  # a rounded pi / 2 turns 3 N by 2e-16


def test_spatial_acceleration_by_hand():
    """Shut: Euler's equations alone. I w' = -w x I w with I = (0.5, 0.4, 0.5), w = (1, 2, 3):
    I w = (0.5, 0.8, 1.5), w x I w = (2*1.5-3*0.8, 3*0.5-1*1.5, 1*0.8-2*0.5) = (0.6, 0, -0.2)."""
    turned = [math.cos(0.3), math.sin(0.3) * 0.6, 0.0, math.sin(0.3) * 0.8]
    state = np.array([[1.0, 2.0, 3.0, *turned, 0.1, 0.2, 0.3, 1.0, 2.0, 3.0]])
    found = Plant(lopsided(3)).accelerations(state, np.zeros((1, 14)))[0]
    # Rounding of frames shifted to and from the centre of mass: some 1e-16 each.
    assert found == pytest.approx([0.0, 0.0, 0.0, -1.2, 0.0, 0.4], abs=1e-14)


def test_shipped_spacecraft_agree_layer_by_layer(shipped):
    shipped = replace(shipped, actuators=ON_OFF)  # layers below pulses, which test_worlds compares
    assert_none_failed([*exact_layers(shipped, 4), *period_checks(shipped, 4, 32)])


def exact_layers(craft: Spacecraft, seed: int) -> list[Check]:
    """The layers without time steps; tolerances and their reasons are those of `validation`."""
    return [
        *thruster_checks(craft),
        *wrench_checks(craft, seed, 16),
        *acceleration_checks(craft, seed, 16),
    ]


def assert_none_failed(checks: list[Check]) -> None:
    assert [check for check in checks if not check.passed] == []
