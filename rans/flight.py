"""Flights: what a controller did from a batch of scenarios, in one form for every engine."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from rans.model.body import Body
from rans.model.dynamics import held
from rans.model.fields import leaves, map_leaves, unflatten
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from rans.scenario import Scenario
from rans.tasks.base import Task, observation


class Controller(Protocol):
    """Anything that decides which thrusters to open: an agent, an LQR, an MPC."""

    @property
    def name(self) -> str:
        """What to call it in tables."""
        ...

    def reset(self, count: int) -> None:
        """Forget the past: ``count`` new episodes start."""
        ...

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """Commands for every episode.

        Args:
            state: `PlanarState` or `SpatialState` of float64 arrays (N,).
            goal: the same for the goals.
            observation: (N, width) float32, as `rans.tasks.observation` orders it.

        Returns:
            (N, thrusters), each entry what the craft's actuators take: usually 0 (shut) or 1 (open).
        """
        ...


@dataclass(frozen=True)
class Flight:
    """N episodes of T control periods."""

    craft: Spacecraft
    task: Task
    timing: Timing
    states: Any
    """`State` whose fields are float64 arrays (T + 1, N)."""
    goals: Any
    """`State` whose fields are float64 arrays (N,)."""
    commands: np.ndarray
    """(T, N, thrusters), 0 to 1."""
    controller: str
    """Name of the controller."""
    engine: str = "fast"
    """"fast" (our equations) or "drake" (the reference)."""

    @property
    def times(self) -> np.ndarray:
        """(T + 1,) s."""
        return np.arange(len(self.commands) + 1) * self.timing.control_period

    def errors(self) -> dict[str, np.ndarray]:
        """The task's errors at every instant, each (T + 1, N)."""
        return self.task.errors(self.states, self.goals)

    def rewards(self) -> dict[str, np.ndarray]:
        """Reward terms of every step, each (T, N)."""
        after = map_leaves(lambda x: x[1:], self.states)
        command = np.moveaxis(self.commands, 2, 0)
        previous = np.insert(command[:, :-1], 0, 0.0, axis=1)
        return self.task.reward(after, self.goals, tuple(command), tuple(previous))

    def failed(self) -> np.ndarray:
        """(N,) whether the task ever declared the episode failed."""
        return self.task.failed(self.states, self.goals).any(axis=0)


def fly(craft: Spacecraft, task: Task, controller: Controller, starts: Scenario, timing: Timing) -> Flight:
    """Fly a batch of scenarios with our equations, in float64.

    Episodes run for the full time, failed or not, so that nothing is dropped from a statistic.
    """
    state: Any = starts.start
    goal = starts.goal
    body, count = Body.of(craft), len(leaves(starts.start)[0])
    controller.reset(count)
    states, commands = [state], []
    for _ in range(timing.episode_steps):
        seen = np.stack(observation(task, state, goal), axis=1).astype(np.float32)
        command = np.asarray(controller.act(state, goal, seen), dtype=np.float64)
        state = held(state, craft, body, tuple(command.T), timing)
        states.append(state)
        commands.append(command)
    track = unflatten(state, [np.stack(x) for x in zip(*(leaves(s) for s in states), strict=True)])
    return Flight(craft, task, timing, track, goal, np.stack(commands), controller.name)
