"""NASA's JEOD: relative positions along the arc of a reference body."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from rans.model.fields import Vec3
from validation.judges.arc import along_arc
from validation.judges.judge import Judge, Largest, Row
from validation.study.checks import Check

_ROOT = math.sqrt(0.5)
A = ((10.0, 0.0, 0.0), (0.0, 1.0, 0.0))
B = ((0.0, 10.0, 0.0), (-_ROOT, 0.0, _ROOT))
"""Position, m, and velocity, m/s, of both bodies at the start in axes that do not turn; nothing acts on them."""
FIGURES = {
    (0.0, "B in A"): (
        (15.70796326794897, 0.0, 0.0),
        (-0.2928932188134524, -0.7071067811865476, 0.0),
    ),
    (0.0, "A in B"): (
        (-15.70796326794897, -7.071067811865476, 2.928932188134524),
        (0.2928932188134524, 0.0, 0.0),
    ),
    (1.0, "B in A"): (
        (15.49410282104554, -0.7071067811865476, 0.02490679323917888),
        (-0.187763892618183, -0.7071067811865476, -0.04698275670390611),
    ),
}
"""Curvilinear position, m, and velocity, m/s, at times, s, in JEOD's axes: forwards, against the angular momentum,
down."""
LVLH = Judge(
    "NASA JEOD",
    "nasa/jeod, models/dynamics/derived_state/verif/SIM_LvlhRelative",
    "6550cf4edbfc556c5765508b238a226eebab4a78",
    "It computes them from angles and inertial vectors of two bodies that fly straight on, at distances as "
    "large as the radius.",
)


def ours(reference: np.ndarray, other: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Curvilinear position and velocity of a body relative to a reference, each (2, 3) in axes that do not turn.

    JEOD's velocity is that in the reference's turning frame, along the axes at the body: rates of our coordinates
    along the arc less what the reference's own climb adds.
    """
    r, v = reference
    momentum = np.cross(r, v)
    radius = float(np.linalg.norm(r))
    out, across = r / radius, momentum / np.linalg.norm(momentum)
    axes = np.stack([out, np.cross(across, out), across])
    p = axes @ (other[0] - r)
    u = axes @ (other[1] - v - np.cross(momentum / radius**2, other[0] - r))
    climb = float(v @ out)
    where, rate = along_arc(Vec3(*p), Vec3(*u), radius, climb)
    angle = where.y / radius
    forwards = (radius + where.x) * (rate.y - climb * angle) / radius + climb * math.sin(angle)
    upwards = rate.x + climb * (1.0 - math.cos(angle))
    return np.array([where.y, -where.z, -where.x]), np.array([forwards, -rate.z, -upwards])


def rows() -> Iterator[Row]:
    """One row."""
    largest = Largest()
    for (time, pair), (position, velocity) in FIGURES.items():
        a, b = (np.array([np.array(r) + time * np.array(v), v]) for r, v in (A, B))
        own = ours(a, b) if pair == "B in A" else ours(b, a)
        largest.add("position", float(np.abs(own[0] - position).max()))
        largest.add("velocity", float(np.abs(own[1] - velocity).max()))
    units = {"position": "m", "velocity": "m/s"}
    checks = tuple(
        Check(name, value, 1e-13, units[name], "Sixteen digits of 16 m.")
        for name, value in largest.values.items()
    )
    yield Row(
        LVLH,
        "JEOD LVLH",
        "positions along the arc, a quarter of a turn apart",
        "RUN_test0/log_RelState.csv",
        checks,
        "not published",
    )
