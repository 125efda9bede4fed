"""Processor time of a filtered step of one spacecraft: ``python -m campaigns filter-cost``.

Random commands fly first, so that the predictions of a mission are traced before the adversary is timed.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from rans_missions.guard import safety_filter
from rans_missions.guard.ahead import Ahead

from campaigns.guard import MISSIONS, SEED, adversary, setup_of
from rans.episode import Setup, World
from rans.errors import one_of
from rans.model.fields import map_leaves
from rans.scenario import scenario

_PERIODS = 120
"""Control periods of a flight, in which the adversary reaches a boundary."""


@dataclass(frozen=True)
class FilterCost:
    """Fly one spacecraft after the other behind the filter, and time its steps."""

    missions: tuple[str, ...] = tuple(MISSIONS)
    """Names of the missions that are flown, keys of `campaigns.guard.MISSIONS`."""
    seconds: float = 25.0
    """Time for the random commands of a mission, and for its adversary."""

    def measured(self) -> Iterator[dict[str, Any]]:
        """Steps of each mission and pilot, ms."""
        for mission in self.missions:
            one_of("a mission", mission, MISSIONS)
            setup = setup_of(mission)
            for who in ("random", "adversary"):
                costs = 1e3 * np.array(_costs(setup, who, self.seconds))
                yield {
                    "mission": mission,
                    "who": who,
                    "steps": len(costs),
                    "period": 1e3 * setup.timing.control_period,
                    "median": float(np.median(costs)),
                    "99 %": float(np.percentile(costs, 99)),
                    "largest": float(costs.max()),
                }


def _costs(setup: Setup, who: str, seconds: float) -> list[float]:
    """Processor time of each filtered step, s."""
    guard = safety_filter(setup)
    world = World(setup)
    ahead = Ahead(world)
    attack = adversary(world)
    random = np.random.default_rng(0)
    costs: list[float] = []
    end = time.perf_counter() + seconds
    episode = 0
    while time.perf_counter() < end:
        start = scenario(setup.task, setup.craft.dimension, seed=SEED, episode=episode)
        episode += 1
        now: Any = start.start, start.goal
        for _ in range(_PERIODS):
            arrays = map_leaves(lambda x: np.array([x], dtype=np.float64), now)
            if who == "random":
                levels = random.random(len(setup.craft.commands))
                desired = levels if setup.craft.is_continuous else np.round(levels)
            else:
                desired = attack(*arrays, ())
            command = tuple(float(np.asarray(x).ravel()[0]) for x in desired)
            before = time.thread_time()
            admitted, _ = guard.admitted(world, *now, command)
            costs.append(time.thread_time() - before)
            end_state = ahead.fly(*arrays, tuple(np.array([x]) for x in admitted))
            now = map_leaves(
                lambda x: float(np.asarray(x).ravel()[0]), (end_state.state, end_state.goal)
            )
            if time.perf_counter() > end:
                break
    return costs
