"""One episode and its one step: what the engine, the kernels, environments, flights and Drake all drive.

Everything is a pure function over fields (`rans.model.fields`) without branches, so that the same source
steps one spacecraft of numbers, a batch of NumPy or torch, and the symbols that a GPU kernel is made from.
Drivers differ in who moves the spacecraft (our equations, or Drake) and who begins the next episode.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

from rans.errors import ConfigError
from rans.model.accuracy import chosen
from rans.model.body import Body
from rans.model.case import Case, Influences, draw, examples
from rans.model.conditions import Conditions
from rans.model.dynamics import NODES, held
from rans.model.fields import Field, finite, leaves, map_leaves, where
from rans.model.memory import Memory
from rans.model.random import Draws
from rans.model.sensors import reading
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from rans.tasks.base import Task, observation
from rans.tasks.derived import watches_switching
from rans.tasks.rewards import Transition

Command = tuple[Field, ...]
"""One field per thruster."""


@dataclass(frozen=True)
class Episode:
    """What is known of N running episodes, or of one: states and goals are a `State` of fields each."""

    state: Any
    goal: Any
    """Of floats where the task's goal never varies."""
    body: Body | None = None
    """What flies: numbers, or fields where spacecraft differ; None: as designed. Conditions change it."""
    case: Case | None = None
    """What it drew from its conditions; None: nothing, or what is drawn again in every step."""
    past: tuple[Any, ...] = ()
    """The states before, the last one first: as many as readings may be old."""
    reading: Any = None
    """What sensors told last, where they may tell it again."""
    clock: Field = 0
    """int32: control periods since the episode's start in the low bits, and above them how many episodes of
    this environment came before. Their count wraps around."""
    commands: tuple[Command, ...] = ()
    """The last ones, the newest first: as many as are still felt, or as the task's reward looks at."""

    def memory(self) -> list[Field]:
        """Every field that varies, in the order of definition."""
        return [x for x in leaves(self) if not isinstance(x, int | float)]


@dataclass(frozen=True)
class Outcome:
    """What one control period gave, before any reset."""

    episode: Episode
    """As it arrived."""
    command: Command
    """What valves were told to do."""
    terms: dict[str, Field]
    """Reward by name."""
    terminated: Field
    """The task failed, or a number of the state is no longer finite."""
    truncated: Field
    """Time is up, and the task did not fail in the same step."""
    reached: Field
    """Every error is within the task's tolerance."""

    @property
    def reward(self) -> Field:
        """Sum of the terms."""
        return sum(self.terms.values())

    @property
    def ended(self) -> Field:
        """Whether this was the episode's last step."""
        return self.terminated | self.truncated


