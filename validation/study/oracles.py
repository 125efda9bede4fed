"""Motions whose solution is known, or found by other means than ours; Drake is not asked.

- Plane: constant force and torque in the body, by Fresnel integrals.
- Space: the asymmetric top without torque, by Jacobi's elliptic functions (Landau and Lifshitz,
  Mechanics, section 37).
- Both: SciPy's DOP853, an eighth-order Runge-Kutta pair, on equations written with rotation matrices
  from the thrusters' geometry.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation
from scipy.special import ellipj, fresnel

from rans.episode.flight import fly
from rans.episode.scenario import scenarios
from rans.model.body import Body
from rans.model.dynamics import PlanarState, SpatialState, Wrench, advance
from rans.model.fields import Heading, Quat, Vec2, Vec3, map_leaves
from rans.model.random import generator
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from rans.reference.nozzles import valve_commands
from rans.tasks import GoToPose
from validation.study.checks import Check, Skipped
from validation.study.dynamics import VALIDATION_SUBSTEPS
from validation.study.sampling import Restless, gap_checks, random_states, rollout

_PERIODS = 25
"""Length of these motions in control periods: 5 s."""
_SPLIT = np.array([0.85, 1.0, 1.15])
"""Factors that set principal moments apart, so that any spacecraft's make an asymmetric top."""


def oracle_checks(craft: Spacecraft, seed: int, count: int) -> list[Check | Skipped]:
    """The closed form of the dimension, and DOP853."""
    exact = _fresnel_checks if craft.dimension == 2 else _top_checks
    if craft.stores or not craft.has_only_thrusters:
        left_out = "It knows thrusters alone, of a mass that stays; tests integrate the others."
        return [*exact(craft, seed, count), Skipped("DOP853", left_out)]
    return [*exact(craft, seed, count), *_dop853_checks(craft, seed, min(count, 16))]


def _fresnel_checks(craft: Spacecraft, seed: int, count: int) -> list[Check]:
    """Random force and torque, spinning up by 0.2 to 2 rad/s^2, each constant in the body for 5 s."""
    start = random_states(2, seed, count)
    random = generator(seed)
    body = Body.of(craft)
    spin_up = random.uniform(0.2, 2.0, count) * random.choice((-1.0, 1.0), count)
    push = random.uniform(-1.0, 1.0, count) + 1j * random.uniform(-1.0, 1.0, count)
    force = push * craft.mass
    applied = Wrench(Vec2(force.real, force.imag), spin_up * body.inertia[0])
    state = start
    period = Timing().control_period
    for _ in range(_PERIODS):
        state = advance(state, applied, body, period)
    expected = spinning_up(start, push, spin_up, _PERIODS * period)
    reason = (
        "Rounding and six-node quadrature of 25 periods, in which heading and spin reach 30 rad and "
        "11 rad/s: 2 rad a period."
    )
    return gap_checks("Fresnel integrals", state, expected, 1e-9, reason)


def spinning_up(start: PlanarState, push: Any, spin_up: Any, duration: float) -> PlanarState:
    """The exact motion under a constant acceleration in the body and a constant spin-up.

    The heading is theta + w t + a t^2 / 2; with the square completed, its cosine and sine integrate to
    Fresnel integrals C and S. For the position, integrals of s cos and s sin follow by parts.

    Args:
        start: fields (N,).
        push: force over mass in B, (N,) complex as x + i y, m/s^2.
        spin_up: a, (N,) not zero, rad/s^2.
        duration: s.
    """
    root = np.sqrt(np.abs(spin_up) / np.pi)
    first = start.w / spin_up
    last = start.w / spin_up + duration

    def primitive(shifted: Any) -> Any:
        sine, cosine = fresnel(shifted * root)
        return (cosine + 1j * np.sign(spin_up) * sine) / root

    vertex = np.exp(1j * (start.attitude.angle - 0.5 * start.w**2 / spin_up))
    heading = start.attitude.angle + duration * (start.w + 0.5 * spin_up * duration)
    total = vertex * (primitive(last) - primitive(first))
    turn = np.exp(1j * heading) - np.exp(1j * start.attitude.angle)
    moment = turn / (1j * spin_up) - start.w / spin_up * total
    v = push * total
    way = push * (duration * total - moment)
    return PlanarState(
        p=start.p + start.v.scale(duration) + Vec2(way.real, way.imag),
        attitude=Heading(heading),
        v=start.v + Vec2(v.real, v.imag),
        w=start.w + spin_up * duration,
    )


def _top_checks(craft: Spacecraft, seed: int, count: int) -> list[Check]:
    """Tumbling without torque, about skew axes, from spins in the plane of least and largest moment."""
    random = generator(seed)
    moments = np.linalg.eigvalsh(np.array(craft.inertia)) * _SPLIT
    axes = Rotation.from_rotvec([0.5, -0.8, 0.3]).as_matrix()
    inertia = axes @ np.diag(moments) @ axes.T
    body = Body(craft.mass, tuple(inertia[np.triu_indices(3)]))
    least, largest = random.uniform(0.2, 1.0, (2, count))
    states = random_states(3, seed, count)
    state = SpatialState(
        states.p, states.attitude, states.v, Vec3(*(axes @ np.array([least, 0.0 * least, largest])))
    )
    period = Timing().control_period
    nothing = Wrench(Vec3(0.0, 0.0, 0.0), Vec3(0.0, 0.0, 0.0))
    for _ in range(_PERIODS):
        state = advance(state, nothing, body, period, VALIDATION_SUBSTEPS[3]).normalised()
    expected = axes @ tumbling(moments, least, largest, _PERIODS * period)
    error = np.linalg.norm(np.array(state.w.columns()) - expected, axis=0)
    return [
        Check(
            "asymmetric top: spin",
            float(error.max()),
            1e-9,
            "rad/s",
            "Sixth-order truncation of 5 s, and rounding.",
            f"state {error.argmax()}",
        )
    ]


