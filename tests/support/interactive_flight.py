"""An episode in Python whose goal and thrusters are changed on the way, to compare pages with."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from rans.episode.flight import begin_flight
from rans.episode.scenario import scenarios
from rans.episode.step import step
from rans.evaluation.fly.agent import LoadedRun
from rans.model.body import Body
from rans.model.fields import leaves, unflatten
from rans.show.pages.playground import interactive_world, may_move_goal


class InteractiveFlight:
    """One episode in float64, step by step, whose commands come after a delay in control periods."""

    def __init__(
        self, run: LoadedRun, seed: int, episode: int = 0, commands: Iterator[Any] | None = None
    ) -> None:
        self.world = interactive_world(run.judged)
        self._controller = begin_flight(run.controller, 1)
        self._commands = commands
        self.delay = 0.0
        self.dead: set[int] = set()
        self.stuck: set[int] = set()
        craft = self.world.craft
        samples = scenarios(self.world.task, craft, seed, 1, first=episode)
        self._episode = self.world.begin(samples.start, samples.goal, 0, None, Body.of(craft))
        self._decided: list[np.ndarray] = []
        self.command = np.zeros(craft.command_count)
        self._controller.reset(1)

    @property
    def state(self) -> Any:
        """State now, fields (1,)."""
        return self._episode.state

    @property
    def moves(self) -> bool:
        """Whether a page lets its visitor move the goal."""
        return may_move_goal(self.world.task)

    def errors(self) -> dict[str, float]:
        """The task's errors now, SI units."""
        result = self.world.task.errors(self.state, self._episode.goal)
        return {name: float(np.asarray(x).ravel()[0]) for name, x in result.items()}

    def place_goal(self, pose: Sequence[float]) -> None:
        """Move the goal: its position, m in W, and a heading in rad or a quaternion."""
        goal = self._episode.goal
        rest = leaves(goal)[len(pose) :]
        moved = unflatten(goal, [*(np.full(1, float(x)) for x in pose), *rest])
        self._episode = replace(self._episode, goal=moved)

    def step(self) -> None:
        """Fly one control period."""
        world = self.world
        episode = replace(self._episode, body=self._body())
        columns = world.observe(episode)
        observation = np.stack([np.broadcast_to(x, 1) for x in columns], axis=1).astype(np.float32)
        if self._commands is None:
            answer = self._controller.act(episode.state, episode.goal, observation)[0]
        else:
            answer = next(self._commands)
        self._decided.append(np.asarray(answer, dtype=float))
        # The command that reaches the thrusters now: of a period that begins with an older one, the mean of both.
        whole = math.floor(self.delay)
        late = self.delay - whole
        self.command = (1.0 - late) * self._before(whole) + late * self._before(whole + 1)
        outcome = step(world, episode, tuple(np.full(1, x) for x in self.command))
        self._episode = replace(outcome.episode, body=self._episode.body)

    def _before(self, periods: int) -> np.ndarray:
        """The command that was decided so many control periods ago; shut before the first."""
        if periods < len(self._decided):
            return self._decided[-1 - periods]
        return np.zeros(self.world.craft.command_count)

    def _body(self) -> Body:
        """The craft with the thrusters that failed."""
        body = Body.of(self.world.craft)
        gain = [0.0 if k in self.dead | self.stuck else x for k, x in enumerate(body.gain)]
        leak = [1.0 if k in self.stuck else x for k, x in enumerate(body.leak)]
        return replace(body, gain=tuple(gain), leak=tuple(leak))
