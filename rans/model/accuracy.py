"""How many integration steps a control period takes, from what the craft's thrusters can do to its spin.

A step's error depends on the angle turned in it and on how uneven the moments of inertia are, and grows with
the seventh power of its length (docs/decisions/006-motion-in-space-by-series.md). How fast a craft ever turns
is up to who flies it; under any control that means to hold an attitude it follows from alpha, what its
fastest command adds to the spin in one period, times the period (rad).
"""

from __future__ import annotations

import math
import warnings
from dataclasses import replace

import numpy as np

from rans.errors import ConfigError
from rans.model.body import Body, numbers
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing

MOST = 64
"""Substeps that are ever chosen: more would take minutes to compile into a kernel."""
_HARDEST = 2.0
"""The largest alpha of a craft that can be flown, rad: from rest it turns by half of it in one period, about
as far as on/off control can still see what it does."""
WILDEST = 500.0
"""The largest alpha that is flown at all, rad: from 870 on an uneven craft in space lost its state
in a few periods of random commands, from 2,000 on in the first."""
FARTHEST = 1e5
"""Way from rest in one period, m, up to which float32 tells positions to a centimetre."""
_PEAK = 3.0
"""Spin of a craft that cannot be held still, in alphas. Of 200 random craft under LQR, restless and bang-bang
control (`validation.records.accuracy`) 192 stay below it or below the spin of the fastest half turn from rest to
rest, sqrt(pi alpha); seven reach up to 1.5 times as much and one, which tumbles, 3 times."""
_USUAL_SPIN = 1.0
"""Start, or are asked for by a task, rad/s: twice the paper's."""
_STEP = {2: 2.0, 3: 1.0}
"""Angle that may be turned in one step, rad. Plane: four nodes, as float32 has, are then 1e-7 off. Space:
a body with equal moments is 1e-6 rad off, one with others turns less."""
_SIX_NODES = 5.0
"""Angle at which the plane's six nodes, of float64, are 4e-8 off, rad."""
_UNEVEN = 1.5
"""How much less: the error of a rod or a plate at 0.4 rad is that of a ball at 1 rad."""
_RESERVE = 4.0
"""The same where steps are chosen: a tumbling rod multiplies its errors, so that it gets twice as many."""

_FLIGHT = 25.0
"""s, for which accuracy is promised."""
_UNSTABLE = 11.0
"""A torque tau that stays in W makes a spacecraft a pendulum whose errors grow as exp(0.65 t sqrt(tau / I)).
From this flight times sqrt(tau / I) on, steps are shorter in proportion: with 1,000 times a step's error
(`roboran`, `lab`) 25 s of the free flyer are within 1e-5 rad, with 10 million times (`harsh`) within 1e-4."""


def chosen(
    craft: Spacecraft, timing: Timing, body: Body | None = None, torque: float = 0.0
) -> Timing:
    """The timing with a number of substeps, where it leaves that open.

    25 s of closed loop are then within 1e-4 m and 1e-4 rad: `validation.records.accuracy` shows it on random craft.
    Warns of a craft that is too fast for its control period.

    Args:
        craft: what flies.
        timing: how.
        body: what is drawn or broken of it, numbers or arrays (N,); None: as designed.
        torque: the largest that stays in W, N m.

    Raises:
        ConfigError: one command moves or turns it so far in a period that its state would soon
            be lost.
    """
    period = timing.control_period
    alpha = spin_up(craft, body) / craft.lightest * period**2
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
            f"rad it can hardly be controlled, and {MOST} substeps may not do for its motion. Shorten the "
            "period; the usual cause is a moment of inertia or a force in other units.",
            stacklevel=3,
        )
    return replace(timing, substeps=max(1, math.ceil(min(needed, MOST))))


def _check_range(craft: Spacecraft, body: Body | None, alpha: float, period: float) -> None:
    """Refuse (`ConfigError`) a craft that numbers cannot follow, whatever the substeps."""
    designed = Body.of(craft)
    flown = body or designed
    shares = zip(flown.gain or designed.gain, flown.leak or designed.leak, strict=True)
    force = sum(
        thruster.force * (numbers(gain) + numbers(leak))
        for thruster, (gain, leak) in zip(craft.thrusters, shares, strict=True)
    )
    way = 0.5 * float(np.max(force / numbers(flown.mass))) / craft.lightest * period**2
    for size, most, does, cause in (
        (way, FARTHEST, "moves it by {:.3g} m", "a mass"),
        (alpha / 2, WILDEST / 2, "turns it by {:.3g} rad", "a moment of inertia"),
    ):
        if size > most:  # a body that is not finite is told elsewhere
            raise ConfigError(
                f"spacecraft {craft.name!r}: one command {does.format(size)} in a control period of "
                f"{period:g} s, and at most {most:g} are flown, beyond which its state would soon be "
                f"lost. Shorten the period; the usual cause is {cause} or a force in other units."
            )


def fastest(craft: Spacecraft, timing: Timing, body: Body | None = None) -> float:
    """The spin up to which flights in float64 are accurate, rad/s: above what substeps are chosen for."""
    step = _SIX_NODES if craft.dimension == 2 else _longest(craft, body)
    return (chosen(craft, timing, body).substeps or 1) * step / timing.control_period


