"""A flight that a person changes while it lasts: its goal, its thrusters, its sensors, and who commands it."""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rans.episode import Episode, Setup, World, step
from rans.errors import ConfigError
from rans.evaluation.fly.agent import LoadedRun
from rans.flight import begin_flight
from rans.model.body import Body
from rans.model.coordinates import around
from rans.model.fields import leaves, unflatten
from rans.model.spacecraft import Spacecraft
from rans.randomization.parameters import StepInputs
from rans.scenario import scenarios
from rans.tasks import Task
from rans.tasks.derived import goal_stands_still
from rans.tasks.goal_set import aims

POSITION_NOISE = 0.05
"""Standard deviation of position (m) and velocity (m/s) at full noise."""
ANGLE_NOISE = math.radians(5.0)
"""Standard deviation of each angle (rad) and angular velocity (rad/s) at full noise."""
_MOST_DECIDED = 100
"""Commands that are remembered: more than any delay has control periods."""
FRAME = 0.05
"""Longest time between two states to draw, s."""


def interactive_world(setup: Setup, frame: float = FRAME) -> World:
    """World of a flight that a person changes: nominal, with a state to draw every ``frame`` seconds at least."""
    timing = setup.timing
    frames = math.ceil(timing.control_period / frame)
    checks = math.ceil(max(frames, timing.checks) / timing.checks) * timing.checks
    return World(setup._replace(conditions=None, timing=replace(timing, checks=checks)))


def may_move_goal(task: Task) -> bool:
    """Whether a person may move a task's goal: it has a place to go to, and stands still."""
    return "position" in aims(task) and goal_stands_still(task)


def noise_scale(craft: Spacecraft) -> np.ndarray:
    """Standard deviations at full noise of the coordinates of a state around another.

    (2 n,) for the n degrees of freedom of a craft: m, rad, m/s, rad/s.
    """
    angles = craft.degrees_of_freedom - craft.dimension
    return np.repeat(
        [POSITION_NOISE, ANGLE_NOISE, POSITION_NOISE, ANGLE_NOISE],
        [craft.dimension, angles, craft.dimension, angles],
    )


@dataclass(frozen=True)
class _Snapshot:
    """All that a step changes, as it was before it."""

    episode: Episode
    active: int
    """Number of who commanded."""
    memory: Any
    """What that one remembered; None where it cannot say."""
    decided: tuple[tuple[float, ...], ...]
    """Commands of the controllers so far, the latest last, of which those of the longest delay count."""
    command: tuple[float, ...]
    """That reached the thrusters."""


