"""The equations of motion against analysis and SciPy; Drake's verdict is in tests/reference."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from rans.model.body import Body
from rans.model.dynamics import SpatialState, Wrench, advance, thrust, wrench
from rans.model.fields import Quat, Vec2, Vec3, leaves, map_leaves, unflatten
from rans.model.spacecraft import Spacecraft, Thruster
from tests.support.crafts import nasty_spatial, random_states

FINE = 64
"""Substeps of a spatial control period at which truncation is below 1e-10 for spins of some rad/s."""

seeds = st.integers(0, 2**32 - 1)
turns = st.tuples(*[st.floats(-2.0, 2.0)] * 3)


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


NASTY = Body.of(nasty_spatial())
"""Three different principal moments about skew axes."""


# Wrenches


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


# The plane


@given(seed=seeds)
def test_plane_agrees_with_scipy(seed: int) -> None:
    body = Body(5.32, (0.2045,))
    period = 0.2
    state = random_states(2, 1, seed)
    applied = random_wrench(2, 1, seed)
    angular = float(np.squeeze(leaves(applied)[2])) / 0.2045
    force = rows(applied.force)[0]

    def rate(_: float, y: np.ndarray) -> np.ndarray:
        pushed = Rotation.from_rotvec([0.0, 0.0, y[2]]).apply([*force, 0.0]) / 5.32
        return np.array([*y[3:], *pushed[:2], angular])

    start = np.squeeze(leaves(state))
    expected = solve_ivp(rate, (0.0, period), start, "DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
    found = np.squeeze(leaves(advance(state, applied, body, period)))
    assert found == pytest.approx(expected, abs=1e-12)  # DOP853's tolerance over some ten steps


# Space


def test_order_of_accuracy_is_six() -> None:
    state = random_states(3, 64, 1)
    applied = random_wrench(3, 64, 1)
    runs = [np.array(leaves(advance(state, applied, NASTY, 0.2, n))) for n in (2, 4, 8, 64)]
    errors = [np.linalg.norm(run - runs[-1]) for run in runs[:-1]]
    slopes = np.diff(np.log2(errors))
    assert slopes == pytest.approx([-6.0, -6.0], abs=0.2)  # the next term, two tenths at 2 substeps


# Symmetries


@given(turn=turns, seed=seeds)
def test_turning_the_world_turns_the_motion(turn: tuple[float, ...], seed: int) -> None:
    """World axes turned by SciPy; the motion in B must not notice."""
    state = random_states(3, 8, seed)
    applied = random_wrench(3, 8, seed)
    world = Rotation.from_rotvec(turn)

    def turned(s: Any) -> SpatialState:
        x, y, z, w = (world * rotation(s.attitude)).as_quat().T
        return SpatialState(
            Vec3(*world.apply(rows(s.p)).T), Quat(w, x, y, z), Vec3(*world.apply(rows(s.v)).T), s.w
        )

    first = advance(turned(state), applied, NASTY, 0.2, 2)
    last = turned(advance(state, applied, NASTY, 0.2, 2))
    # Rounding: whatever the substeps leave out, they leave out of both.
    for a, b in ((first.p, last.p), (first.v, last.v), (first.w, last.w)):
        assert rows(a) == pytest.approx(rows(b), abs=1e-12)
    difference = rotation(first.attitude).inv() * rotation(last.attitude)
    assert difference.magnitude() == pytest.approx(0.0, abs=1e-12)


@settings(max_examples=10)
@given(seed=seeds)
def test_plane_embedded_in_space(seed: int) -> None:
    """A flat motion in space is the motion in the plane, whatever the inertia about the other axes."""
    flat = random_states(2, 8, seed)
    applied = random_wrench(2, 8, seed)
    plane = advance(flat, applied, Body(5.32, (0.2,)), 0.2)
    half = flat.attitude.angle / 2
    zero = np.zeros(8)
    state = SpatialState(
        Vec3(flat.p.x, flat.p.y, zero),
        Quat(np.cos(half), zero, zero, np.sin(half)),
        Vec3(flat.v.x, flat.v.y, zero),
        Vec3(zero, zero, flat.w),
    )
    x, y, torque = leaves(applied)
    lifted = Wrench(Vec3(x, y, zero), Vec3(zero, zero, torque))
    space = advance(state, lifted, Body(5.32, (0.13, 0.02, 0.0, 0.17, 0.0, 0.2)), 0.2, FINE)

    assert rows(space.p) == pytest.approx(np.column_stack([rows(plane.p), zero]), abs=1e-10)
    assert rows(space.v) == pytest.approx(np.column_stack([rows(plane.v), zero]), abs=1e-10)
    assert rows(space.w) == pytest.approx(np.column_stack([zero, zero, plane.w]), abs=1e-13)
    headed = Rotation.from_rotvec(np.column_stack([zero, zero, plane.attitude.angle]))
    # Truncation at 3 ms, spins up to 1.5 rad/s.
    assert (rotation(space.attitude).inv() * headed).magnitude() == pytest.approx(0.0, abs=1e-10)


# One source, three libraries


@pytest.mark.parametrize("sharing", ["none", "split"])
def test_torch_and_casadi_compute_what_numpy_does(
    planar_craft, spatial_craft, sharing: str
) -> None:
    for craft in (planar_craft, spatial_craft):
        shared = replace(craft, thrust_sharing=sharing)
        state = random_states(craft.dimension, 16, 2)
        command = np.random.default_rng(3).random((len(craft.thrusters), 16))
        found = np.array(leaves(one_period(shared, state, command)))
        # The same operations in the same order; only sine, cosine and fused products may differ.
        assert by_torch(shared, state, command) == pytest.approx(found, abs=1e-13)
        assert by_casadi(shared, state, command) == pytest.approx(found, abs=1e-13)


def one_period(craft: Spacecraft, state: Any, command: Any) -> Any:
    return advance(state, wrench(craft, tuple(command)), Body.of(craft), 0.2, 2)


def by_torch(craft: Spacecraft, state: Any, command: np.ndarray) -> np.ndarray:
    import torch

    moved = one_period(craft, map_leaves(torch.from_numpy, state), torch.from_numpy(command))
    return torch.stack(leaves(moved)).numpy()


def by_casadi(craft: Spacecraft, state: Any, command: np.ndarray) -> np.ndarray:
    import casadi

    x = casadi.SX.sym("x", len(leaves(state)))  # type: ignore
    u = casadi.SX.sym("u", len(command))  # type: ignore
    moved = one_period(craft, unflatten(state, casadi.vertsplit(x)), casadi.vertsplit(u))
    step = casadi.Function("step", [x, u], [casadi.vertcat(*leaves(moved))])
    return np.array(step(np.array(leaves(state)), command))
