"""Number of integration steps in a control period, chosen from the angular acceleration of the craft.

The error of a step depends on the angle turned in it and on the ratios of the moments of inertia, and grows
with the seventh power of the step's length (docs/decisions/engine.md). The spin of a
craft depends on its controller. For a controller that holds an attitude it is estimated from alpha (rad): the
largest angular acceleration of any command times the square of the control period.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import replace
from typing import Any

import numpy as np

from rans.base.errors import ConfigError, RansWarning
from rans.model.body import Body, numbers
from rans.model.dynamics import wrench_of
from rans.model.fields import leaves, map_leaves
from rans.model.pace import longest_sum
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing

MOST = 64
"""Largest number of substeps that is chosen; more would take minutes to compile into a kernel."""
_HARDEST = 2.0
"""Largest alpha of a craft that on/off control can stabilise, rad; from rest the craft turns by half of it in
one period."""
WILDEST = 500.0
"""Largest alpha that is accepted, rad. Under random commands an asymmetric craft in space lost its state within
a few periods from 870 rad on, and in the first period from 2,000 rad on."""
FARTHEST = 1e5
"""Largest accepted displacement from rest in one period, m: up to it float32 resolves positions to 1 cm."""
_PEAK = 3.0
"""Spin of a craft that cannot be held still, as a multiple of alpha per period. Among 200 random craft under
LQR, random and bang-bang control, 192 stay below it or below the spin of the
fastest half turn from rest to rest, sqrt(pi alpha); seven reach 1.5 times as much, and one, which tumbles, 3
times."""
_USUAL_SPIN = 1.0
"""Spin of starts and of tasks, rad/s: twice that of the paper."""
_STEP = {2: 2.0, 3: 1.0}
"""Largest angle turned in one step, rad, by dimension. In the plane the error of four nodes (float32) is then
1e-7; in space the error of a body with equal moments of inertia is 1e-6 rad."""
_SIX_NODES = 5.0
"""Angle at which the error of six nodes in the plane (float64) is 4e-8, rad."""
_UNEVEN = 1.5
"""Reduction of the angle by unequal moments of inertia: the error of a rod or a plate at 0.4 rad is that of a
sphere at 1 rad."""
_RESERVE = 4.0
"""Reduction of the angle by unequal moments of inertia in the choice of substeps: a tumbling rod amplifies its
errors and gets twice as many steps."""

_FLIGHT = 25.0
"""Duration of the flights for which the accuracy is specified, s."""
_UNSTABLE = 11.0
"""Threshold of t sqrt(tau / I) above which steps are shortened in proportion. A torque tau that is constant in
W makes a spacecraft a pendulum whose errors grow as exp(0.65 t sqrt(tau / I)). Where errors of a step grow
1,000 times (`roboran`, `lab`), 25 s of the free flyer are within 1e-5 rad; where they grow 10 million times
(`harsh`), within 1e-4 rad."""


def chosen(
    craft: Spacecraft, timing: Timing, body: Body | None = None, torque: float = 0.0
) -> Timing:
    """Timing with its number of substeps chosen where it is None.

    25 s of closed loop are then within 1e-4 m and 1e-4 rad, as `tests/effectors/test_pairs.py` measures on
    random craft. Warns if the craft is too fast for the control period.

    Args:
        craft: spacecraft.
        timing: control period, and substeps or None.
        body: randomized or failed body, numbers or arrays (N,); None: as designed.
        torque: largest steady disturbance torque in W, N m.

    Raises:
        ConfigError: one command moves or turns the craft too far in a period for its state to be represented.
    """
    period = timing.control_period
    alpha = _most_spin_up(craft, body) * period**2
    _check_range(craft, body, alpha, period)
    if timing.substeps is not None:
        return timing
    turn = max(_USUAL_SPIN * period, math.sqrt(math.pi * alpha), _PEAK * alpha)
    turn = max(turn, gyroscopic_rate(craft, body) * period)
    needed = turn / _longest(craft, body, _RESERVE)
    if craft.dimension == 3:
        least = float(np.linalg.eigvalsh(_tensors(body or Body.of(craft))).min())
        needed *= max(1.0, _FLIGHT * math.sqrt(torque / least) / _UNSTABLE)
    if alpha > _HARDEST:
        warnings.warn(
            f"spacecraft {craft.name!r}: one command turns it up to {alpha / 2:.3g} rad in a control period "
            f"of {period:g} s and leaves it spinning at {alpha / period:.3g} rad/s; above {_HARDEST / 2:g} "
            f"rad it can hardly be controlled, and {MOST} substeps may not be accurate enough. Shorten the "
            "period; the usual cause is a moment of inertia or a force in other units.",
            RansWarning,
            stacklevel=3,
        )
    return replace(timing, substeps=max(1, math.ceil(min(needed, MOST))))


def _check_range(craft: Spacecraft, body: Body | None, alpha: float, period: float) -> None:
    """Reject (`ConfigError`) a craft that moves too far in a period for any number of substeps."""
    designed = Body.of(craft)
    flown = body or designed
    gains_and_leaks = zip(flown.gain or designed.gain, flown.leak or designed.leak, strict=True)
    force = sum(
        thruster.force * (numbers(gain) + numbers(leak))
        for thruster, (gain, leak) in zip(craft.thrusters, gains_and_leaks, strict=True)
    )
    path = 0.5 * float(np.max(force / numbers(flown.mass))) / _lightest(craft, body) * period**2
    for size, limit, does, cause in (
        (path, FARTHEST, "moves it by {:.3g} m", "a mass"),
        (alpha / 2, WILDEST / 2, "turns it by {:.3g} rad", "a moment of inertia"),
    ):
        if size > limit:  # bodies that are not finite are rejected elsewhere
            raise ConfigError(
                f"spacecraft {craft.name!r}: one command {does.format(size)} in a control period of "
                f"{period:g} s; the limit is {limit:g}, beyond which its state loses precision. "
                f"Shorten the period; the usual cause is {cause} or a force in other units, or a task whose "
                "control period is for larger spacecraft."
            )


def fastest(craft: Spacecraft, timing: Timing, body: Body | None = None) -> float:
    """Largest spin at which flights in float64 are accurate, rad/s; above the spin that substeps are chosen for."""
    step = _SIX_NODES if craft.dimension == 2 else _longest(craft, body)
    return (chosen(craft, timing, body).substeps or 1) * step / timing.control_period


def _longest(craft: Spacecraft, body: Body | None, uneven: float = _UNEVEN) -> float:
    """Largest angle that may be turned in one step, rad."""
    if craft.dimension == 2:
        return _STEP[2]
    low, middle, high = np.moveaxis(np.linalg.eigvalsh(_tensors(body or Body.of(craft))), -1, 0)
    factors = (high - low) / middle, (high - middle) / low, (middle - low) / high
    return _STEP[3] / (1.0 + uneven * float(np.max(factors)))


def _lightest(craft: Spacecraft, body: Body | None) -> float:
    """Least mass with an empty tank over mass with a full tank of several bodies."""
    if craft.propellant is None or body is None:
        return craft.lightest
    return float(np.min(1.0 - craft.propellant.mass / numbers(body.mass)))


def gyroscopic_rate(craft: Spacecraft, body: Body | None = None) -> float:
    """Fastest nutation of a craft whose reaction wheels hold their largest momentum, rad/s; 0 in the plane."""
    if craft.dimension == 2 or not craft.wheels:
        return 0.0
    momentum = math.hypot(*(wheel.max_momentum for wheel in craft.wheels))
    light = body or Body.of(craft)
    if craft.propellant is not None:
        light = light.emptied(craft)
    return momentum / float(np.linalg.eigvalsh(_tensors(light)).min())


def _most_spin_up(craft: Spacecraft, body: Body | None) -> float:
    """Largest angular acceleration of any command with a full or an empty tank, rad/s^2."""
    if craft.propellant is None or craft.propellant.position is None:
        return spin_up(craft, body) / _lightest(craft, body)
    full = body or Body.of(craft)
    return max(spin_up(craft, full), spin_up(craft, full.emptied(craft)))


def spin_up(craft: Spacecraft, body: Body | None = None) -> float:
    """Largest angular acceleration of any command, rad/s^2; with several bodies, the largest among them."""
    fastest = _spin_up_by_thrusters_and_wheels(craft, body)
    torque = sum(effector.largest_torque for effector in craft.further_effectors)
    if not torque:
        return fastest
    return fastest + torque / float(np.linalg.eigvalsh(_tensors(body or Body.of(craft))).min())


def _spin_up_by_thrusters_and_wheels(craft: Spacecraft, body: Body | None) -> float:
    """Largest angular acceleration of their commands, rad/s^2; with several bodies, the largest among them.

    The number of substeps follows from it: another number of substeps changes recorded flights in their last bits.
    """
    accelerations = _ways(craft, body or Body.of(craft))
    directions = np.random.default_rng(0).normal(size=(64, 3))
    wheels = np.zeros((1, 0, accelerations.shape[-1]))
    if craft.wheels:
        wheels = _wheel_ways(craft, body or Body.of(craft))
    if craft.thrust_sharing != "none" and (body is None or body.droop is None):
        largest = float(np.linalg.norm(accelerations, axis=-1).max())
        return largest + float(np.linalg.norm(wheels, axis=-1).sum(axis=1).max())
    # Exact sums for the eight bodies that accelerate most in some of the sampled directions.
    if craft.wheels:
        either = np.concatenate([wheels, -wheels], axis=1)
        either = np.broadcast_to(either, (len(accelerations), *either.shape[1:]))
        accelerations = np.concatenate([accelerations, either], axis=1)
    directions = directions[:, : accelerations.shape[-1]]
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    projections = np.maximum(accelerations @ directions.T, 0.0).sum(axis=1).max(axis=-1)
    return max(longest_sum(accelerations[k]) for k in np.argsort(projections)[-8:])


def _ways(craft: Spacecraft, body: Body) -> np.ndarray:
    """Angular acceleration of every body by each fully open thruster, rad/s^2, (bodies, n, 1 or 3).

    About the true centre of mass; a leak counts as thrust.
    """
    tensors = np.atleast_3d(_tensors(body).T).T
    count = craft.thruster_count
    if not count:
        return np.zeros((len(tensors), 0, tensors.shape[-1]))
    own: Any = map_leaves(numbers, body)
    opened = [
        gain + leak
        for gain, leak in zip(own.gain or (1.0,) * count, own.leak or (0.0,) * count, strict=True)
    ]
    # One thruster at a time along the first axis, and bodies along the second.
    alone = [np.outer(row, opening) for row, opening in zip(np.eye(count), opened, strict=True)]
    applied = leaves(wrench_of(craft, alone, own))
    torques = np.stack(np.broadcast_arrays(*applied), axis=-1)[
        ..., craft.dimension : craft.degrees_of_freedom
    ]
    return np.linalg.solve(tensors[:, None], torques.swapaxes(0, 1)[..., None])[..., 0]


def _wheel_ways(craft: Spacecraft, body: Body) -> np.ndarray:
    """Angular acceleration of every body by the largest torque of each wheel, rad/s^2, (bodies, wheels, 1 or 3)."""
    tensors = np.atleast_3d(_tensors(body).T).T
    torques = np.array(craft.wheel_map).reshape(craft.wheel_count, tensors.shape[-1])
    return np.linalg.solve(tensors[:, None], torques[None, ..., None])[..., 0]


def _tensors(body: Body) -> np.ndarray:
    """Inertia tensors, kg m^2, (..., 3, 3); in the plane (..., 1, 1)."""
    entries = np.broadcast_arrays(*(numbers(x) for x in body.inertia))
    order = (0,) if len(entries) == 1 else (0, 1, 2, 1, 3, 4, 2, 4, 5)
    side = 1 if len(entries) == 1 else 3
    return np.stack([entries[k] for k in order], axis=-1).reshape(*entries[0].shape, side, side)