def _longest(craft: Spacecraft, body: Body | None, uneven: float = _UNEVEN) -> float:
    """Angle that may be turned in one step, rad."""
    if craft.dimension == 2:
        return _STEP[2]
    low, middle, high = np.moveaxis(np.linalg.eigvalsh(_tensors(body or Body.of(craft))), -1, 0)
    factors = (high - low) / middle, (high - middle) / low, (middle - low) / high
    return _STEP[3] / (1.0 + uneven * float(np.max(factors)))


def gyroscopic_rate(craft: Spacecraft, body: Body | None = None) -> float:
    """The fastest nutation of a craft whose reaction wheels hold all that they can, rad/s; 0 in the plane."""
    if craft.dimension == 2 or not craft.wheels:
        return 0.0
    momentum = math.hypot(*(wheel.max_momentum for wheel in craft.wheels))
    least = float(np.linalg.eigvalsh(_tensors(body or Body.of(craft))).min())
    return momentum / (least * craft.lightest)


def spin_up(craft: Spacecraft, body: Body | None = None) -> float:
    """The largest angular acceleration of any command, rad/s^2; of several bodies that of the quickest."""
    if craft.further_effectors:
        torque = sum(one.largest_torque for one in craft.further_effectors)
        least = float(np.linalg.eigvalsh(_tensors(body or Body.of(craft))).min())
        return spin_up(replace(craft, further_effectors=()), body) + torque / least
    ways = _ways(craft, body or Body.of(craft))
    directions = np.random.default_rng(0).normal(size=(64, 3))
    wheels = np.zeros((1, 0, ways.shape[-1]))
    if craft.wheels:
        wheels = _wheel_ways(craft, body or Body.of(craft))
    if craft.thrust_sharing != "none" and (body is None or body.droop is None):
        most = float(np.linalg.norm(ways, axis=-1).max())
        return most + float(np.linalg.norm(wheels, axis=-1).sum(axis=1).max())
    # Exactly for those few that are the quickest in some of many directions.
    if craft.wheels:
        either = np.concatenate([wheels, -wheels], axis=1)
        either = np.broadcast_to(either, (len(ways), *either.shape[1:]))
        ways = np.concatenate([ways, either], axis=1)
    directions = directions[:, : ways.shape[-1]]
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    seen = np.maximum(ways @ directions.T, 0.0).sum(axis=1).max(axis=-1)
    return max(_longest_sum(ways[k]) for k in np.argsort(seen)[-8:])


def _ways(craft: Spacecraft, body: Body) -> np.ndarray:
    """Angular acceleration of every body by each thruster, as far as it can open, (bodies, n, 1 or 3)."""
    table = np.array(craft.wrench_map)
    size = craft.dimension
    count = len(table)
    opened = [
        numbers(gain) + numbers(leak)
        for gain, leak in zip(body.gain or (1.0,) * count, body.leak or (0.0,) * count, strict=True)
    ]
    shares = np.atleast_2d(np.stack(np.broadcast_arrays(*opened), axis=-1))
    offset = map(numbers, body.centre or (0.0,) * size)
    centre = np.atleast_2d(np.stack(np.broadcast_arrays(*offset), axis=-1))[:, None]
    force = table[:, :size]
    tensors = np.atleast_3d(_tensors(body).T).T
    moved = (
        np.cross(centre, force)
        if size == 3
        else (centre[..., :1] * force[:, 1:] - centre[..., 1:] * force[:, :1])
    )
    torques = (table[:, size:] - moved) * shares[..., None]
    return np.linalg.solve(tensors[:, None], torques[..., None])[..., 0]


def _wheel_ways(craft: Spacecraft, body: Body) -> np.ndarray:
    """Angular acceleration of every body by each wheel's largest torque, (bodies, wheels, 1 or 3)."""
    tensors = np.atleast_3d(_tensors(body).T).T
    torques = np.array(craft.wheel_map).reshape(len(craft.wheels), tensors.shape[-1])
    return np.linalg.solve(tensors[:, None], torques[None, ..., None])[..., 0]


def _longest_sum(vectors: np.ndarray) -> float:
    """Length of the longest sum of some of these vectors (n, d): each sum of those that point its way.

    Repeating that makes a sum longer until none joins or leaves; begun with the sums and differences of all
    pairs, and in directions that are normal to none.
    """
    size = vectors.shape[1]
    pairs = np.concatenate([vectors[:, None] + vectors, vectors[:, None] - vectors]).reshape(
        -1, size
    )
    sums = np.concatenate([pairs, np.random.default_rng(0).normal(size=(64, size))])
    for _ in range(8):
        sums = (sums @ vectors.T > 0.0) @ vectors
    return float(np.linalg.norm(sums, axis=1).max())


def _tensors(body: Body) -> np.ndarray:
    """Inertia, (..., 3, 3), in the plane (..., 1, 1)."""
    entries = np.broadcast_arrays(*(numbers(x) for x in body.inertia))
    order = (0,) if len(entries) == 1 else (0, 1, 2, 1, 3, 4, 2, 4, 5)
    side = 1 if len(entries) == 1 else 3
    return np.stack([entries[k] for k in order], axis=-1).reshape(*entries[0].shape, side, side)
