"""Least time, impulse and energy beside published optima: ``python -m campaigns published-optima``.

Turns, a straight way and an ascent, whose optima are in the literature or follow from it in closed form. Nothing of
RANS is in the second column.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from rans_optimal.objectives import MinimumEnergy, MinimumFuel, MinimumTime, Objective
from rans_optimal.transcription import Trajectory, Transcription, usual_guesses
from scipy.optimize import fsolve

from rans.model.drift import Drift, UniformGravity
from rans.model.dynamics import PlanarState, SpatialState
from rans.model.fields import Heading, Quat, Vec2, Vec3
from rans.model.spacecraft import Spacecraft, Thruster
from rans.tasks import GoToPose, GoToPosition, Task

_MASS = 12.0
_FORCE = 1.0
_WAY = 1.0
_HORIZON = 10.0
"""Of the straight way: kg, N, m, s."""
_MOON = 5.32 / 20.8
"""Gravity over the acceleration of the thrust (Hull's ft/s^2)."""
_HEIGHT = 50_000.0 * 20.8 / 5444.0**2
"""Of the orbit, over its squared speed over the acceleration of the thrust (feet and seconds)."""
_UNIT = 5444.0 / 20.8
"""Speed of the orbit over the acceleration of the thrust, s."""
_DIRECTIONS = 64
"""Thrusters around the craft of the ascent: in between, their thrust is 0.1 % less."""


class Published(NamedTuple):
    """A problem whose optimum others computed."""

    name: str
    source: str
    optimum: float
    unit: str
    craft: Spacecraft
    objective: Objective
    start: Any
    goal: Any
    task: Task = GoToPose()
    scale: float = 1.0
    """Of the cost."""

    def solved(self, guesses: int | None = None) -> tuple[float, Trajectory]:
        """The optimum of RANS, in the same unit, and its trajectory; guesses as by default."""
        tried = usual_guesses(self.craft, self.task, self.objective) if guesses is None else guesses
        found = Transcription(self.craft, self.task, self.objective).solve(
            self.start, self.goal, tried
        )
        return found.cost * self.scale, found


@dataclass(frozen=True)
class _Ascent(GoToPosition):
    """Go to a position at a velocity, under the gravity of the Moon."""

    @property
    def drift(self) -> Drift:
        """The Moon's gravity, in units of the thrust's acceleration."""
        return UniformGravity((0.0, -_MOON))


def turning(inertia: Sequence[float], torque: float) -> Spacecraft:
    """A craft in space that turns by couples of thrusters about each of its principal axes, by up to a torque."""
    axes = np.eye(3)
    thrusters = []
    for k, axis in enumerate(axes):
        arm = axes[(k + 1) % 3]
        push = np.cross(axis, arm)
        for sign in (1.0, -1.0):
            for side in (1.0, -1.0):
                position: Any = tuple((side * arm).tolist())
                direction: Any = tuple((side * sign * push).tolist())
                thrusters.append(Thruster(position, direction, torque / 2.0))
    moments: Any = tuple(tuple(row) for row in np.diag(inertia).astype(float).tolist())
    return Spacecraft("turning", 3, float(max(inertia)), moments, tuple(thrusters))


def pushing(mass: float, force: float, directions: int, sharing: Any = "none") -> Spacecraft:
    """A craft in the plane whose thrusters push it in so many directions and do not turn it."""
    angles = 2.0 * math.pi * np.arange(directions) / directions
    thrusters = tuple(
        Thruster((0.0, 0.0, 0.0), (math.cos(a), math.sin(a), 0.0), force) for a in angles.tolist()
    )
    unit = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    return Spacecraft("pushing", 2, mass, unit, thrusters, thrust_sharing=sharing)


def ascent() -> tuple[float, float]:
    """Least time to an orbit over a flat moon, and the way along the ground until then, from the closed form.

    The tangent of the thrust's elevation falls linearly in time (law of linear tangents). Its first and its last
    value follow from the height and the level flight at the end, and the time from the speed. Units: the orbit's
    speed, that over the thrust's acceleration, and their product.
    """

    def missed(tangents: np.ndarray) -> tuple[float, float]:
        _, climb, height, _ = _flown(*tangents.tolist())
        return climb, height - _HEIGHT

    tangents: Any = fsolve(missed, (0.5, 0.0), xtol=1e-12)
    time, _, _, way = _flown(*tangents.tolist())
    return time, way


def _flown(first: float, last: float) -> tuple[float, float, float, float]:
    """Time, climb, height and way when the speed along the ground is 1; tangents of the thrust's elevation."""
    # Integrals over time of cosine and sine are those over the tangent s, which falls at this rate.
    rate = math.asinh(first) - math.asinh(last)
    time = (first - last) / rate
    climb = (math.sqrt(1.0 + first**2) - math.sqrt(1.0 + last**2)) / rate - _MOON * time
    # Twice integrated: what is gained at an instant has flown until the end. By quadrature, far finer than needed.
    nodes, weights = np.polynomial.legendre.leggauss(60)
    s = 0.5 * (first + last) + 0.5 * (first - last) * nodes
    flown = 0.5 * (first - last) / rate * weights * (s - last) / rate / np.sqrt(1.0 + s**2)
    return time, climb, float(flown @ s) - 0.5 * _MOON * time**2, float(flown.sum())


def _about(axis: int, degrees: float) -> SpatialState:
    half = math.radians(degrees) / 2.0
    vector = [0.0, 0.0, 0.0]
    vector[axis] = math.sin(half)
    rest = Vec3(0.0, 0.0, 0.0)
    return SpatialState(rest, Quat(math.cos(half), *vector), rest, rest)


def _at(x: float, y: float = 0.0, along: float = 0.0) -> PlanarState:
    return PlanarState(Vec2(x, y), Heading(0.0), Vec2(along, 0.0), 0.0)


def problems() -> list[Published]:
    """All of them."""
    pusher = pushing(_MASS, _FORCE, 4)
    # Burns of a time t at both ends: F t (T - t) = m d.
    burn = 0.5 * (_HORIZON - math.sqrt(_HORIZON**2 - 4.0 * _MASS * _WAY / _FORCE))
    way = _at(-_WAY), _at(0.0)
    time, along = ascent()
    return [
        Published(
            "turn of 180 degrees, equal moments of inertia",
            "Bilimoria and Wie, JGCD 16(3), 1993",
            3.2431 * math.sqrt(100.0),
            "s",
            turning((100.0, 100.0, 100.0), 1.0),
            MinimumTime(40),
            _about(2, 0.0),
            _about(2, 180.0),
        ),
        Published(
            "turn of 150 degrees, asymmetric body",
            "Betts, Practical Methods for Optimal Control, SIAM, 2010",
            28.6304,
            "s",
            turning((5621.0, 4547.0, 2364.0), 50.0),
            MinimumTime(50),
            _about(0, 0.0),
            _about(0, 150.0),
        ),
        Published(
            "ascent over a flat moon",
            "Hull, Optimal Control Theory for Aerospace Applications, 2003",
            time * _UNIT,
            "s",
            pushing(1.0, 1.0, _DIRECTIONS, "split"),
            MinimumTime(60),
            _at(0.0),
            _at(along, _HEIGHT, 1.0),
            _Ascent(),
            _UNIT,
        ),
        Published(
            "straight way: least time",
            "2 sqrt(m d / F)",
            2.0 * math.sqrt(_MASS * _WAY / _FORCE),
            "s",
            pusher,
            MinimumTime(40),
            *way,
            GoToPosition(),
        ),
        Published(
            "straight way in 10 s: least impulse",
            "burns of t at both ends, F t (T - t) = m d",
            2.0 * burn * _FORCE,
            "N s",
            pusher,
            MinimumFuel(_HORIZON, 0.05),
            *way,
            GoToPosition(),
        ),
        Published(
            "straight way in 10 s: least energy",
            "12 (m d)^2 / T^3",
            12.0 * (_MASS * _WAY) ** 2 / _HORIZON**3,
            "N^2 s",
            pusher,
            MinimumEnergy(_HORIZON, 0.1),
            *way,
            GoToPosition(),
        ),
    ]


@dataclass(frozen=True)
class PublishedOptima:
    """Solve problems whose optima are in the literature."""

    def measured(self) -> Iterator[dict[str, Any]]:
        """A published optimum and what RANS finds, of every problem."""
        for one in problems():
            cost, path = one.solved()
            yield {
                "problem": one.name,
                "unit": one.unit,
                "published": one.optimum,
                "cost": cost,
                # Guesses that led to this cost, all guesses, and different costs that they led to.
                "agreeing": path.agreeing,
                "guesses": path.attempts,
                "optima": path.optima,
                "source": one.source,
            }


def difference(row: Any) -> str:
    """Cell of how much more RANS needs than published, %."""
    return f"{100.0 * (row['cost'] / row['published'] - 1.0):.2f}"
