"""Predicted motion of a spacecraft whose forces, mass properties and delays are to be identified.

The equations of motion are the engine's (`rans.model.dynamics.advance`). Forces follow commands after a latency
and a linear rise, which is the command convolved with a box: integrals of the commands, which are piecewise
polynomials, give the thrust of any step under any delay. In a step thrust is the line that has the same impulse and
the same first moment, so that spin, velocity, and in the plane the heading are exact where steps end.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import PPoly

from rans.extend import (
    Body,
    ConfigError,
    Heading,
    PlanarState,
    Quat,
    Spacecraft,
    SpatialState,
    Vec2,
    Vec3,
    Wrench,
    advance,
    rotation_vector,
)
from rans.model.dynamics import thrust, wrench_of
from rans_robot.identify.log import FlightLog

Integrals = tuple[PPoly, PPoly]
"""Second and third integral of the shares of full force in a window, s^2 and s^3, over the time since its begin."""
_BRISK = 1e-3
"""s: a rise below it counts as one of so long with the same mean delay, since a mean over no time is rounding."""
_SLOWEST = 8.0
"""s before a window of which the commands are known to it; delays are at most 4.6 s (`fit._FARTHEST`)."""
_INSTANT = 1e-6
"""s: a step below it has the thrust of so long a one, since a mean over no time is rounding."""
_NODES = 3
"""Nodes of the quadrature in the plane: its error is 1e-9 of the thrust for steps of 0.1 rad."""


class Physics(NamedTuple):
    """Parameters of the motion, each a number, or a field of sets of them."""

    body: Body
    """Mass properties, and factors on the force of each thruster."""
    disturbance: Wrench
    """Constant force, N, and torque, N m, in W."""
    latency: Any
    """s from a command until the force begins to change."""
    rise: Any
    """s of the linear change of the force."""


def check_identifiable(craft: Spacecraft) -> None:
    """Refuse craft whose motion this module does not predict.

    Raises:
        ConfigError: the craft has no thruster, reaction wheels, burns propellant, has a mass that moves in it, or
            effectors of other kinds.
    """
    reasons = {
        "has no thruster": not craft.thrusters,
        "has reaction wheels": bool(craft.wheels),
        "burns propellant": craft.propellant is not None,
        "has a mass that moves in it": not craft.is_rigid,
        "has effectors of other kinds": bool(craft.further_effectors),
    }
    for reason, holds in reasons.items():
        if holds:
            raise ConfigError(
                f"{craft.name!r} {reason}, and only rigid spacecraft of constant mass that thrusters alone move "
                "can be identified from a log."
            )


def windows_of(log: FlightLog, length: float) -> list[slice]:
    """Slices of the readings into windows of about a length (s), each of which begins with a pose.

    A window ends before a gap longer than itself: readings after it, up to the next pose, are in none.
    """
    has_pose = ~np.isnan(log.position).any(axis=1)
    has_pose &= ~np.isnan(log.attitude.reshape(len(log.times), -1)).any(axis=1)
    edges = np.arange(log.times[0], log.times[-1], length)
    if len(edges) > 1 and log.times[-1] - edges[-1] < 0.5 * length:
        edges = edges[:-1]
    poses = np.flatnonzero(has_pose)
    firsts = np.searchsorted(log.times[poses], edges - 1e-9)
    starts = np.unique(poses[firsts[firsts < len(poses)]])
    gaps = np.flatnonzero(np.diff(log.times) > length) + 1
    # The next start or the next gap, whichever is first, or the end of the log.
    stops = np.unique([*starts, *gaps, len(log.times)])
    return [slice(int(a), int(stops[stops > a][0])) for a in starts]


def changes_of(craft: Spacecraft, log: FlightLog) -> tuple[np.ndarray, np.ndarray]:
    """Instants (E,), s, at which commands change the thrust, and the shares of full force (E, n) from each on.

    They have pulses and the supply's limit, and no delay.
    """
    times = []
    shares = []
    periods = np.diff(log.command_times, append=log.command_times[-1] + log.period)
    periods = np.minimum(periods, log.period)  # a pulse is a share of the control period
    for time, command, period in zip(log.command_times, log.commands, periods, strict=True):
        gone = 0.0
        for part, levels in craft.actuators.pulses(tuple(map(float, command))):
            if part <= 0.0:
                continue
            times.append(time + gone)
            shares.append([float(x) for x in thrust(craft, tuple(levels))])
            gone += float(part) * period
    return np.array(times), np.array(shares)


def integrals_of(changes: tuple[np.ndarray, np.ndarray], begin: float, end: float) -> Integrals:
    """Integrals of `changes_of` in a window from a begin to an end, s.

    Each window has its own, since numbers that grow with the time since the first command would lose digits.
    """
    times, shares = changes
    first = max(int(np.searchsorted(times, begin - _SLOWEST, side="right")) - 1, 0)
    last = int(np.searchsorted(times, end, side="right"))
    edges = np.append(times[first:last], end + _SLOWEST)
    steps = PPoly(shares[None, first:last], edges - begin)
    return steps.antiderivative(2), steps.antiderivative(3)


def impulses(windows: list[Integrals], times: np.ndarray, latency: Any, rise: Any) -> np.ndarray:
    """First and second integral, (2, ..., W, T, n), of the delayed shares up to times (W, T) of W windows.

    A share that rises linearly is the mean of the commanded one over the rise time before. Delays are numbers or
    (K, 1, 1).
    """
    ramp = np.maximum(rise, _BRISK)
    late = np.moveaxis(times - latency - 0.5 * (rise - ramp), -2, 0)
    before = np.moveaxis(times - latency - 0.5 * (rise + ramp), -2, 0)
    result = []
    for pair, now, then in zip(windows, late, before, strict=True):
        # Nothing acts before the first command.
        now, then = (np.maximum(x, pair[0].x[0]) for x in (now, then))
        result.append([integral(now) - integral(then) for integral in pair])
    return np.moveaxis(np.array(result), 0, -3) / np.asarray(ramp)[..., None]


def loads_of(
    craft: Spacecraft, physics: Physics, windows: list[Integrals], times: np.ndarray
) -> tuple[Wrench, ...]:
    """Wrenches in B at the start and the end of the steps between times (W, T), s.

    They are of the line of thrust with the same impulse and the same first moment.
    """
    first, second = impulses(windows, times, physics.latency, physics.rise)
    span = np.maximum(np.diff(times), _INSTANT)[..., None]
    mean = np.diff(first, axis=-2) / span
    rise = 6.0 * mean - 12.0 * (np.diff(second, axis=-2) - span * first[..., :-1, :]) / span**2
    gain = physics.body.gain
    lines = (np.moveaxis(mean + sign * rise, -1, 0) for sign in (-0.5, 0.5))
    return tuple(
        wrench_of(craft, [g * u for g, u in zip(gain, shares, strict=True)], physics.body)
        for shares in lines
    )


def advanced(physics: Physics, state: Any, loads: Any, span: Any) -> Any:
    """State after a step of a span (s), by the engine."""
    first, last = loads
    push = physics.disturbance
    return advance(state, first, physics.body, span, nodes=_NODES, disturbance=push, last=last)


def state_of(columns: np.ndarray) -> PlanarState | SpatialState:
    """State of fields (...) from columns (..., 6 or 13): p, heading or quaternion, v, w."""
    x = np.moveaxis(columns, -1, 0)
    if len(x) == 6:
        return PlanarState(Vec2(*x[:2]), Heading(x[2]), Vec2(*x[3:5]), x[5])
    return SpatialState(Vec3(*x[:3]), Quat(*x[3:7]), Vec3(*x[7:10]), Vec3(*x[10:]))


def difference(to: Any, origin: Any) -> np.ndarray:
    """State minus another, (..., 6 or 12), whose attitude is the shortest rotation; `around` is its inverse."""
    turn = rotation_vector(origin.attitude.to(to.attitude))
    spin = [a - b for a, b in zip(to.spin(), origin.spin(), strict=True)]
    parts = *(to.p - origin.p).columns(), *turn, *(to.v - origin.v).columns(), *spin
    return np.stack(np.broadcast_arrays(*parts), axis=-1)
