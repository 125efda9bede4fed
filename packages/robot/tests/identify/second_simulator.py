"""Flights of a second simulator: SciPy's DOP853 on Newton's and Euler's equations, without any code of the engine.

Everything moves in space; a planar craft is one whose forces and torques lie in its plane. Thrust is linear between
the instants at which a command was given, begins to act and acts in full, so that each part is smooth.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from rans_robot.identify.log import FlightLog
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from rans.model.spacecraft import Spacecraft


@dataclass(frozen=True)
class Noise:
    """Standard deviations of readings: m, rad, m/s and rad/s."""

    position: float = 0.005
    attitude: float = 0.008
    velocity: float = 0.01
    spin: float = 0.008


def flown_log(
    craft: Spacecraft,
    commands: np.ndarray,
    period: float | np.ndarray,
    times: np.ndarray,
    random: np.random.Generator,
    noise: Noise,
    *,
    latency: float = 0.0,
    rise: float = 0.0,
    force: tuple[float, float, float] = (0.0, 0.0, 0.0),
    torque: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> FlightLog:
    """Log of a craft that begins at rest, with on/off thrusters.

    Args:
        craft: the true one; its centre of mass is that of its file.
        commands: (T, C), the first at 0 s.
        period: s, or when each command was given, (T,), s.
        times: (M,), s, when readings are taken.
        random: of their noise.
        noise: of the readings.
        latency: s from a command until the thrust begins to change.
        rise: s in which it changes linearly.
        force: constant, N, in the world.
        torque: constant, N m, in the world.
    """
    count = craft.thruster_count
    arms = np.array([t.position for t in craft.thrusters]) - np.array(craft.centre_of_mass)
    pushes = np.array([np.multiply(t.direction, t.force) for t in craft.thrusters])
    turns = np.cross(arms, pushes)
    inertia = np.array(craft.inertia)
    given = np.asarray(period)
    if given.ndim == 0:
        given = np.arange(len(commands)) * given
    # Shares of full thrust at the ends of their ramps, between which they are linear; a step has a ramp of 1 ns.
    ramp = max(rise, 1e-9)
    knots = np.ravel(np.column_stack([given + latency, given + latency + ramp]))
    before = np.vstack([np.zeros(count), commands[:-1]])
    levels = np.stack([before, commands], axis=1).reshape(-1, count)
    if ramp > np.diff(given).min():
        raise ValueError("ramps longer than a period would overlap")

    def rate(t: float, y: np.ndarray, t0: float, s0: np.ndarray, slope: np.ndarray) -> np.ndarray:
        turned = Rotation.from_quat(y[6:10])
        w = y[10:]
        opening = s0 + slope * (t - t0)
        acceleration = (turned.apply(opening @ pushes) + force) / craft.mass
        outside = opening @ turns + turned.inv().apply(torque)
        spin = np.linalg.solve(inertia, outside - np.cross(w, inertia @ w))
        x = y[6:9]
        v = y[9]
        quaternion = 0.5 * np.append(v * w + np.cross(x, w), -x @ w)
        return np.concatenate([y[3:6], acceleration, quaternion, spin])

    state = np.concatenate([np.zeros(9), [1.0], np.zeros(3)])
    end = float(times[-1])
    edges = np.unique(np.concatenate([given, knots, [0.0, end]]))
    edges = edges[(edges >= 0.0) & (edges <= end)]
    rows = []
    for begin, stop in itertools.pairwise(edges):
        shares = np.stack(
            [
                [np.interp(t, knots, levels[:, j], left=0.0) for j in range(count)]
                for t in (begin, stop)
            ]
        )
        slope = (shares[1] - shares[0]) / (stop - begin)
        inside = times[(times >= begin) & (times < stop)]
        part = solve_ivp(
            rate,
            (begin, stop),
            state,
            "DOP853",
            np.append(inside, stop),
            args=(begin, shares[0], slope),
            rtol=1e-9,
            atol=1e-11,
        ).y
        rows.append(part[:, :-1])
        state = part[:, -1].copy()
        state[6:10] /= np.linalg.norm(state[6:10])
    rows.append(state[:, None])
    y = np.concatenate(rows, axis=1)[:, : len(times)]

    def shaken(values: np.ndarray, deviation: float) -> np.ndarray:
        return values + random.normal(0.0, deviation, values.shape)

    turned = Rotation.from_quat(y[6:10].T)
    if craft.dimension == 2:
        attitude = shaken(np.unwrap(turned.as_rotvec()[:, 2]), noise.attitude)
        spin = shaken(y[12], noise.spin)
    else:
        small = Rotation.from_rotvec(shaken(np.zeros((len(times), 3)), noise.attitude))
        attitude = np.roll((turned * small).as_quat(), 1, axis=1)
        spin = shaken(y[10:13].T, noise.spin)
    d = craft.dimension
    return FlightLog(
        "the second simulator",
        given,
        commands,
        times,
        shaken(y[:d].T, noise.position),
        attitude,
        shaken(y[3 : 3 + d].T, noise.velocity),
        spin,
    )
