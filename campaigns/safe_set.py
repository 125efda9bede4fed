"""From which states the safety filter holds: ``python -m campaigns safe-states``.

The spacecraft flies straight at the middle of a keep-out zone of the mission avoid, at several distances from its
surface and speeds relative to it, with any attitude and a spin of up to 0.5 rad/s. States within another zone are
left out. A state is *safe* if one of the filter's manoeuvres keeps every constraint from it
(`rans_missions.guard.FlownBackup.safe`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from rans_missions.guard import safety_filter
from rans_missions.tasks import Avoid

from rans.episode.scenario import scenarios
from rans.episode.step import Setup, World
from rans.model.fields import map_leaves, unflatten
from rans.model.spacecraft_file import load_spacecraft
from rans.tasks import Task

_CRAFT = {"plane": "floating-platform", "space": "free-flyer"}
DISTANCES = (0.05, 0.1, 0.2, 0.4, 0.8)
"""From the zone's surface, m."""
_SPEEDS = (0.1, 0.2, 0.3, 0.5, 0.8)
"""Towards its centre, m/s."""
_SPIN = 0.5
"""Largest spin about each axis, rad/s."""


@dataclass(frozen=True)
class SafeSet:
    """Judge states."""

    seed: int = 2031
    """Seed of attitudes, spins and directions."""
    states: int = 1024
    """States of every distance and speed."""

    def measured(self) -> Iterator[dict[str, Any]]:
        """Shares of safe states at every speed, by distance."""
        for mission, name in _CRAFT.items():
            craft = load_spacecraft(name)
            task = Avoid().for_evaluation()
            setup = Setup(craft, task, task.timing)
            guard: Any = safety_filter(setup)
            world = World(setup)
            starts = scenarios(task, craft, self.seed, self.states)
            for speed in _SPEEDS:
                shares = []
                for distance in DISTANCES:
                    state = _approach(task, starts, distance, speed, self.seed)
                    margins = task.constraints(state, starts.goal).values()
                    outside = np.min([np.asarray(margin) for margin in margins], axis=0) >= 0.0
                    safe = np.asarray(guard.safe(world, state, starts.goal))
                    shares.append(float(np.mean(safe[outside])))
                yield {"mission": mission, "speed": speed, "safe": shares}


def _approach(task: Task, starts: Any, distance: float, speed: float, seed: int) -> Any:
    """States (N,) that fly straight at the first zone, with the attitudes of the starts."""
    random = np.random.default_rng(seed)
    start = starts.start
    zone: Any = task.scenery(starts.goal)[0]
    count = len(np.asarray(start.p.x))
    away = random.normal(size=(len(zone.centre.columns()), count))
    away /= np.linalg.norm(away, axis=0)
    outwards = unflatten(zone.centre, list(away))
    spins = map_leaves(lambda x: random.uniform(-_SPIN, _SPIN, np.shape(x)), start.w)
    return replace(
        start,
        p=zone.centre + outwards.scale(zone.radius + distance),
        v=zone.v + outwards.scale(-speed),
        w=spins,
    )