class InteractiveFlight:
    """One episode in float64, step by step, with several who may command it.

    Attributes:
        delay: control periods after which a command reaches the thrusters; of a period that begins with an older
            command they have the mean.
        noise: 0 to 1, share of `POSITION_NOISE` and `ANGLE_NOISE` in the state that the controller reads.
        over: "" while it lasts, else how it ended: "won" or "failed".

    Raises:
        ConfigError: contestants fly different craft or tasks, or none is given.
    """

    def __init__(
        self, runs: Sequence[LoadedRun], seed: int, episode: int = 0, frame: float = FRAME
    ) -> None:
        if not runs:
            raise ConfigError("say who flies: an interactive flight needs a controller.")
        setups = [run.judged for run in runs]
        first = setups[0]
        for run, setup in zip(runs, setups, strict=True):
            if (setup.craft, setup.task) != (first.craft, first.task):
                raise ConfigError(
                    f"who commands one flight flies one craft and one task: {run.controller.name} is for "
                    f"{setup.craft.name} and {type(setup.task).__name__}, the first for "
                    f"{first.craft.name} and {type(first.task).__name__}."
                )
        self.world = interactive_world(first, frame)
        self.controllers = [begin_flight(run.controller, 1) for run in runs]
        self.seed = seed
        self.number = episode
        self.delay = 0.0
        self.noise = 0.0
        self.dead: set[int] = set()
        self.stuck: set[int] = set()
        self._random = np.random.default_rng(seed)
        self._active = 0
        self.restart()

    def restart(self, episode: int | None = None) -> None:
        """Begin the episode anew, or another one of the seed; faults, delay and noise stay.

        Forgets the past to which one can go back.
        """
        self.number = self.number if episode is None else episode
        craft = self.world.craft
        samples = scenarios(self.world.task, craft, self.seed, 1, first=self.number)
        self._episode = self.world.begin(samples.start, samples.goal, 0, None, Body.of(craft))
        self._past: list[_Snapshot] = []
        self._decided: tuple[tuple[float, ...], ...] = ()
        self.over = ""
        self.command = (0.0,) * self.world.craft.command_count
        self.controller.reset(1)

    @property
    def controller(self) -> Any:
        """Controller that commands now."""
        return self.controllers[self._active]

    @property
    def active(self) -> int:
        """Number of who commands now."""
        return self._active

    @property
    def time(self) -> float:
        """Time since the start, s."""
        return len(self._past) * self.world.timing.control_period

    @property
    def state(self) -> Any:
        """State now, fields (1,)."""
        return self._episode.state

    @property
    def goal(self) -> Any:
        """Goal now, fields (1,)."""
        return self._episode.goal

    @property
    def moves(self) -> bool:
        """Whether a person may move the goal (`may_move_goal`)."""
        return may_move_goal(self.world.task)

    def errors(self) -> dict[str, float]:
        """The task's errors now, SI units."""
        result = self.world.task.errors(self.state, self.goal)
        return {name: float(np.asarray(x).ravel()[0]) for name, x in result.items()}

    def place_goal(self, pose: Sequence[float]) -> None:
        """Move the goal: its position, m in W, and if it follows its attitude, a heading in rad or a quaternion.

        Later goals of the task's own motion are not changed.

        Raises:
            ConfigError: this task's goal cannot be moved by hand.
        """
        if not self.moves:
            raise ConfigError(
                f"the goal of {type(self.world.task).__name__} cannot be moved by hand."
            )
        goal = self._episode.goal
        rest = leaves(goal)[len(pose) :]
        moved = unflatten(goal, [*(np.full(1, float(x)) for x in pose), *rest])
        self._episode = replace(self._episode, goal=moved)

    def command_by(self, number: int) -> None:
        """Let another one command, who begins without a memory."""
        self._active = number % len(self.controllers)
        self.controller.reset(1)

    def step(self) -> list[Any]:
        """Fly one control period; the states within it to draw, the last one at its end.

        Once the episode is over nothing moves. Remembers the step before it, so that one can go back.
        """
        if self.over:
            return [self.state]
        world = self.world
        episode = replace(self._episode, body=self._body())
        self._past.append(
            _Snapshot(self._episode, self._active, self._memory(), self._decided, self.command)
        )

        # The controller's inputs, and its command.
        measured = self._measured(episode.state)
        columns = world.observe(replace(episode, state=measured, reading=None))
        observation = np.stack([np.broadcast_to(x, 1) for x in columns], axis=1).astype(np.float32)
        answer = np.asarray(
            self.controller.act(measured, episode.goal, observation), dtype=np.float64
        )

        # The command that reaches the thrusters now.
        self._decided = (*self._decided[-_MOST_DECIDED:], tuple(float(x) for x in answer[0]))
        whole = math.floor(self.delay)
        late = self.delay - whole
        self.command = tuple(
            (1.0 - late) * now + late * before
            for now, before in zip(self._before(whole), self._before(whole + 1), strict=True)
        )

        # Motion, of which every check is a state to draw.
        frames: list[Any] = []

        def move(state: Any, inputs: StepInputs) -> tuple[Any, ...]:
            frames.extend(world.move(state, inputs))
            return tuple(frames)

        command = tuple(np.full(1, x) for x in self.command)
        outcome = step(world, episode, command, move=move)
        self._episode = replace(outcome.episode, body=self._episode.body)
        if outcome.done is not None and bool(np.asarray(outcome.done).any()):
            self.over = "won"
        elif bool(np.asarray(outcome.failed).any()):
            self.over = "failed"
        return frames

    def rewind(self, periods: int) -> None:
        """Go back by so many control periods, at most to the start.

        A controller without ``memory`` and ``recall`` goes on with nothing remembered.
        """
        back = min(periods, len(self._past))
        if back <= 0:
            return
        then = self._past[-back]
        del self._past[-back:]
        self._episode = then.episode
        self._decided = then.decided
        self.command = then.command
        self.over = ""
        self.controller.reset(1)
        if then.active == self._active and then.memory is not None:
            self.controller.recall(then.memory)

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

    def _memory(self) -> Any:
        """Memory of the controller; None if it cannot be copied."""
        if not (hasattr(self.controller, "memory") and hasattr(self.controller, "recall")):
            return None
        return copy.deepcopy(self.controller.memory())

    def _measured(self, state: Any) -> Any:
        """The state with noise, fields (1,)."""
        if self.noise == 0.0:
            return state
        scale = noise_scale(self.world.craft)
        errors = self.noise * scale * self._random.standard_normal(len(scale))
        noisy = around(state, tuple(np.full(1, x) for x in errors))
        return replace(noisy, notes=state.notes, stores=state.stores)
