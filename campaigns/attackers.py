"""Controllers that try to break constraints: ``rans evaluate campaigns.attackers:Adversary:avoid-2d --guard``."""

from __future__ import annotations

from typing import Any

import numpy as np
from rans_missions.guard.manoeuvres import slope_of_least

from rans.episode import Setup, World
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from rans.tasks import Task


class Adversary:
    """Opens every thruster that pushes up the steepest way out of the constraints, fully."""

    name = "adversary"

    def __init__(self, craft: Spacecraft, task: Task, timing: Timing | None = None) -> None:
        self._world = World(Setup(craft, task, timing or task.timing))
        self._forces = np.array(craft.wrench_map)[:, : craft.dimension]

    def reset(self, count: int) -> None:
        """Nothing is remembered."""

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """Commands (N, thrusters), 0 or 1."""
        slope = slope_of_least(self._world, state, goal)
        towards = state.attitude.inverse().rotate(goal.p - state.p)
        away = state.attitude.inverse().rotate(slope.scale(-1.0))
        # Of constraints on the speed there is no slope over positions: towards the goal, as fast as it goes.
        names = self._world.task.constraints(state, goal)
        flat = slope.norm() < (1e30 if all("speed" in name for name in names) else 1e-4)
        way = np.stack(
            [np.where(flat, b, a) for a, b in zip(away.columns(), towards.columns(), strict=True)]
        )
        return (self._forces @ way > 0.3 * np.linalg.norm(way, axis=0)).T.astype(float)


class Random:
    """Each thruster open or shut with equal chances; throttles and pulsed valves at any level."""

    name = "random commands"

    def __init__(self, craft: Spacecraft, task: Task, timing: Timing | None = None) -> None:
        self._craft = craft

    def reset(self, count: int) -> None:
        """Begin the sequence of commands anew."""
        self._random = np.random.default_rng(0)

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """Commands (N, effectors)."""
        levels = self._random.random((len(observation), len(self._craft.commands)))
        return levels if self._craft.is_continuous else np.round(levels)
