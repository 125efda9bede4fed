"""What mechanics demands of a motion whatever computes it; no other engine is asked."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from rans.model.body import Body
from rans.model.dynamics import Wrench, advance, wrench
from rans.model.fields import Heading, Quat, Vec2, Vec3, leaves
from rans.model.random import generator
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from validation.study.checks import Check
from validation.study.dynamics import tensor
from validation.study.sampling import gap, gap_checks, gentle_commands, random_states

_COAST = 5.0
"""Length of a flight without thrust, s."""


def invariant_checks(craft: Spacecraft, seed: int, count: int, substeps: int) -> list[Check]:
    """Conservation without thrust, work under thrust, and the order of the integrator.

    Args:
        craft: gives mass properties and thrusters; without thrusters random wrenches act.
        seed: of the random states, and of commands or wrenches.
        count: how many states.
        substeps: a control period, fine enough that the equations and not the step are tested.
    """
    states = random_states(craft.dimension, seed, count)
    body = Body.of(craft)
    if craft.thrusters:
        applied = wrench(craft, tuple(gentle_commands(craft, seed, count).T))
    else:
        applied = _random_wrench(body, seed, count)
    return [
        *_coasting_checks(states, body, substeps),
        _work_check(states, applied, body, substeps),
        _superposition_check(states, applied, body),
        *_turned_world_checks(states, applied, body),
        _order_check(states, applied, body)
        if craft.dimension == 3
        else _exactness_check(states, applied, body),
    ]


def _coasting_checks(states: Any, body: Body, substeps: int) -> list[Check]:
    """Momentum, angular momentum in W and energy without thrust."""
    periods = round(_COAST / Timing().control_period)
    later = states
    silent = _silence(states)
    for _ in range(periods):
        later = advance(later, silent, body, Timing().control_period, substeps).normalised()
    drift = (states.v - later.v).norm()
    turned = np.linalg.norm(
        _angular_momentum(states, body) - _angular_momentum(later, body), axis=0
    )
    gained = _rotation_energy(later, body) - _rotation_energy(states, body)
    size = _largest_momentum(states, body)
    energy = np.max(_rotation_energy(states, body))
    exact = "Nothing changes it without thrust: rounding of 5 s."
    truncation = "Nothing changes it without torque: truncation of 5 s at validation substeps."
    bound, reason = (1e-12, exact) if isinstance(states.p, Vec2) else (1e-9, truncation)
    return [
        Check("coasting: velocity", float(np.max(drift)), 1e-12, "m/s", exact),
        Check(
            "coasting: angular momentum", float(np.max(turned) / size), bound, "relative", reason
        ),
        Check(
            "coasting: energy", float(np.max(np.abs(gained)) / energy), bound, "relative", reason
        ),
    ]


def _work_check(states: Any, applied: Wrench, body: Body, substeps: int) -> Check:
    """Kinetic energy gained over one control period against the integral of force times velocity."""
    period = Timing().control_period
    nodes, weights = np.polynomial.legendre.leggauss(6)
    work = 0.0
    for node, weight in zip((nodes + 1) / 2, weights / 2, strict=True):
        then = advance(states, applied, body, node * period, substeps)
        work = work + weight * period * _power(then, applied)
    end = advance(states, applied, body, period, substeps)
    gained = _energy(end, body) - _energy(states, body)
    error = np.max(np.abs(gained - work)) / np.max(np.abs(gained))
    bound = 1e-10
    reason = "Six-node quadrature of smooth power, and rounding."
    if not isinstance(states.p, Vec2):
        bound = 1e-8
        reason = "Sixth-order truncation of the attitude over one period."
    return Check("work less energy gained", float(error), bound, "relative", reason)


def _superposition_check(states: Any, applied: Wrench, body: Body) -> Check:
    """With the same torque, two forces together give the velocities that each gives, added up."""
    period = Timing().control_period
    force: Any = applied.force
    shares = (force.scale(0.3), force.scale(0.7), force)
    first, second, both = (
        advance(states, replace(applied, force=f), body, period).v - states.v for f in shares
    )
    error = np.max((first + second - both).norm())
    return Check(
        "superposition of forces",
        float(error),
        1e-13 * max(1.0, float(np.max(both.norm()))),
        "m/s",
        "Motion is linear in the force where the attitude is given: rounding.",
    )


def _turned_world_checks(states: Any, applied: Wrench, body: Body) -> list[Check]:
    """Mechanics does not know where north is: to turn the world before or after a flight is the same."""
    period = Timing().control_period

    def turned(state: Any) -> Any:
        if isinstance(state.p, Vec2):
            north: Any = Heading(1.1)
            attitude: Any = Heading(state.attitude.angle + north.angle)
        else:
            north = Quat(0.5, -0.1, 0.7, 0.5).normalised()
            attitude = north.times(state.attitude)
        return replace(state, p=north.rotate(state.p), v=north.rotate(state.v), attitude=attitude)  # pyrefly: ignore[bad-argument-type]

    before = advance(turned(states), applied, body, period)
    after = turned(advance(states, applied, body, period))
    return gap_checks("world turned", before, after, 1e-12, "The same to rounding (1e-16 of 5 m).")


def _order_check(states: Any, applied: Wrench, body: Body) -> Check:
    """Order of accuracy, from how much two successive halvings of the step change the result.

    The fastest state turns by about 0.4 to 0.1 rad a step: longer ones show terms of higher order, shorter
    ones rounding.
    """
    spin = float(np.max(states.w.norm()))
    gain = np.linalg.norm(
        np.linalg.solve(tensor(body), np.array(applied.torque.columns())), axis=0
    ).max()
    # In which a turn that gathers speed comes to 1.6 rad: spin d + gain d^2 / 2.
    duration = 3.2 / (spin + float(np.sqrt(spin**2 + 3.2 * gain)))
    runs = [advance(states, applied, body, duration, n) for n in (4, 8, 16)]
    coarse, fine = (_distance(a, b) for a, b in pairwise(runs))
    return Check(
        "order of integration short of 6",
        max(0.0, 6.0 - float(np.log2(coarse / fine))),
        0.3,
        "-",
        "Magnus' series and the quadrature have order 6; the next terms take a tenth or two. The "
        "spin's series has 8, which shows where moments of inertia differ much.",
    )


def _exactness_check(states: Any, applied: Wrench, body: Body) -> Check:
    """One substep against eight: the plane's step has nothing left to gain."""
    period = Timing().control_period
    once, eight = (advance(states, applied, body, period, n) for n in (1, 8))
    return Check(
        "one substep against eight",
        max(gap(once, eight).values()),
        1e-10,
        "SI",
        "Exact but for six-node quadrature, good to 1e-10 for turns up to 2 rad a period.",
    )


