"""An episode in Python whose goal and thrusters are changed on the way, to compare pages with."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from rans.episode import step
from rans.evaluation.fly.agent import LoadedRun
from rans.flight import begin_flight
from rans.model.body import Body
from rans.model.fields import leaves, unflatten
from rans.scenario import scenarios
from rans.show.pages.playground import interactive_world, may_move_goal


class InteractiveFlight:
    """One episode in float64, step by step, with several who may command it, after a delay in control periods."""

    def __init__(self, runs: Sequence[LoadedRun], seed: int, episode: int = 0) -> None:
        self.world = interactive_world(runs[0].judged)
        self.controllers = [begin_flight(run.controller, 1) for run in runs]
        self.active = 0
        self.delay = 0.0
        self.dead: set[int] = set()
        self.stuck: set[int] = set()
        craft = self.world.craft
        samples = scenarios(self.world.task, craft, seed, 1, first=episode)
        self._episode = self.world.begin(samples.start, samples.goal, 0, None, Body.of(craft))
        self._decided: tuple[tuple[float, ...], ...] = ()
        self.command = (0.0,) * craft.command_count
        self.controllers[0].reset(1)

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
        answer = self.controllers[self.active].act(episode.state, episode.goal, observation)
        self._decided = (*self._decided, tuple(float(x) for x in np.asarray(answer)[0]))
        # The command that reaches the thrusters now: of a period that begins with an older one, the mean of both.
        whole = math.floor(self.delay)
        late = self.delay - whole
        self.command = tuple(
            (1.0 - late) * now + late * before
            for now, before in zip(self._before(whole), self._before(whole + 1), strict=True)
        )
        outcome = step(world, episode, tuple(np.full(1, x) for x in self.command))
        self._episode = replace(outcome.episode, body=self._episode.body)

    def _before(self, periods: int) -> tuple[float, ...]:
        """The command that was decided so many control periods ago; shut before the first."""
        shut = (0.0,) * self.world.craft.command_count
        return self._decided[-1 - periods] if periods < len(self._decided) else shut

    def _body(self) -> Body:
        """The craft with the thrusters that failed."""
        body = Body.of(self.world.craft)
        gain = [0.0 if k in self.dead | self.stuck else x for k, x in enumerate(body.gain)]
        leak = [1.0 if k in self.stuck else x for k, x in enumerate(body.leak)]
        return replace(body, gain=tuple(gain), leak=tuple(leak))
