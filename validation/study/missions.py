"""Ranges that missions declare for their draws, and margins in states that are worked out by hand.

Both engines draw the same episodes and judge them by the same margins, so that neither finds an error in them. The
numbers here are those of the pages of docs/missions, written out once more.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from math import cos, pi, radians, sin, tan
from typing import Any

import numpy as np

from rans.model.dynamics import PlanarState, SpatialState
from rans.model.fields import Heading, Quat, Vec2, Vec3
from rans.scenario import draws
from rans.tasks import TASKS
from rans.tasks.observation_terms import Dimension
from rans.tasks.shapes import Ball
from validation.study.checks import Check

COUNT = 1024
"""Episodes that are drawn."""
_ENDS = 0.03
"""Share of a range within which 1,024 even draws come near both ends: all but one time in 1e13."""

Measure = Callable[[Any, Any], Any]
Range = tuple[float, float]


@dataclass(frozen=True)
class Declared:
    """What a mission says of its episodes."""

    draws: Mapping[str, tuple[Measure, Range]]
    """Numbers of starts and goals (arrays), each evenly drawn in a range or at least to both of its ends."""
    margins: tuple[tuple[Any, Any, Mapping[str, float]], ...]
    """State, goal without notes or with those that margins need, and the margins in it by name."""


@dataclass(frozen=True)
class _Zones:
    """Notes of a goal among zones, as avoid has them; that task is of a package."""

    zones: tuple[Ball, ...]
    """Zones in W."""


def _norm(vector: Any) -> Any:
    return np.sqrt(sum(x * x for x in vector.columns()))


def _dot(a: Any, b: Any) -> Any:
    return sum(x * y for x, y in zip(a.columns(), b.columns(), strict=True))


def _at(p: tuple[float, ...], v: tuple[float, ...] = (0.0, 0.0, 0.0)) -> Any:
    """An upright craft without spin; in the plane for two numbers."""
    if len(p) == 2:
        return PlanarState(Vec2(*p), Heading(0.0), Vec2(*v[:2]), 0.0)
    return SpatialState(Vec3(*p), Quat(1.0, 0.0, 0.0, 0.0), Vec3(*v), Vec3(0.0, 0.0, 0.0))


def _distance(start: Any, goal: Any) -> Any:
    return _norm(start.p - goal.p)


def _rest(start: Any, goal: Any) -> Any:
    return _norm(start.v)


def _inspect_speed(start: Any, goal: Any) -> Any:
    """Speed over 2 n r on an orbit of n = 0.001027 rad/s."""
    return _norm(start.v) / (2.0 * 0.001027 * _norm(start.p))


def _dock_speed(start: Any, goal: Any) -> Any:
    """Speed over its limit at the start."""
    return _norm(start.v) / (0.2 + 0.002054 * (_norm(start.p) - 0.5))


def _horizontal(start: Any) -> Any:
    return np.hypot(start.p.x, start.p.y)


def _away(start: Any, goal: Any) -> Any:
    return (start.p.x * start.v.x + start.p.y * start.v.y) / _horizontal(start)


def _across(start: Any, goal: Any) -> Any:
    return (start.p.x * start.v.y - start.p.y * start.v.x) / _horizontal(start)


def _crossing(start: Any, goal: Any) -> Any:
    """Least distance of every zone's centre from the line between start and goal within 12 s, m."""
    along = start.p - goal.p
    along = along.scale(1.0 / _norm(along))
    found = []
    for zone in goal.notes.zones:
        beside = zone.centre - goal.p
        beside = beside - along.scale(_dot(beside, along))
        when = np.clip(-_dot(beside, zone.v) / np.maximum(_dot(zone.v, zone.v), 1e-30), 0.0, 12.0)
        found.append(_norm(beside + zone.v.scale(when)))
    return np.concatenate(found)


_AVOID = {
    "radius of zones": (
        lambda _, goal: np.concatenate([z.radius for z in goal.notes.zones]),
        (0.3, 0.5),
    ),
    "speed of zones": (
        lambda _, goal: np.concatenate([_norm(z.v) for z in goal.notes.zones]),
        (0.0, 0.04),
    ),
    "offset of zones in the first 12 s": (_crossing, (0.0, 0.5)),
    "distance": (_distance, (2.2, 4.5)),
}
_DOCK_PORT = {
    "distance": (lambda start, _: _norm(start.p), (2.0, 4.0)),
    "speed": (_rest, (0.0, 0.0)),
    "rate of the port": (lambda _, goal: np.linalg.norm(goal.spin(), axis=0), (0.0, radians(3.0))),
    "distance of the docked position": (lambda _, goal: _norm(goal.p), (0.65, 0.65)),
}
_DEADLINE: Measure = lambda _, goal: goal.notes.deadline  # noqa: E731

