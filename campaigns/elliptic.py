"""Docking with a target on elliptic orbits, beside two-body gravity: ``python -m campaigns dock-on-ellipses``.

Every orbit has its perigee at an altitude of 400 km, and flights begin anywhere on it. The lower bound and the
cheapest known flight are those of a conic program.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from rans_missions.bounds.transfers import optimum, transfer_bounds
from rans_missions.control.mission_guidance import MissionGuidance
from rans_missions.orbits.elliptic import EllipticOrbit, mean_anomaly
from rans_missions.tasks import Dock, TargetOrbit
from rans_missions.two_body import TwoBodyMover, relative_motion

from campaigns.missions import of_first, row, row_of
from rans.evaluation.measure.metrics import impulses, won
from rans.flight import Flight, fly
from rans.model.drift import ClohessyWiltshire, Drift
from rans.model.fields import Vec3
from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import load_spacecraft
from rans.scenario import EVALUATION_SEED, scenarios

ECCENTRICITIES = (0.1, 0.3, 0.5, 0.7)
"""The last is about that of a transfer to geostationary orbit."""
_PERIGEE = 6378.137 + 400.0
"""km from the Earth's centre."""
_DEADLINE = 1000.0
"""s"""
_COAST = 150.0
"""Distance from the target at which coasts begin, m, as the farthest starts of dock."""


@dataclass(frozen=True)
class Elliptic:
    """Fly every orbit."""

    episodes: int = 64
    """Held-out starts of guidance."""
    bounded: int = 4
    """Number of starts, the first ones, whose bounds are computed and which fly in two-body gravity."""
    coasts: int = 256
    """Coasts of each orbit, at any true anomaly, in random directions."""
    seed: int = EVALUATION_SEED
    """Seed of the starts of guidance and of the coasts."""
    only: float | None = None
    """Measure one eccentricity. Other rows are kept as they are in the evidence."""

    def measured(self) -> dict[str, Any]:
        """Rows of flights, and errors of coasts."""
        asked = ECCENTRICITIES if self.only is None else (self.only,)
        rows = [row for e in asked for row in self._flown(e)]
        return {"rows": rows, "errors": [self._errors(e) for e in ECCENTRICITIES]}

    def _flown(self, eccentricity: float) -> Iterator[dict[str, Any]]:
        craft = load_spacecraft("afrl-deputy")
        timing = replace(Dock.timing, episode_steps=round(_DEADLINE / Dock.timing.control_period))
        task = Dock(deadline=(_DEADLINE, _DEADLINE), orbit=orbit_of(eccentricity)).for_evaluation()
        assert isinstance(task, Dock)
        starts = scenarios(task, craft, self.seed, self.episodes)
        few = scenarios(task, craft, self.seed, self.bounded)
        answers = transfer_bounds(craft, task, few, _DEADLINE)
        lower = of_first([answer.lower for answer in answers], self.episodes)
        name = f"{eccentricity:g}"
        yield self._cheapest(name, craft, task, answers)
        # Guidance that takes the orbit for a circle of the same period.
        circular = replace(task, orbit=TargetOrbit())
        for who, mission, mover, flown in (
            ("mission guidance", task, None, starts),
            (
                "mission guidance, in two-body gravity",
                task,
                _two_body(craft, task),
                few,
            ),
            ("mission guidance for a circle", circular, None, starts),
        ):
            guidance = MissionGuidance(craft, mission)
            flight = fly(craft, task, guidance, flown, timing, mover)
            found = row_of(name, who, flight, impulses(flight), lower)
            yield {**found, "median": _median(flight)}

    def _cheapest(
        self, name: str, craft: Spacecraft, task: Dock, answers: list[Any]
    ) -> dict[str, Any]:
        """Flights of the conic program, which engine and Drake replay."""
        few = scenarios(task, craft, self.seed, self.bounded)
        replayed = optimum(craft, task, few, answers)
        won = replayed.docked
        ratios = (replayed.impulse / [answer.lower for answer in answers])[won]
        checks = [answer.transfer.check for answer in answers if answer.transfer is not None]
        found = row(
            name,
            "cheapest known (conic program)",
            won,
            np.asarray(replayed.violated),
            replayed.impulse,
            ratios,
        )
        return {**found, "median": float(np.median(checks))}

    def _errors(self, eccentricity: float) -> dict[str, Any]:
        """Median and largest error of both equations after coasts of `_DEADLINE`, m."""
        n = orbit_of(eccentricity).mean_motion(0.0)
        random = np.random.default_rng(self.seed)
        p, v = (directions(random, self.coasts) for _ in range(2))
        p = p * _COAST
        v = v * (_COAST * n * random.uniform(0.0, 1.6, (self.coasts, 1)))
        anomalies = random.uniform(-math.pi, math.pi, self.coasts)
        exact, _ = relative_motion(
            n, p, v, [_DEADLINE], eccentricity=eccentricity, true_anomaly=anomalies
        )
        drifts: dict[str, Drift] = {
            "circle": ClohessyWiltshire(n),
            "ellipse": EllipticOrbit(n, eccentricity, mean_anomaly(anomalies, eccentricity)),
        }
        return {"eccentricity": eccentricity, **gaps(drifts, p, v, _DEADLINE, exact[0])}


def gaps(
    drifts: dict[str, Drift], p: np.ndarray, v: np.ndarray, time: float, truth: np.ndarray
) -> dict[str, list[float]]:
    """Median and largest distance, m, between the ends of coasts by linear equations and their true ends, by name.

    Args:
        drifts: the equations.
        p: (N, 3) positions at the start, m.
        v: (N, 3) velocities, m/s.
        time: duration, s.
        truth: (N, 3) true positions at the end, m.
    """
    found = {}
    for name, drift in drifts.items():
        end, _ = drift.carry(Vec3(*p.T), Vec3(*v.T), time)
        away = np.linalg.norm(np.stack(end.columns(), axis=1) - truth, axis=1)
        found[name] = [float(np.median(away)), float(away.max())]
    return found


def directions(random: np.random.Generator, count: int) -> np.ndarray:
    """Uniform unit vectors (count, 3)."""
    vectors = random.normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def orbit_of(eccentricity: float) -> TargetOrbit:
    """Orbit of this eccentricity with the campaign's perigee."""
    return TargetOrbit(eccentricity, round(_PERIGEE / (1.0 - eccentricity), 3))


def _two_body(craft: Spacecraft, task: Dock) -> TwoBodyMover:
    return TwoBodyMover(craft, task.timing, task.mean_motion, eccentricity=task.orbit.eccentricity)


def _median(flight: Flight) -> float:
    """Median time until the end of the period of the docking, s; NaN where nobody docked."""
    assert flight.lengths is not None
    times = flight.lengths[won(flight)] * flight.timing.control_period
    return float(np.median(times)) if len(times) else float("nan")
