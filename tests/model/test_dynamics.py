"""The equations of motion against analysis and SciPy; Drake's verdict is in tests/reference."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from rans.model.body import Body
from rans.model.dynamics import Wrench, advance, thrust, wrench
from rans.model.fields import Vec2, Vec3, leaves
from rans.model.spacecraft import Spacecraft, Thruster
from tests.support.crafts import random_states
from tests.support.states import in_space

FINE = 64
"""Substeps of a spatial control period at which truncation is below 1e-10 for spins of some rad/s."""

seeds = st.integers(0, 2**32 - 1)


def rotation(q: Any) -> Rotation:
    """SciPy's rotation of our quaternion."""
    return Rotation.from_quat(np.stack(np.broadcast_arrays(q.x, q.y, q.z, q.w), axis=-1))


def rows(vector: Any) -> np.ndarray:
    """(N, 2 or 3)."""
    return np.stack(np.broadcast_arrays(*vector.columns()), axis=-1)


def random_wrench(dimension: int, count: int, seed: int) -> Wrench:
    """Up to 2 N and 0.5 N m a component: some thrusters of the shipped spacecraft."""
    generator = np.random.default_rng(seed)
    force = generator.uniform(-2.0, 2.0, (dimension, count))
    torque = generator.uniform(-0.5, 0.5, (3, count))
    return (
        Wrench(Vec2(*force), torque[0]) if dimension == 2 else Wrench(Vec3(*force), Vec3(*torque))
    )


def test_one_thruster_by_hand() -> None:
    """3 N along y at x = 0.5 m; the centre of mass at x = 0.1 m leaves an arm of 0.4 m: 1.2 N m."""
    inertia = ((0.5, 0.0, 0.0), (0.0, 0.5, 0.0), (0.0, 0.0, 0.5))
    nozzle = Thruster((0.5, 0.0, 0.2), (0.0, 1.0, 0.0), 3.0)
    with pytest.warns(UserWarning, match="cannot push and turn"):
        planar = Spacecraft("one", 2, 2.0, inertia, (nozzle,), centre_of_mass=(0.1, 0.0, 0.2))
    with pytest.warns(UserWarning, match="cannot push and turn"):
        spatial = replace(planar, dimension=3, centre_of_mass=(0.1, 0.0, 0.0))
    assert leaves(wrench(planar, (0.5,))) == pytest.approx((0.0, 1.5, 0.6), abs=1e-15)
    # In space the nozzle also sits 0.2 m above: -0.2 * 3 about x.
    assert leaves(wrench(spatial, (1.0,))) == pytest.approx(
        (0.0, 3.0, 0.0, -0.6, 0.0, 1.2), abs=1e-15
    )


def test_split_thrust_by_hand(planar_craft: Spacecraft) -> None:
    craft = replace(planar_craft, thrust_sharing="split")
    assert thrust(craft, (1.0, 1.0, 0.0, 1.0, 1.0)) == (0.25, 0.25, 0.0, 0.25, 0.25)
    assert thrust(craft, (0.0, 1.0, 0.0, 0.0, 0.0)) == (0.0, 1.0, 0.0, 0.0, 0.0)
    assert thrust(craft, (0.25, 0.0, 0.5, 0.0, 0.0)) == (0.25, 0.0, 0.5, 0.0, 0.0)
    assert thrust(planar_craft, (1.0, 1.0, 0.0, 1.0, 1.0)) == (1.0, 1.0, 0.0, 1.0, 1.0)


def test_nozzles_take_pressure_from_their_own_supply_only(planar_craft: Spacecraft) -> None:
    """A droop of 0.5: two open nozzles have 1 / 1.5 of their force each, one and a half 1 / 1.25, one all of it."""
    fed = tuple(
        replace(thruster, supply=supply)
        for thruster, supply in zip(planar_craft.thrusters, (4, 4, 4, 7, 7), strict=True)
    )
    craft = replace(planar_craft, thrusters=fed)
    assert craft.supplies == ((0, 1, 2), (3, 4))
    body = replace(Body.of(craft), droop=0.5)
    assert thrust(craft, (1.0, 1.0, 0.0, 1.0, 0.5), body) == pytest.approx(
        (2 / 3, 2 / 3, 0.0, 0.8, 0.4), abs=1e-15
    )
    # A nozzle that is stuck open takes from its own supply too.
    stuck = replace(body, gain=(1.0, 1.0, 0.0, 1.0, 1.0), leak=(0.0, 0.0, 1.0, 0.0, 0.0))
    assert thrust(craft, (1.0, 0.0, 0.0, 1.0, 0.0), stuck) == pytest.approx(
        (2 / 3, 0.0, 2 / 3, 1.0, 0.0), abs=1e-15
    )
    # One supply for all has four nozzles' worth and a half open: 1 / (1 + 0.5 * 2.5).
    single = replace(Body.of(planar_craft), droop=0.5)
    assert thrust(planar_craft, (1.0, 1.0, 0.0, 1.0, 0.5), single)[0] == pytest.approx(1 / 2.25)


@settings(max_examples=10)
@given(seed=seeds)
def test_plane_embedded_in_space(seed: int) -> None:
    """A flat motion in space is the motion in the plane, whatever the inertia about the other axes."""
    flat = random_states(2, 8, seed)
    applied = random_wrench(2, 8, seed)
    plane = advance(flat, applied, Body(5.32, (0.2,)), 0.2)
    zero = np.zeros(8)
    x, y, torque = leaves(applied)
    lifted = Wrench(Vec3(x, y, zero), Vec3(zero, zero, torque))
    space = advance(
        in_space(flat), lifted, Body(5.32, (0.13, 0.02, 0.0, 0.17, 0.0, 0.2)), 0.2, FINE
    )

    assert rows(space.p) == pytest.approx(np.column_stack([rows(plane.p), zero]), abs=1e-10)
    assert rows(space.v) == pytest.approx(np.column_stack([rows(plane.v), zero]), abs=1e-10)
    assert rows(space.w) == pytest.approx(np.column_stack([zero, zero, plane.w]), abs=1e-13)
    headed = Rotation.from_rotvec(np.column_stack([zero, zero, plane.attitude.angle]))
    # Truncation at 3 ms, spins up to 1.5 rad/s.
    assert (rotation(space.attitude).inv() * headed).magnitude() == pytest.approx(0.0, abs=1e-10)