MISSIONS: dict[tuple[str, Dimension], Declared] = {
    ("inspect", 3): Declared(
        {
            "distance": (_distance, (50.0, 100.0)),
            "speed over 2 n r": (_inspect_speed, (0.0, 0.8)),
            "angle of the sun": (lambda _, goal: goal.notes.sun, (-pi, pi)),
        },
        (
            (_at((25.0, 0.0, 0.0)), _at((0.0, 0.0, 0.0)), {"keep-out": 10.0, "zone": 775.0}),
            (_at((0.0, 0.0, -14.0)), _at((0.0, 0.0, 0.0)), {"keep-out": -1.0, "zone": 786.0}),
        ),
    ),
    ("land", 3): Declared(
        {
            "height": (lambda start, _: start.p.z, (1450.0, 1650.0)),
            "distance": (lambda start, _: _horizontal(start), (1900.0, 2100.0)),
            "speed away": (_away, (50.0, 80.0)),
            "speed across": (_across, (0.0, 30.0)),
            "speed downwards": (lambda start, _: -start.v.z, (65.0, 77.0)),
        },
        (
            # 101 m from the site, so 100 m from its edge, 10 m above the slope of 4 degrees.
            (
                _at((60.6, 80.8, 100.0 * tan(radians(4.0)) + 10.0)),
                _at((0.0, 0.0, 0.0)),
                {
                    "ground": 100.0 * tan(radians(4.0)) + 10.0,
                    "glide slope": 10.0 * cos(radians(4.0)),
                    "tilt": 1.0 - cos(radians(40.0)),
                },
            ),
        ),
    ),
    ("avoid", 2): Declared(
        _AVOID,
        (
            (
                _at((0.0, 0.0)),
                replace(
                    _at((0.0, 0.0)), notes=_Zones((Ball(Vec2(0.6, 0.8), Vec2(0.0, 0.0), 0.4),))
                ),
                {"zone 1": 0.6},
            ),
        ),
    ),
    ("avoid", 3): Declared(_AVOID, ()),
    ("dock-port", 2): Declared(
        _DOCK_PORT,
        # The docked position is 0.65 m from the target; the cone's apex is 0.5 m from the craft, on its axis.
        ((_at((-1.05, 0.0)), _at((-0.65, 0.0)), {"cone": 0.5 * 0.5, "target": 0.55}),),
    ),
    ("dock-port", 3): Declared(
        _DOCK_PORT,
        ((_at((-1.05, 0.0, 0.0)), _at((-0.65, 0.0, 0.0)), {"cone": 0.5 * 0.5, "target": 0.55}),),
    ),
    ("dock", 3): Declared(
        {
            "distance": (_distance, (100.0, 150.0)),
            "speed over its limit": (_dock_speed, (0.0, 0.8)),
            "deadline": (_DEADLINE, (600.0, 2000.0)),
        },
        (
            # The limit is 0.2 + 0.002054 * 100 m/s.
            (
                _at((0.0, 100.5, 0.0), (0.0, 0.0, 0.1)),
                _at((0.0, 0.0, 0.0)),
                {"speed": 0.3054},
            ),
        ),
    ),
    ("hold", 3): Declared(
        {
            "distance": (lambda start, _: _norm(start.p), (150.0, 300.0)),
            "speed": (_rest, (0.0, 0.0)),
            "place of the hold point": (lambda _, goal: goal.p.y, (-100.0, -100.0)),
        },
        ((_at((0.0, -30.0, 40.0)), _at((0.0, -100.0, 0.0)), {"keep-out": 0.0}),),
    ),
    ("final-approach", 3): Declared(
        {
            "distance along the axis": (
                lambda start, goal: _dot(start.p, goal.p) / 2.0,
                (60.0, 150.0),
            ),
            "speed": (_rest, (0.0, 0.0)),
            "rate of the port": (lambda _, goal: _norm(goal.w), (0.0, 0.0011068)),
            "distance of the port": (lambda _, goal: _norm(goal.p), (2.0, 2.0)),
        },
        # On the axis 18 m from the port, whose cone is 0.1 m wide there.
        (
            (
                _at((0.0, -20.0, 0.0), (0.0, 0.06, 0.08)),
                _at((0.0, -2.0, 0.0)),
                {
                    "cone": 18.0 * sin(radians(10.0)) + 0.1 * cos(radians(10.0)),
                    "target": 18.1,
                    "speed": 4.0 * 0.0011068 * 20.0,
                },
            ),
        ),
    ),
    ("rendezvous", 3): Declared(
        {
            "distance along the axis": (lambda start, _: -start.p.x, (400.0, 1000.0)),
            "tangent of the angle from the axis": (
                lambda start, _: np.hypot(start.p.y, start.p.z) / -start.p.x,
                (0.0, tan(radians(25.0))),
            ),
            "speed": (_rest, (0.0, 0.0)),
            "deadline": (_DEADLINE, (4000.0, 10000.0)),
        },
        # The apex is 1 m / sin 30 degrees behind the target: 52 m from the craft, which is 52 sin 30 from the cone.
        ((_at((-50.0, 0.0, 0.0)), _at((0.0, 0.0, 0.0)), {"cone": 26.0}),),
    ),
}
"""By name of the mission and dimension."""


def mission_checks(dimension: Dimension) -> Iterator[Check]:
    """Draws and margins of all missions of a dimension."""
    for (name, size), declared in MISSIONS.items():
        if size != dimension:
            continue
        task = TASKS[name]()
        own = draws(853, COUNT)
        start, goal = task.sample(own.random(size, own.first))
        for what, (measure, bounds) in declared.draws.items():
            yield Check(
                f"tasks: {name} draws {what}",
                _outside(np.asarray(measure(start, goal)), *bounds),
                1e-9,
                "of the range",
                "Within the declared range, to rounding, and up to 3 % of it from both ends.",
            )
        for state, aim, expected in declared.margins:
            found = task.constraints(state, aim)
            apart = [abs(float(found[margin]) - value) for margin, value in expected.items()]
            yield Check(
                f"tasks: margins of {name}",
                max(apart),
                1e-8,
                "m, m/s, -",
                "Worked out by hand: rounding, and 1e-12 m^2 under the roots of cones.",
            )


def _outside(values: np.ndarray, low: float, high: float) -> float:
    """How far draws leave their range, or stay away from its ends by more than `_ENDS`, as a share of it."""
    least, most = float(values.min()), float(values.max())
    span = high - low
    if span == 0.0:
        return max(abs(least - low), abs(most - high))
    beyond = max(low - least, most - high) / span
    missing = max(least - low, high - most) / span - _ENDS
    return max(beyond, missing, 0.0)
