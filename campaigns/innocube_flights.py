"""Manoeuvres of InnoCube from its telemetry, and simulated flights from the same starts to the same goals.

A manoeuvre begins with the first row of a goal in which wheels are commanded, and ends with the last. In the frame
of the goal the satellite should come to the identity, at rest. The law of its PD controller is that of arXiv
2512.19576, and commands in the telemetry obey it within 0.1 rpm/s.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from rans_robot.identify.log import FlightLog
from scipy.spatial.transform import Rotation

from rans.flight import Controller, fly
from rans.model.dynamics import SpatialState
from rans.model.fields import Quat, Vec3, leaves
from rans.model.spacecraft import Spacecraft
from rans.scenario import Scenario
from rans.tasks.go_to_attitude import GoToAttitude

SETTLED = np.deg2rad(1.0)
"""Attitude error within which a manoeuvre counts as settled, rad: the tolerance of the task."""
_FAR = np.deg2rad(20.0)
"""Least attitude error at the start of a manoeuvre, rad; less is a correction."""
_SHORTEST = 60.0
"""s: manoeuvres that ended sooner are left out."""
_REST = 20.0
"""s at the end of a manoeuvre over which the error at rest is taken."""
_RPM = 60.0 / (2.0 * np.pi)
"""Revolutions a minute of a rad/s."""
_FASTEST = 100.0
"""rpm/s: largest acceleration of a wheel that was commanded, which is command 1 of the spacecraft file."""


@dataclass(frozen=True)
class Manoeuvre:
    """Readings while one goal was flown to."""

    flown_by: str
    """Who flew it in orbit: "learned" or "PD"."""
    times: np.ndarray
    """(M,), s from the first reading; whole seconds."""
    attitude: np.ndarray
    """(M, 4), quaternion from body to the frame of the goal, scalar first."""
    rates: np.ndarray
    """(M, 3), rad/s, in the body."""
    speeds: np.ndarray
    """(M, 3), rad/s, of the wheels against the axes of the body."""

    @property
    def errors(self) -> np.ndarray:
        """(M,), attitude error, rad."""
        return _angles(self.attitude)


def manoeuvres_of(folder: Path, log: FlightLog) -> Iterator[Manoeuvre]:
    """Manoeuvres of a folder, one a goal; goals that the satellite had already or kept too briefly are left out."""
    assert log.wheel_speeds is not None
    commanded = np.abs(log.commands).max(axis=1) > 0.0
    goals = np.zeros(len(log.times), int) if log.frames is None else log.frames
    by_pd = folder.parent.name == "pd" or folder.name.startswith("pd-")
    for goal in range(goals[-1] + 1):
        rows = np.flatnonzero(commanded & (goals == goal))
        if not len(rows):
            continue
        part = slice(rows[0], rows[-1] + 1)
        manoeuvre = Manoeuvre(
            "PD" if by_pd else "learned",
            log.times[part] - log.times[rows[0]],
            log.attitude[part] / np.linalg.norm(log.attitude[part], axis=1, keepdims=True),
            log.spin[part],
            -log.wheel_speeds[part],
        )
        if manoeuvre.errors[0] > _FAR and manoeuvre.times[-1] >= _SHORTEST:
            yield manoeuvre


class InnoCubePD:
    """The law of InnoCube's PD controller, in its units: accelerations of wheels, rpm/s, of angle and rate."""

    name = "PD of InnoCube"
    stiffness = np.array([670.0, 670.0, 134.0])
    """rpm/s for the vector part of the error quaternion; about z a fifth."""
    damping = np.array([2500.0, 2500.0, 500.0])
    """rpm/s for a rad/s, times one plus the square of that vector part."""

    def reset(self, count: int) -> None:
        """Nothing is remembered."""

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """Commands (N, 3) of the wheels, -1 to 1."""
        error = goal.attitude.to(state.attitude)
        vector = np.array([error.x, error.y, error.z])
        vector = vector * np.where(np.asarray(error.w) < 0.0, -1.0, 1.0)
        rates = np.array([state.w.x, state.w.y, state.w.z])
        square = np.sum(vector**2, axis=0)
        wanted = -self.stiffness[:, None] * vector
        wanted = wanted - self.damping[:, None] * (1.0 + square) * rates
        # The satellite counts its wheels against the axes of the body.
        return np.clip(-wanted / _FASTEST, -1.0, 1.0).T


