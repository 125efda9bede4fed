"""NASA's JEOD: craft on orbits under torques, forces and the gradient of gravity.

JEOD integrates a craft in axes that do not turn, in steps of 1/32 s. RANS flies it in the Hill frame of a target
that moves on the same orbit without the craft's forces: an `EllipticOrbit`, whose positions are read along its arc.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from rans.extend import (
    Body,
    Drift,
    Quat,
    SpatialState,
    Vec3,
    Wrench,
    advance,
    read_text,
    read_toml,
    structure,
)
from rans_missions.orbits.elliptic import EllipticOrbit, eccentric_anomaly
from validation.judges.arc import from_arc
from validation.judges.judge import Judge, Largest, Row
from validation.study.checks import Check

Motion = tuple[tuple[float, float, float], tuple[float, float, float]]
"""Position and velocity."""
Turning = tuple[tuple[float, float, float], tuple[float, float, float, float]]
"""Spin and attitude."""

MU = 3.986004415e14
"""Gravitational parameter of these runs, m^3/s^2."""

JEOD = Judge(
    "NASA JEOD",
    "nasa/jeod, verif/SIM_dyncomp",
    "6550cf4edbfc556c5765508b238a226eebab4a78",
    "It integrates Newton's and Euler's equations in axes that do not turn, in steps of 1/32 s, and has neither a "
    "Hill frame nor a closed form.",
)
_ATTITUDE = Check("attitude", 0.0, 1e-8, "degrees", "Sixteen digits of 33 rad in eight hours.")
_SPIN = Check("spin", 0.0, 1e-12, "degrees/s", "Sixteen digits, and eight hours of steps.")
_ORBIT = Check(
    "position", 0.0, 1e-4, "m", "JEOD's own steps: an independent integration is 6e-5 m off."
)
_DRIFT = Check(
    "position",
    0.0,
    0.02,
    "m",
    "Equations of the first order, along the arc: (2 km)^3 / r^2 is 2e-4 m an orbit.",
)
STEP = 20.0
"""Step of our flights, s, of which 1,000 s and the logs' 60 s are multiples: halves of it change 1e-11 degrees."""
GRADIENT_STEP = 12.0
"""Step under the gradient of gravity, which changes by a line in a step: halves change 3e-10 degrees."""

CRAFT = {
    "sphere": Body(1.0, (0.4, 0.0, 0.0, 0.4, 0.0, 0.4)),
    "cylinder": Body(1e3, (500.0, 0.0, 0.0, 12250.0, 0.0, 12250.0)),
    "station": Body(4e5, (1.02e8, -6.96e6, -5.48e6, 0.91e8, 5.90e5, 1.64e8)),
}
"""Mass, kg, and the six moments of inertia, kg m^2."""