def tumbling(moments: np.ndarray, least: Any, largest: Any, time: float) -> np.ndarray:
    """Spin of the torque-free top about its principal axes, (3, N) rad/s.

    Args:
        moments: (3,) ascending, all different, kg m^2.
        least: spin about the axis of least moment at the start, (N,) > 0, rad/s.
        largest: the same for the largest moment; about the middle one there is none.
        time: s.
    """
    a, b, c = moments
    energy = a * least**2 + c * largest**2  # twice
    momentum = (a * least) ** 2 + (c * largest) ** 2  # squared
    inner = momentum < energy * b  # the path encloses the axis of least moment, not the largest
    first = np.where(inner, c, a)
    last = np.where(inner, a, c)
    rate = np.sqrt((last - b) * (momentum - energy * first) / (a * b * c))
    squared = (b - first) * (energy * last - momentum) / ((last - b) * (momentum - energy * first))
    sn, cn, dn, _ = ellipj(rate * time, squared)
    at_first = np.sqrt((energy * last - momentum) / (first * (last - first))) * cn
    middle = np.sqrt((energy * last - momentum) / (b * (last - b))) * sn
    at_last = np.sqrt((momentum - energy * first) / (last * (last - first))) * dn
    return np.array(
        [np.where(inner, at_last, at_first), middle, np.where(inner, at_first, at_last)]
    )


def _dop853_checks(craft: Spacecraft, seed: int, count: int) -> list[Check]:
    """5 s under a restless controller."""
    timing = Timing(episode_steps=_PERIODS)
    task = GoToPose()
    starts = scenarios(task, craft, seed, count)
    period = timing.control_period
    commands = fly(craft, task, Restless(craft, seed), starts, timing).commands
    states: Any = starts.start
    ours = rollout(craft, states, commands, period, VALIDATION_SUBSTEPS[craft.dimension])
    solve = _solve_planar if craft.dimension == 2 else _solve_spatial
    expected: Any = states
    for command in commands:
        parts = valve_commands(craft.actuators, command, period)
        for (begun, opened), end in zip(
            parts, [*(begin for begin, _ in parts[1:]), period], strict=True
        ):
            expected = solve(craft, expected, *_geometry(craft, opened), end - begun)
    last = map_leaves(lambda x: x[-1], ours)
    return gap_checks(
        "DOP853",
        last,
        expected,
        1e-9 if craft.dimension == 2 else 1e-8,
        "Its own tolerance (1e-13 a step), and our truncation at validation substeps, over "
        "25 periods.",
    )


def _geometry(craft: Spacecraft, command: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Force and torque about the centre of mass in B, each (N, 3), from positions and directions."""
    if craft.thrust_sharing == "split":
        command = command / np.maximum(command.sum(axis=1, keepdims=True), 1.0)
    forces = np.array([np.array(t.direction) * t.force for t in craft.thrusters])
    arms = np.array([t.position for t in craft.thrusters]) - np.array(craft.centre_of_mass)
    return command @ forces, command @ np.cross(arms, forces)


def _solve_planar(
    craft: Spacecraft, state: Any, force: Any, torque: Any, period: float
) -> PlanarState:
    mass = craft.mass
    moment = craft.inertia[2][2]
    push = (force[:, 0] + 1j * force[:, 1]) / mass

    def rate(time: float, flat: np.ndarray) -> np.ndarray:
        _, _, angle, vx, vy, w = flat.reshape(6, -1)
        turned = np.exp(1j * angle) * push
        return np.concatenate([vx, vy, w, turned.real, turned.imag, torque[:, 2] / moment])

    start = np.concatenate([*state.p.columns(), state.attitude.angle, *state.v.columns(), state.w])
    x, y, angle, vx, vy, w = _integrated(rate, start, period).reshape(6, -1)
    return PlanarState(Vec2(x, y), Heading(angle), Vec2(vx, vy), w)


def _solve_spatial(
    craft: Spacecraft, state: Any, force: Any, torque: Any, period: float
) -> SpatialState:
    """Position, velocity, spin in B and the columns of R_WB: R' = R [w]x."""
    inertia = np.array(craft.inertia)
    count = len(force)

    def rate(time: float, flat: np.ndarray) -> np.ndarray:
        motion = flat[: 9 * count].reshape(3, count, 3)
        R = flat[9 * count :].reshape(count, 3, 3)
        _, v, w = motion
        spin_up = np.linalg.solve(inertia, (torque - np.cross(w, w @ inertia)).T).T
        turning = np.cross(R, w[:, None, :])  # each row of R times [w]x
        push = np.einsum("nij,nj->ni", R, force) / craft.mass
        return np.concatenate([v.ravel(), push.ravel(), spin_up.ravel(), turning.ravel()])

    q = state.attitude
    R = Rotation.from_quat(np.stack([q.x, q.y, q.z, q.w], axis=1)).as_matrix()
    vectors = [np.stack(v.columns(), axis=1) for v in (state.p, state.v, state.w)]
    flat = _integrated(rate, np.concatenate([np.array(vectors).ravel(), R.ravel()]), period)
    p, v, w = flat[: 9 * count].reshape(3, count, 3)
    x, y, z, s = Rotation.from_matrix(flat[9 * count :].reshape(count, 3, 3)).as_quat().T
    return SpatialState(Vec3(*p.T), Quat(s, x, y, z), Vec3(*v.T), Vec3(*w.T))


def _integrated(rate: Any, start: np.ndarray, period: float) -> np.ndarray:
    return solve_ivp(rate, (0.0, period), start, "DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