def simulated(
    craft: Spacecraft, manoeuvres: Sequence[Manoeuvre], controller: Controller
) -> list[Manoeuvre]:
    """What a controller makes of the manoeuvres, with exact readings of attitude and rates, at the same times."""
    q, w, s = (
        np.stack([getattr(one, name)[0] for one in manoeuvres], axis=1)
        for name in ("attitude", "rates", "speeds")
    )
    count = len(manoeuvres)
    # The momentum of a wheel is that of its speed and of the craft's turn about its axis.
    momenta = tuple(wheel.inertia * (w[k] - s[k]) for k, wheel in enumerate(craft.wheels))
    zero = np.zeros(count)
    start = SpatialState(Vec3(zero, zero, zero), Quat(*q), Vec3(zero, zero, zero), Vec3(*w))
    start = Scenario(replace(start, stores=momenta), _identity(count))
    steps = round(max(one.times[-1] for one in manoeuvres))
    timing = replace(GoToAttitude.timing, episode_steps=steps)
    flight = fly(craft, GoToAttitude(), controller, start, timing)
    states = flight.states
    path = np.stack(leaves(states.attitude), axis=-1)
    rates = np.stack(leaves(states.w), axis=-1)
    stored = np.stack(states.stores, axis=-1) / [wheel.inertia for wheel in craft.wheels]
    results = []
    for k, one in enumerate(manoeuvres):
        rows = np.round(one.times).astype(int)
        speeds = rates[rows, k] - stored[rows, k]
        results.append(Manoeuvre(controller.name, one.times, path[rows, k], rates[rows, k], speeds))
    return results


def figures(manoeuvres: Iterable[Manoeuvre]) -> dict[str, float]:
    """Medians over manoeuvres, and how many settled: within a degree from some reading to the last one.

    Returns:
        count, settled; time (s) until then, of those that settled; error at rest (degrees), the median of each over
        its last 20 s; travel of the three wheels (rpm), the sum of the changes of their speeds; and the speed of
        the fastest wheel (rpm).
    """
    manoeuvres = list(manoeuvres)
    outside = [np.flatnonzero(one.errors >= SETTLED) for one in manoeuvres]
    times = [
        one.times[rows[-1] + 1]
        for one, rows in zip(manoeuvres, outside, strict=True)
        if rows[-1] + 1 < len(one.times)
    ]
    rest = [np.median(one.errors[one.times > one.times[-1] - _REST]) for one in manoeuvres]
    travel = [_RPM * np.abs(np.diff(one.speeds, axis=0)).sum() for one in manoeuvres]
    fastest = [_RPM * np.abs(one.speeds).max() for one in manoeuvres]
    return {
        "count": len(manoeuvres),
        "settled": len(times),
        "time": float(np.median(times)) if times else np.nan,
        "rest": float(np.rad2deg(np.median(rest))),
        "travel": float(np.median(travel)),
        "fastest": float(np.median(fastest)),
    }


def apart(flown: Sequence[Manoeuvre], others: Sequence[Manoeuvre], seconds: float) -> list[float]:
    """Median angle between the attitudes of two flights of each manoeuvre in its first seconds, rad."""
    results = []
    for one, other in zip(flown, others, strict=True):
        early = one.times <= seconds
        a, b = (Rotation.from_quat(x.attitude[early], scalar_first=True) for x in (one, other))
        results.append(float(np.median((a.inv() * b).magnitude())))
    return results


def _angles(quaternion: np.ndarray) -> np.ndarray:
    """Angles of rotations (..., 4), rad."""
    return 2.0 * np.arctan2(
        np.linalg.norm(quaternion[..., 1:], axis=-1), np.abs(quaternion[..., 0])
    )


def _identity(count: int) -> SpatialState:
    zero, one = np.zeros(count), np.ones(count)
    vector = Vec3(zero, zero, zero)
    return SpatialState(vector, Quat(one, zero, zero, zero), vector, vector)