@dataclass(frozen=True)
class Run:
    """What acts in a run, and its figures."""

    about: str
    craft: str
    """A name in `CRAFT`."""
    motion: Mapping[int, Motion]
    """Positions and velocities by time, s; the one at 0 is the start."""
    turning: Mapping[int, Turning]
    """Spins and attitudes by time; the one at 0 is the start. Empty: rotation is not judged."""
    force: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Force in body axes in the burn, N."""
    torque: float = 0.0
    """Torque about body x in the burn, N m."""
    burn: tuple[float, float] = (1000.0, 2000.0)
    """Times at which force and torque begin and end, s."""
    gradient: bool = False
    """Whether the gradient of gravity turns the craft."""
    spread: str = "not published"


def _runs() -> dict[str, Run]:
    """The runs of jeod.toml by their names."""
    table = read_toml(read_text(Path(__file__).with_suffix(".toml")))

    def figures(kind: str, name: str) -> dict[int, Any]:
        return {int(time): row for time, row in table[kind].get(name, {}).items()}

    return {
        name: structure(
            run
            | {
                "motion": figures("motion", run["motion"]),
                "turning": figures("turning", run.get("turning", "")),
            },
            Run,
            name,
        )
        for name, run in table["run"].items()
    }


RUNS = _runs()
"""The runs that RANS flies, by their names in JEOD."""


class Orbit:
    """Kepler's orbit through a start in axes that do not turn, with the drift of RANS near a target on it.

    Args:
        start: position, m, and velocity, m/s.
        mu: gravitational parameter, m^3/s^2.
    """

    def __init__(self, start: Motion, mu: float = MU) -> None:
        r, u = np.array(start[0], float), np.array(start[1], float)
        radius = float(np.linalg.norm(r))
        self.size = float(1.0 / (2.0 / radius - u @ u / mu))
        """Semi-major axis, m."""
        along = 1.0 - radius / self.size, r @ u / math.sqrt(mu * self.size)
        e = math.hypot(*along)
        anomaly = math.atan2(along[1], along[0]) - along[1]
        self.drift = EllipticOrbit(math.sqrt(mu / self.size**3), e, anomaly)
        momentum = np.cross(r, u)
        out, across = r / radius, momentum / np.linalg.norm(momentum)
        self._axes = Rotation.from_matrix(np.stack([out, np.cross(across, out), across], axis=1))

    def axes(self, time: float) -> Rotation:
        """Rotation from the Hill frame at a time, s, to axes that do not turn."""
        return self._axes * _rotation(self.drift.turn(time))

    def rate(self, time: float) -> np.ndarray:
        """Angular velocity of the Hill frame in its own axes, (3,) rad/s."""
        return np.array(self.drift.later(time).rate().columns())

    def radius(self, time: float) -> tuple[float, float]:
        """Distance of the target, m, and its rate, m/s."""
        e = self.drift.eccentricity
        angle = float(eccentric_anomaly(self.drift.later(time).angle, e))
        radius = 1.0 - e * math.cos(angle)
        rate = self.drift.mean_motion * e * math.sin(angle) / radius
        return self.size * radius, self.size * rate

    def inertial(self, state: SpatialState, time: float) -> np.ndarray:
        """Position, (3,) m, of a craft in axes that do not turn; relative positions are read along the arc."""
        radius, climb = self.radius(time)
        p, _ = from_arc(state.p, state.v, radius, climb)
        return self.axes(time).apply(np.array([radius, 0.0, 0.0]) + np.array(p.columns()))


def flown(run: Run) -> Iterator[tuple[int, SpatialState, Orbit]]:
    """The time, s, of every figure of a run, the state near its target then, and the target's orbit."""
    body = CRAFT[run.craft]
    step = GRADIENT_STEP if run.gradient else STEP
    orbit = Orbit(run.motion[0])
    spin, logged = run.turning.get(0, ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)))
    state = _at_target(orbit, body_to_inertial(logged), np.array(spin, float))
    drift: Drift = replace(orbit.drift, gravity_gradient=run.gradient)
    zero = Vec3(0.0, 0.0, 0.0)
    now = 0.0
    for time in sorted(time for time in {*run.motion, *run.turning} if time > 0):
        while now < time - 1e-9:
            wrench = Wrench(zero, zero)
            if run.burn[0] <= now < run.burn[1]:
                wrench = Wrench(Vec3(*run.force), Vec3(run.torque, 0.0, 0.0))
            # Force and figures begin and end with a step.
            length = min(step, *(one - now for one in (time, *run.burn) if one > now))
            state = advance(state, wrench, body, length, drift=drift).normalised()
            drift = drift.later(length)
            now += length
        yield time, state, orbit


def _at_target(orbit: Orbit, attitude: Rotation, spin: np.ndarray) -> SpatialState:
    """State of a craft where the target is at its start, with an attitude to axes that do not turn and a spin."""
    zero = Vec3(0.0, 0.0, 0.0)
    turned = orbit.axes(0.0).inv() * attitude
    relative = spin - turned.inv().apply(orbit.rate(0.0))
    x, y, z, w = map(float, turned.as_quat())
    return SpatialState(zero, Quat(w, x, y, z), zero, Vec3(*map(float, relative)))


def differences(run: Run) -> Largest:
    """Largest differences of a run from JEOD.

    They are a component of position, m, the angle of attitude, degrees, and a component of spin, degrees/s.
    """
    largest = Largest()
    for time, state, orbit in flown(run):
        if time in run.motion:
            off = np.abs(orbit.inertial(state, time) - run.motion[time][0])
            largest.add("position", float(off.max()))
        if time in run.turning:
            spin, logged = run.turning[time]
            attitude = _rotation(state.attitude)
            own = np.array(state.w.columns()) + attitude.inv().apply(orbit.rate(time))
            turned = (orbit.axes(time) * attitude).inv() * body_to_inertial(logged)
            largest.add("attitude", math.degrees(turned.magnitude()))
            largest.add("spin", math.degrees(float(np.abs(own - spin).max())))
    return largest


def body_to_inertial(logged: tuple[float, ...]) -> Rotation:
    """Rotation of a logged quaternion: JEOD's turns the other way, and its scalar comes first."""
    s, x, y, z = logged
    return Rotation.from_quat([-x, -y, -z, s])


def rows(runs: Mapping[str, Run] = RUNS) -> Iterator[Row]:
    """A row for each run, by its name."""
    for name, run in runs.items():
        position = _DRIFT if any(run.force) else _ORBIT
        bounds = {"position": position, "attitude": _ATTITUDE, "spin": _SPIN}
        found = differences(run).values.items()
        checks = tuple(replace(bounds[quantity], value=value) for quantity, value in found)
        file = f"RUN_{name}/log_state_ASCII.csv"
        yield Row(JEOD, f"JEOD {name}", run.about, file, checks, run.spread)


def _rotation(q: Quat) -> Rotation:
    return Rotation.from_quat([q.x, q.y, q.z, q.w])
