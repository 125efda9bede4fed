"""Holding a point near a target around the oblate Earth, with drag: ``python -m campaigns hold-with-J2-and-drag``.

Mission guidance flies the same starts of hold around a sphere and around the oblate Earth with drag, once with an
orbit that it knows and once with the circle around a sphere in its place. The flights are repeated in two-body
gravity with J2 and an atmosphere, and coasts are compared with it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from rans_missions.bounds.transfers import transfer_bounds
from rans_missions.control.mission_guidance import MissionGuidance
from rans_missions.orbits.perturbed import PerturbedOrbit
from rans_missions.tasks import TargetOrbit
from rans_missions.tasks.hold import Hold
from rans_missions.two_body import Perturbations, TwoBodyMover, perturbed_motion

from campaigns.elliptic import directions, gaps
from rans.evaluation.measure.metrics import impulses, won
from rans.flight import fly
from rans.model.drift import ClohessyWiltshire, Drift
from rans.model.spacecraft_file import load_spacecraft
from rans.model.timing import Timing
from rans.scenario import EVALUATION_SEED, scenarios

_DEADLINE = 1000.0
"""s"""
_INCLINATION = 51.6
"""Degrees, that of the International Space Station."""
_TARGET_DRAG = 0.02
"""Drag coefficient times area over mass of the target, m^2/kg: 2.2 times 1 m^2 for 110 kg."""
_DECELERATION = 3.7e-7
"""Acceleration by which the air at 500 km slows the target down, m/s^2: 6.967e-13 kg/m^3 and 7,320 m/s against the
air, which turns with the Earth."""
_RATIO = 0.5
"""Ballistic coefficient of the craft over that of the target."""
_COAST = 2000.0
"""Duration of the coasts, s."""
_DISTANCES = 100.0, 300.0, 1000.0
"""Distances from the target at which coasts begin at rest, m."""
_COASTS = 64
"""Number of coasts from each distance, in random directions and from anywhere on the orbit."""


@dataclass(frozen=True)
class Perturbed:
    """Fly all rows."""

    episodes: int = 64
    """Held-out starts."""
    true: int = 64
    """Number of starts, the first ones, that are flown in two-body gravity."""
    bounded: int = 4
    """Number of starts, the first ones, whose bounds are computed."""
    seed: int = EVALUATION_SEED
    """Seed of the starts."""

    def measured(self) -> dict[str, Any]:
        """Flights, bounds and errors of coasts."""
        return {"rows": self._flown(), "known": self._known(), "coasts": _coast_errors(self.seed)}

    def _known(self) -> dict[str, Any]:
        """Bounds with J2 and drag, N s, beside what mission guidance spends from the same starts."""
        craft = load_spacecraft("vbar-chaser")
        _, perturbed, timing = around_the_earth()
        starts = scenarios(perturbed, craft, self.seed, self.bounded)
        answers = transfer_bounds(craft, perturbed, starts, _DEADLINE)
        flight = fly(craft, perturbed, MissionGuidance(craft, perturbed), starts, timing)
        return {
            "bounds": [answer.lower for answer in answers],
            "spent": impulses(flight).tolist(),
            "won": won(flight).tolist(),
        }

    def _flown(self) -> list[dict[str, Any]]:
        craft = load_spacecraft("vbar-chaser")
        sphere, perturbed, timing = around_the_earth()
        gravity = TwoBodyMover(craft, timing, sphere.mean_motion, perturbations=_air(np.zeros(1)))
        calm = np.zeros(0)
        rows = []
        for who, knows, flown_in, task, mover, count in (
            ("mission guidance", sphere, "sphere", sphere, None, self.episodes),
            ("mission guidance", perturbed, "J2, drag", perturbed, None, self.episodes),
            ("mission guidance for a sphere", sphere, "J2, drag", perturbed, None, self.episodes),
            (
                "mission guidance",
                perturbed,
                "two-body gravity, J2, air",
                perturbed,
                gravity,
                self.true,
            ),
        ):
            # The same positions and deadlines; the angle of the target is drawn besides.
            starts = scenarios(task, craft, self.seed, count)
            pilot = MissionGuidance(craft, knows)
            flight = fly(craft, task, pilot, starts, timing, mover)
            spent = impulses(flight)
            if not len(calm):
                calm = spent
            more = 100.0 * (spent / calm[:count] - 1.0)
            rows.append(
                {
                    "who": who,
                    "flown in": flown_in,
                    "starts": count,
                    "won": 100.0 * float(won(flight).mean()),
                    "broken": 100.0 * float(flight.violated().mean()),
                    "spent": float(spent.mean()),
                    "more": 100.0 * float(spent.sum() / calm[:count].sum() - 1.0),
                    "worst": float(more.max()),
                }
            )
        return rows


def around_the_earth() -> tuple[Hold, Hold, Timing]:
    """Hold around a sphere and with J2 and drag, and the timing of a whole flight."""
    sphere = Hold(deadline=(_DEADLINE, _DEADLINE))
    orbit = TargetOrbit(
        oblate=True,
        inclination_degrees=_INCLINATION,
        target_drag=_DECELERATION,
        ballistic_ratio=_RATIO,
    )
    steps = round((_DEADLINE + sphere.hold_seconds) / Hold.timing.control_period) + 1
    return sphere, replace(sphere, orbit=orbit), replace(Hold.timing, episode_steps=steps)


def _air(latitude: np.ndarray) -> Perturbations:
    """J2 and the air of targets at these arguments of latitude, rad."""
    return Perturbations(
        math.radians(_INCLINATION),
        latitude,
        target_drag=_TARGET_DRAG,
        craft_drag=_TARGET_DRAG / _RATIO,
    )


def _coast_errors(seed: int) -> list[dict[str, Any]]:
    """How far coasts of linear equations end from those in two-body gravity with J2 and air, m."""
    rng = np.random.default_rng(seed)
    n = Hold().mean_motion
    drag = _DECELERATION * (1.0 / _RATIO - 1.0)
    rows = []
    for distance in _DISTANCES:
        p = distance * directions(rng, _COASTS)
        latitude = rng.uniform(0.0, math.tau, _COASTS)
        truth, _ = perturbed_motion(n, p, 0.0 * p, [_COAST], _air(latitude))
        drifts: dict[str, Drift] = {
            "these equations": PerturbedOrbit.around_earth(
                n, math.radians(_INCLINATION), drag, latitude
            ),
            "circle": ClohessyWiltshire(n),
        }
        found = gaps(drifts, p, 0.0 * p, _COAST, truth[0])
        rows.append({"distance": distance, "coasts": _COASTS, **found})
    return rows


def known(evidence: Any) -> list[dict[str, Any]]:
    """Rows of the table of proven bound, cheapest known flight and agent."""
    found = evidence["known"]
    bounds, spent = (np.array(found[name], dtype=float) for name in ("bounds", "spent"))
    none = {"starts": "-", "won": "-", "ratio": "-", "spent": "-"}
    of_starts = {**none, "starts": len(bounds)}
    return [
        {
            **of_starts,
            "what": "proven bound",
            "who": "any flight",
            "ratio": "1",
            "spent": f"{bounds.mean():.0f}",
        },
        {
            **of_starts,
            "what": "cheapest known",
            "who": "mission guidance",
            "won": f"{100.0 * np.mean(found['won']):.1f}",
            "ratio": f"{np.mean(spent / bounds):.3f}",
            "spent": f"{spent.mean():.0f}",
        },
        {**none, "what": "agent", "who": "none"},
    ]
