"""Attitude in frames that turn unevenly, against SciPy's integrator in axes that do not turn."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from rans_missions.orbits.elliptic import EllipticOrbit, mean_anomaly
from rans_missions.orbits.perturbed import PerturbedOrbit
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from rans.effectors.motion import held
from rans.model.body import Body
from rans.model.drift import Drift
from rans.model.dynamics import SpatialState, Wrench, advance
from rans.model.fields import Quat, Vec3
from rans.model.spacecraft_file import load_spacecraft
from rans.model.timing import Timing

N = 0.001027
"""rad/s, a low orbit."""
EARTH = 3.986004418e14
"""m^3/s^2."""
SIZE = (EARTH / N**2) ** (1 / 3)
TENSOR = np.array([[0.9, 0.1, -0.2], [0.1, 1.4, 0.15], [-0.2, 0.15, 1.8]])
"""kg m^2."""
MASS = 7.0
PUSH = np.array([0.004, -0.003, 0.002]), np.array([2e-5, 3e-5, -4e-5])
"""Thrust, N, and torque, N m, in B."""
WIND = np.array([-0.001, 0.002, 0.0005]), np.array([-3e-5, 1e-5, 2e-5])
"""Force, N, and torque, N m, that are constant in W."""


def solved(rates: Any, start: Any, time: float) -> np.ndarray:
    """End of an integration."""
    return solve_ivp(rates, (0.0, time), start, "DOP853", rtol=1e-12, atol=1e-14).y[:, -1]


def axes_of(r: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, float]:
    """Axes of the Hill frame as columns, and its rate about the last, rad/s."""
    momentum = np.cross(r, v)
    size = float(np.linalg.norm(momentum))
    out = r / np.linalg.norm(r)
    return np.stack([out, np.cross(momentum / size, out), momentum / size], 1), size / float(r @ r)


def in_inertial_axes(
    e: float, anomaly: float, start: dict[str, Any], time: float, winds: bool
) -> tuple[np.ndarray, ...]:
    """Position, velocity, attitude and spin in W after a time: target and craft fall and turn among the stars.

    The target follows Newton's law. The craft's distance from it follows the first order of the difference, as the
    drifts do, and its attitude Euler's equation.
    """
    parameter = SIZE * (1 - e * e)
    speed = math.sqrt(EARTH / parameter)
    c, s = math.cos(anomaly), math.sin(anomaly)
    target = parameter / (1 + e * c) * np.array([c, s, 0.0])
    moving = speed * np.array([-s, e + c, 0.0])

    def rates(_: float, y: np.ndarray) -> np.ndarray:
        r, v, p, u, w = (y[k : k + 3] for k in (0, 3, 6, 9, 16))
        distance = math.sqrt(r @ r)
        turned = Rotation.from_quat(y[12:16])
        to_world, _ = axes_of(r, v)
        force = turned.apply(PUSH[0])
        torque = PUSH[1].copy()
        if winds:
            force = force + to_world @ WIND[0]
            torque += turned.inv().apply(to_world @ WIND[1])
        pull = EARTH / distance**3 * (3 * (r @ p) / distance**2 * r - p)
        x, y_, z, s = y[12:16]
        q = np.array([x, y_, z])
        return np.concatenate(
            [
                v,
                -EARTH / distance**3 * r,
                u,
                pull + force / MASS,
                0.5 * (s * w + np.cross(q, w)),
                [-0.5 * (q @ w)],
                np.linalg.solve(TENSOR, torque - np.cross(w, TENSOR @ w)),
            ]
        )

    axes, rate = axes_of(target, moving)
    turning = rate * axes[:, 2]
    attitude = Rotation.from_matrix(axes) * start["attitude"]
    p = axes @ start["p"]
    spin = start["w"] + attitude.inv().apply(turning)
    y = np.concatenate(
        [
            target,
            moving,
            p,
            axes @ start["v"] + np.cross(turning, p),
            attitude.as_quat(),
            spin,
        ]
    )
    y = solved(rates, y, time)
    r, v, p, u, w = (y[k : k + 3] for k in (0, 3, 6, 9, 16))
    axes, rate = axes_of(r, v)
    turning = rate * axes[:, 2]
    attitude = Rotation.from_matrix(axes).inv() * Rotation.from_quat(y[12:16])
    return (
        axes.T @ p,
        axes.T @ (u - np.cross(turning, p)),
        attitude.as_matrix(),
        w - attitude.inv().apply([0.0, 0.0, rate]),
    )


START: dict[str, Any] = {
    "p": np.array([40.0, -25.0, 10.0]),
    "v": np.array([0.02, 0.05, -0.03]),
    "attitude": Rotation.from_rotvec([0.5, -0.8, 1.1]),
    "w": np.array([0.004, -0.002, 0.003]),
}


@pytest.mark.parametrize("winds", [False, True], ids=["thrust", "thrust and wind"])
def test_a_craft_flies_and_turns_as_among_the_stars(winds: bool) -> None:
    """A tenth of an orbit; without the turn of W the attitude would be wrong by 0.6 rad."""
    e, time, anomaly = 0.5, 600.0, -0.7
    p, v, attitude, w = in_inertial_axes(e, anomaly, START, time, winds)
    drift = EllipticOrbit(N, e, mean_anomaly(anomaly, e))
    q = map(float, START["attitude"].as_quat(scalar_first=True))
    place, velocity, spin = (Vec3(*map(float, START[key])) for key in ("p", "v", "w"))
    start = SpatialState(place, Quat(*q), velocity, spin)
    body = Body(MASS, tuple(map(float, TENSOR[np.triu_indices(3)])))
    thrust, wind = (Wrench(*(Vec3(*map(float, x)) for x in pair)) for pair in (PUSH, WIND))
    disturbance = wind if winds else None
    state = advance(start, thrust, body, time, 100, disturbance=disturbance, drift=drift)
    # Steps of 6 s turn the craft by 0.1 rad: halves of them are 64 times as near, as the order of six asks for.
    q = state.attitude.normalised()
    found = Rotation.from_quat([q.x, q.y, q.z, q.w]).as_matrix()
    np.testing.assert_allclose(found, attitude, rtol=0, atol=1e-9)
    np.testing.assert_allclose(state.w.columns(), w, rtol=0, atol=1e-11)
    np.testing.assert_allclose(state.p.columns(), p, rtol=0, atol=1e-7)
    np.testing.assert_allclose(state.v.columns(), v, rtol=0, atol=1e-9)


DRIFTS = {
    "ellipse": (EllipticOrbit(N, 0.74, 5.9), 0.0),
    "oblate": (PerturbedOrbit(N, 1.4e-3, 0.9, 0.0, 2.1), 1.4e-3),
}


@pytest.mark.parametrize("name", DRIFTS)
@pytest.mark.parametrize("time", [0.1, 10.0, 1500.0])
def test_w_turns_by_its_rate(name: str, time: float) -> None:
    """A quaternion that follows the rate; around an oblate planet up to the second order of what it turns."""
    drift, k = DRIFTS[name]

    def rates(t: float, q: np.ndarray) -> np.ndarray:
        rate: Any = drift.later(t).rate()
        w = np.array(rate.columns())
        return np.array([-0.5 * (q[1:] @ w), *(0.5 * (q[0] * w + np.cross(q[1:], w)))])

    turn: Any = drift.turn(time)
    found = [turn.w, turn.x, turn.y, turn.z]
    atol = 1e-11 + (k * N * time) ** 2
    np.testing.assert_allclose(found, solved(rates, [1.0, 0.0, 0.0, 0.0], time), atol=atol)
    # Two parts make the whole.
    first, second = drift.turn(0.4 * time), drift.later(0.4 * time).turn(0.6 * time)
    assert first is not None
    assert second is not None
    both = first.times(second)
    np.testing.assert_allclose([both.w, both.x, both.y, both.z], found, atol=1e-13 + atol)


def test_a_craft_that_nothing_turns_is_held_in_w_where_it_stands() -> None:
    """On an ellipse W turns unevenly, and a point has no attitude of its own; with a spin it is a free body."""
    point, other = load_spacecraft("afrl-deputy"), load_spacecraft("free-flyer")
    zero = np.zeros(2)
    spins = np.array([0.0, 0.001])
    state = SpatialState(
        Vec3(zero, zero, zero),
        Quat(zero + 1.0, zero, zero, zero),
        Vec3(zero, zero, zero),
        Vec3(zero, zero, spins),
    )
    drift = EllipticOrbit(N, 0.5, 0.0)
    timing = Timing(control_period=10.0, substeps=1)
    angles = []
    for craft in (point, other):
        now: Drift = drift
        after = state
        for _ in range(60):
            shut = (zero,) * craft.command_count
            after = held(after, craft, Body.of(craft), shut, timing, now)
            now = now.later(10.0)
        angles.append(2.0 * np.arctan2(after.attitude.z, after.attitude.w))
    # From the perigee on the line to the target slows down, and a free body turns ahead.
    free = angles[1]
    assert angles[0] == pytest.approx([0.0, free[1]], abs=1e-12)
    assert free[0] > 0.1
    assert free[1] - free[0] == pytest.approx(0.6, abs=1e-12)
