"""Missions near a target in orbit, flown in true two-body gravity instead of Clohessy-Wiltshire's equations.

Drake moves craft by the same linear equations as RANS there. Here mission guidance flies in the gravity of a
point mass (`rans_missions.two_body`), of which the linear equations are the first term.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from rans.extend import TASKS, ClohessyWiltshire, Spacecraft, fly, impulses, scenarios
from rans_missions.control.mission_guidance import MissionGuidance
from rans_missions.orbits.elliptic import EllipticOrbit
from rans_missions.tasks import Dock, TargetOrbit
from rans_missions.tasks.orbital import OrbitalMission
from rans_missions.two_body import TwoBodyMover
from validation.study.checks import Check
from validation.study.study import Scope

_COUNT = 4
"""Starts of each mission."""
_ELLIPSE = TargetOrbit(eccentricity=0.5, semi_major_axis_km=13_556.0)
"""Orbit with its perigee at an altitude of 400 km; flights begin anywhere on it."""


def layer(scope: Scope) -> Iterator[Check]:
    """The layer "orbits" of ``rans validate``; see `orbit_checks`."""
    return orbit_checks(scope.craft, scope.seed)


def orbit_checks(craft: Spacecraft, seed: int) -> Iterator[Check]:
    """Successes, violations and impulse of the orbital missions that are made for this craft; others have none."""
    missions: dict[str, Any] = {name: TASKS[name]() for name in TASKS}
    missions["dock on an ellipse"] = Dock(orbit=_ELLIPSE)
    for name, task in missions.items():
        drift = task.drift
        if not isinstance(task, OrbitalMission) or task.spacecraft != craft.name:
            continue
        assert isinstance(drift, ClohessyWiltshire | EllipticOrbit)
        task = task.for_evaluation()
        starts = scenarios(task, craft, seed, _COUNT)
        eccentricity = drift.eccentricity if isinstance(drift, EllipticOrbit) else 0.0
        mover = TwoBodyMover(craft, task.timing, drift.mean_motion, eccentricity=eccentricity)
        linear, true = (
            fly(craft, task, MissionGuidance(craft, task), starts, task.timing, move)
            for move in (None, mover)
        )
        spent, spent_truly = np.sum(impulses(linear)), np.sum(impulses(true))
        yield Check(
            f"orbits: {name} in two-body gravity: not won",
            float(np.sum(~np.asarray(true.done))),
            0.0,
            "starts",
            f"Guidance wins all {_COUNT} starts in linear gravity, and corrects itself.",
        )
        yield Check(
            f"orbits: {name} in two-body gravity: limits broken",
            float(np.sum(true.violated())),
            0.0,
            "starts",
            "Coasts keep metres away from limits; terms left out move them by a centimetre.",
        )
        yield Check(
            f"orbits: {name} in two-body gravity: impulse",
            abs(float(spent_truly / spent) - 1.0),
            1e-2,
            "of it",
            "Terms left out are the distance over the orbit's radius, 1e-4 or less, and a burn may fall into "
            "another period.",
        )