@dataclass(frozen=True)
class World:
    """Everything about episodes that does not change while they run."""

    craft: Spacecraft
    task: Task
    timing: Timing = field(default_factory=Timing)
    nodes: int = NODES
    """Of the quadrature in the plane (`rans.model.dynamics.advance`)."""
    conditions: Conditions | None = None
    """What episodes do not promise; None: a perfect world."""

    def __post_init__(self) -> None:
        """Substeps are chosen for what flies; under conditions for the quickest of 1,024 episodes' bodies."""
        bodies = None
        torque = 0.0
        if self.conditions is not None:
            bodies = examples(self.conditions, self.craft, self.timing.episode_steps).strongest()
            torque = self.conditions.steady_torque
        object.__setattr__(self, "timing", chosen(self.craft, self.timing, bodies, torque))

    def move(self, state: Any, influences: Influences) -> Any:
        """The state one control period later, by our equations."""
        body = influences.body
        command = influences.commands[0]
        return held(
            state,
            self.craft,
            body,
            command,
            self.timing,
            self.task.drift,
            self.nodes,
            influences.disturbance,
            influences.pieces(self.craft, self.timing.control_period),
        )

    def observe(self, episode: Episode, draws: Draws | None = None) -> tuple[Field, ...]:
        """What a policy sees now."""
        return observation(self.task, self.sensed(episode, draws), episode.goal)

    def number(self, clock: Field, draws: Draws) -> Field:
        """Number of the episode, which with the seed decides all that it draws."""
        return draws.first + self.timing.episode(clock) * draws.stride

    def scenario(self, clock: Field, draws: Draws) -> tuple[Any, Any]:
        """Start and goal of the episodes that begin at these clocks."""
        return self.task.sample(draws.random(self.craft.dimension, self.number(clock, draws)))

    def begin(
        self,
        start: Any,
        goal: Any,
        clock: Field = 0,
        draws: Draws | None = None,
        body: Body | None = None,
    ) -> Episode:
        """A new episode from a start to a goal.

        The clock is as in `Episode`. Under conditions it takes draws. A body is what flies before conditions
        change it; None: as designed.
        """
        shut = (0,) * len(self.craft.thrusters)
        new = self.recalled(
            Episode(
                start,
                goal,
                body,
                past=(start,) * self._memory.states,
                clock=clock,
                commands=(shut,) * self.remembered,
            ),
            draws,
        )
        sensors = None if new.case is None else new.case.sensors
        if sensors is None or not sensors.repeats:
            return new
        return replace(new, reading=self.read(new, draws))

    @cached_property
    def remembered(self) -> int:
        """How many commands an episode remembers."""
        return max(
            self._memory.felt, self._memory.obeyed, int(watches_switching(self.task, self.craft))
        )

    @cached_property
    def _memory(self) -> Memory:
        return Memory.of(self.conditions, self.timing.control_period)

    def recalled(self, episode: Episode, draws: Draws | None) -> Episode:
        """The episode with what it drew from its conditions, drawn again if it does not remember.

        Raises:
            ConfigError: there is nothing to draw with.
        """
        if self.conditions is None or episode.case is not None:
            return episode
        if draws is None:
            raise ConfigError(
                "what an episode meets is drawn by its seed and number: give `draws` with "
                "conditions."
            )
        return replace(
            episode,
            case=draw(
                self.conditions,
                self.craft,
                episode.body or Body.of(self.craft),
                self.timing.episode_steps,
                self.number(episode.clock, draws),
                draws,
            ),
        )

    def influences(self, episode: Episode, command: Command, draws: Draws | None) -> Influences:
        """What moves the spacecraft while a command is held."""
        case = episode.case
        period = self.timing.control_period
        if case is None or draws is None:
            return Influences(episode.body or Body.of(self.craft), (command,))
        step = draws.real(self.timing.step(episode.clock))
        earlier = (tuple(map(draws.real, told)) for told in episode.commands[: self._memory.felt])
        body, fails = case.flying(step * period)
        return Influences(
            body, (command, *earlier), case.lag, case.disturbance(step, period), fails
        )

    def sensed(self, episode: Episode, draws: Draws | None) -> Any:
        """The state as sensors tell it."""
        return episode.reading if episode.reading is not None else self.read(episode, draws)

    def read(self, episode: Episode, draws: Draws | None, last: Any = None) -> Any:
        """What sensors read anew; the last reading, if there was one, stands where they drop out."""
        case = episode.case
        if case is None or case.sensors is None or draws is None:
            return episode.state
        step = self.timing.step(episode.clock)
        time = draws.real(step) * self.timing.control_period
        return reading(
            (episode.state, *episode.past),
            case.sensors,
            lambda block: draws.random(self.craft.dimension, case.number, step * 16 + block),
            last,
            time,
        )


Mover = Callable[[Any, Influences], Any]
"""The state one control period later: `World.move`, or Drake."""


def step(
    world: World,
    episode: Episode,
    command: Command,
    draws: Draws | None = None,
    move: Mover | None = None,
) -> Outcome:
    """Hold the command, 0 (shut) to 1 (open) each, for one control period.

    Under conditions it takes draws, and an episode that knows its case. By default our equations move.
    """
    task = world.task
    period = world.timing.control_period
    if episode.case is not None and episode.case.hold is not None:
        command = episode.case.hold.obeyed(command, episode.commands, period)
    state = (move or world.move)(episode.state, world.influences(episode, command, draws))
    goal = task.next_goal(episode.goal, state, period)
    clock = episode.clock + 1
    terminated = task.failed(state, goal) | ~finite(*leaves(state))
    arrived = replace(
        episode,
        state=state,
        goal=goal,
        clock=clock,
        past=(episode.state, *episode.past)[: len(episode.past)],
        commands=(command, *episode.commands)[: len(episode.commands)],
    )
    if episode.reading is not None:
        arrived = replace(arrived, reading=world.read(arrived, draws, episode.reading))
    previous = episode.commands[0] if episode.commands else command
    return Outcome(
        episode=arrived,
        command=command,
        terms=task.reward(Transition(state, goal, command, previous)),
        terminated=terminated,
        truncated=(world.timing.step(clock) >= world.timing.episode_steps) & ~terminated,
        reached=task.reached(state, goal),
    )


def restart(world: World, outcome: Outcome, draws: Draws) -> Episode:
    """The next episode where one ended, elsewhere the same."""
    ended = outcome.ended
    arrived = outcome.episode

    def choose(new: Field, old: Field) -> Field:
        never_varies = new is old or isinstance(old, int | float)
        return old if never_varies else where(ended, new, old)

    clock = world.timing.next_episode(arrived.clock)
    begun = world.begin(*world.scenario(clock, draws), clock, draws, arrived.body)
    return map_leaves(choose, begun, arrived)