def _random_wrench(body: Body, seed: int, count: int) -> Wrench:
    """Accelerations of up to 1 m/s^2 and 1 rad/s^2 along and about every axis, as force and torque."""
    random = generator(seed)
    size = 2 if len(body.inertia) == 1 else 3
    force = body.mass * random.uniform(-1.0, 1.0, (size, count))
    torque = tensor(body) @ random.uniform(-1.0, 1.0, (2 * size - 3, count))
    if size == 2:
        return Wrench(Vec2(*force), torque[0])
    return Wrench(Vec3(*force), Vec3(*torque))


def _silence(states: Any) -> Wrench:
    if isinstance(states.p, Vec2):
        return Wrench(Vec2(0.0, 0.0), 0.0)
    return Wrench(Vec3(0.0, 0.0, 0.0), Vec3(0.0, 0.0, 0.0))


def _angular_momentum(states: Any, body: Body) -> np.ndarray:
    """About the centre of mass, in W, (1 or 3, N)."""
    in_body = tensor(body) @ np.array(states.spin())
    if isinstance(states.attitude, Quat):
        return np.array(states.attitude.rotate(Vec3(*in_body)).columns())
    return in_body


def _largest_momentum(states: Any, body: Body) -> float:
    return float(np.max(np.linalg.norm(_angular_momentum(states, body), axis=0)))


def _rotation_energy(states: Any, body: Body) -> np.ndarray:
    """Half of w I w, (N,) J."""
    spin = np.array(states.spin())
    return 0.5 * np.sum(spin * (tensor(body) @ spin), axis=0)


def _energy(states: Any, body: Body) -> np.ndarray:
    """Kinetic energy, (N,) J."""
    return 0.5 * body.mass * states.v.dot(states.v) + _rotation_energy(states, body)


def _power(states: Any, applied: Wrench) -> np.ndarray:
    """Power of the wrench, (N,) W."""
    torque = (applied.torque,) if isinstance(states.p, Vec2) else leaves(applied.torque)
    turning = sum(t * w for t, w in zip(torque, states.spin(), strict=True))
    return states.attitude.rotate(applied.force).dot(states.v) + turning


def _distance(a: Any, b: Any) -> float:
    """Root of the summed squared differences of all fields."""
    return float(np.linalg.norm(np.array(leaves(a)) - np.array(leaves(b))))
