"""What Clohessy-Wiltshire leaves out of two-body gravity, by mission: ``python -m campaigns orbits``.

Free coasts from random states near the target, flown by RANS's equations and by `rans_missions.two_body`: in
two-body gravity, with the oblate Earth (J2), and with drag as well. The last columns have the errors of the
equations for the oblate Earth and drag, for coasts of up to half an orbit. Also the starts of dock as the code of
the benchmark draws them, counted above the speed limit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from rans_missions.orbits.earth import EARTH, EARTH_RADIUS
from rans_missions.orbits.perturbed import PerturbedOrbit
from rans_missions.tasks import Dock
from rans_missions.tasks.hold import Hold
from rans_missions.tasks.inspect import Inspect
from rans_missions.tasks.rendezvous import Rendezvous
from rans_missions.two_body import Perturbations, density, perturbed_motion, relative_motion

from rans.model.fields import Vec3
from rans.model.spacecraft_file import load_spacecraft
from rans.scenario import EVALUATION_SEED, scenarios

_COASTS: tuple[tuple[str, Any, float, tuple[float, ...]], ...] = (
    ("dock, 150 m", Dock(), 150.0, (600.0, 2000.0)),
    ("hold, 300 m", Hold(), 300.0, (600.0, 2000.0)),
    ("rendezvous, 1 km", Rendezvous(), 1000.0, (4000.0, 10000.0)),
    ("inspect, 100 m", Inspect(), 100.0, (6118.0, 12236.0)),
    ("inspect, 800 m", Inspect(), 800.0, (6118.0, 12236.0)),
)
"""Missions with a distance from the target, m, and the times of coasts from there, s."""
_INCLINATION = np.radians(51.6)
"""Inclination of every orbit, rad: that of the International Space Station."""
_TARGET_DRAG = 0.02
"""Drag coefficient times area over mass of the target, m^2/kg: 2.2 times 1 m^2 for 110 kg."""
_CRAFT_DRAG = 0.04
"""Drag coefficient times area over mass of the craft, m^2/kg: twice that of the target."""
_EARTH_RATE = 7.292115e-5
"""Rate of the Earth's rotation, with which the air turns, rad/s (WGS 84)."""


@dataclass(frozen=True)
class Orbits:
    """Fly coasts, and sample starts."""

    coasts: int = 256
    """Coasts of each mission, in random directions, at up to 1.6 n times the distance, as inspect starts."""
    starts: int = 4096
    """Starts of dock."""
    seed: int = EVALUATION_SEED
    """Of both."""

    def measured(self) -> dict[str, Any]:
        """Errors of coasts, and starts of dock."""
        rows = []
        for name, task, distance, times in _COASTS:
            n = task.mean_motion
            random = np.random.default_rng(self.seed)
            p, v = (directions(random, self.coasts) for _ in range(2))
            p = p * distance
            v = v * (distance * n * random.uniform(0.0, 1.6, (self.coasts, 1)))
            exact, _ = relative_motion(n, p, v, times)
            latitude = random.uniform(0.0, 2.0 * np.pi, self.coasts)
            oblate = Perturbations(_INCLINATION, latitude)
            dragged = replace(oblate, target_drag=_TARGET_DRAG, craft_drag=_CRAFT_DRAG)
            truths = [exact, *(perturbed_motion(n, p, v, times, x)[0] for x in (oblate, dragged))]
            # The same drag as an acceleration, at the height and the speed in the air of the circle.
            size = np.cbrt(EARTH / n**2)
            wind = n * size - _EARTH_RATE * size * np.cos(_INCLINATION)
            air = float(density(np.array([size - EARTH_RADIUS]))[0])
            drag = 0.5 * (_CRAFT_DRAG - _TARGET_DRAG) * air * wind**2
            perturbed = PerturbedOrbit.around_earth(n, float(_INCLINATION), drag, latitude)
            for number, time in enumerate(times):
                linear, _ = task.drift.carry(Vec3(*p.T), Vec3(*v.T), time)
                gaps = [gap(linear, truth[number]) for truth in truths]
                # Half an orbit is as far as the perturbed orbit's equations go.
                own = (math.nan, math.nan)
                if n * time <= math.pi:
                    ours, _ = perturbed.carry(Vec3(*p.T), Vec3(*v.T), time)
                    own = gap(ours, truths[2][number])
                rows.append({"from": name, "time": time, "gaps": [*gaps, own]})
        task = replace(Dock(), starts_as_coded=True)
        drawn: Any = scenarios(task, load_spacecraft("afrl-deputy"), self.seed, self.starts)
        above = task.constraints(drawn.start, drawn.goal)["speed"] < 0.0
        return {"rows": rows, "coded": [{"starts": self.starts, "above": float(above.mean())}]}


def directions(random: np.random.Generator, count: int) -> np.ndarray:
    """Uniform unit vectors, (count, 3)."""
    vectors = random.normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def gap(vectors: Vec3, truth: np.ndarray) -> tuple[float, float]:
    """Median and largest distance, m."""
    gap = np.linalg.norm(np.stack(vectors.columns(), axis=1) - truth, axis=1)
    return float(np.median(gap)), float(gap.max())
