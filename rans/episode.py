"""One episode and its one step: what the engine, the kernels, environments, flights and Drake all drive.

Everything is a pure function over fields (`rans.model.fields`) without branches, so that the same source
steps one spacecraft of numbers, a batch of NumPy or torch, and the symbols that a GPU kernel is made from.
Drivers differ in who moves the spacecraft (our equations, or Drake) and who begins the next episode.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, reduce
from typing import Any, NamedTuple, Protocol

from rans.effectors.motion import states_at_checks
from rans.errors import ConfigError
from rans.model.accuracy import chosen
from rans.model.body import Body
from rans.model.dynamics import NODES
from rans.model.fields import Field, finite, leaves, map_leaves, where
from rans.model.random import Draws
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from rans.randomization.conditions import Conditions
from rans.randomization.memory import Memory
from rans.randomization.parameters import EpisodeParameters, StepInputs, draw, examples
from rans.randomization.sensors import reading
from rans.tasks.base import Task, goal_after, observation, reward_terms
from rans.tasks.derived import watches_switching
from rans.tasks.rewards import Transition

Command = tuple[Field, ...]
"""One field per command of the craft (`rans.model.spacecraft.Spacecraft.commands`)."""


@dataclass(frozen=True)
class Episode:
    """What is known of N running episodes, or of one: states and goals are a `State` of fields each."""

    state: Any
    goal: Any
    """Of floats where the task's goal never varies."""
    body: Body | None = None
    """What flies: numbers, or fields where spacecraft differ; None: as designed. Conditions change it."""
    parameters: EpisodeParameters | None = None
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
    violated: Field | None = None
    """1 where a margin of the task's constraints was negative before, else 0; None: that ends episodes."""

    def memory(self) -> list[Field]:
        """Every field that varies, in the order of definition."""
        return [x for x in leaves(self) if not isinstance(x, int | float)]


@dataclass(frozen=True)
class Outcome:
    """What one control period gave, before any reset."""

    episode: Episode
    """As it arrived."""
    command: Command
    """Command that the effectors were given."""
    terms: dict[str, Field]
    """Reward by name."""
    failed: Field
    """The task failed, a constraint was violated that ends episodes, or the state is no longer finite."""
    done: Field | None
    """The mission was won, before any failure; None: the task lasts until time is up."""
    truncated: Field
    """Time is up, and nothing else ended the episode in the same step."""
    reached: Field
    """Whether every error is within the task's tolerance; of a mission that can be won, whether it was.

    False where the episode failed, or a constraint was violated.
    """
    margins: dict[str, Field]
    """The least of each margin of `Task.constraints` over the checks of the period, until the episode ended."""
    guarded: Field | None = None
    """Whether the guard gave another command than the wanted one; None: there is no guard."""

    @property
    def reward(self) -> Field:
        """Sum of the terms."""
        return sum(self.terms.values())

    @property
    def terminated(self) -> Field:
        """Whether the task ended the episode: it failed, or was won."""
        return self.failed if self.done is None else self.failed | self.done

    @property
    def ended(self) -> Field:
        """Whether this was the episode's last step."""
        return self.terminated | self.truncated

    @property
    def success(self) -> Field:
        """Whether the episode ended as a success: won, or, where it cannot be, reached when time was up."""
        return self.reached & self.ended


class Guard(Protocol):
    """A safety filter between a policy and the effectors of a spacecraft.

    It is a pure function over fields like everything in this module, so that it works in every engine. One
    that chooses by their values, and so cannot be traced or compiled, says so by a true attribute
    ``by_values``: engines then step without a generated program, on NumPy or torch.
    """

    def admitted(
        self, world: World, state: Any, goal: Any, command: Command
    ) -> tuple[Command, Field]:
        """Command that may be given in place of the wanted one, and whether it is another (bool).

        Args:
            world: what flies, with its task and its equations.
            state: state as the spacecraft's sensors measure it.
            goal: goal with the episode's data in its ``notes``.
            command: wanted command, one field per thruster.
        """
        ...


class Setup(NamedTuple):
    """What flies, which task, for how long, under which conditions, and what guards it."""

    craft: Spacecraft
    """Spacecraft."""
    task: Task
    """Task with its starts; agents are judged on those of ``task.for_evaluation()``."""
    timing: Timing = Timing()
    """Control period, accuracy and length of an episode."""
    conditions: Conditions | None = None
    """Randomization, disturbances, faults and sensors; None: everything is as designed."""
    guard: Guard | None = None
    """Safety filter between policy and effectors; None: every command is given."""


@dataclass(frozen=True)
class World:
    """Everything about episodes that does not change while they run."""

    setup: Setup
    nodes: int = NODES
    """Nodes of the quadrature in the plane (`rans.model.dynamics.advance`)."""

    def __post_init__(self) -> None:
        """Choose the substeps for what flies; under conditions for the quickest of 1,024 episodes' bodies."""
        setup = self.setup
        bodies = None
        torque = 0.0
        if setup.conditions is not None:
            steps = setup.timing.episode_steps
            bodies = examples(setup.conditions, setup.craft, steps).strongest()
            torque = setup.conditions.steady_torque
        timing = chosen(setup.craft, setup.timing, bodies, torque)
        object.__setattr__(self, "setup", setup._replace(timing=timing))
        # What a step reads of the craft is known beforehand: torch's compiler cannot trace cached properties.
        _ = (
            self.forces,
            self.remembered,
            self.craft.commands,
            self.craft.stores,
            self.craft.wheel_map,
        )

    @property
    def craft(self) -> Spacecraft:
        """Spacecraft of the setup."""
        return self.setup.craft

    @property
    def task(self) -> Task:
        """Task of the setup."""
        return self.setup.task

    @property
    def timing(self) -> Timing:
        """Timing of the setup, with a number of substeps."""
        return self.setup.timing

    @property
    def conditions(self) -> Conditions | None:
        """Conditions of the setup."""
        return self.setup.conditions

    def move(self, state: Any, step_inputs: StepInputs) -> tuple[Any, ...]:
        """States at the checks of one control period, by our equations; the last one is at its end."""
        body = step_inputs.body
        command = step_inputs.commands[0]
        pieces = None
        if step_inputs.lag is not None or step_inputs.failing is not None:
            pieces = step_inputs.pieces(self.craft, self.timing.control_period)
        return states_at_checks(
            state,
            self.craft,
            body,
            command,
            self.timing,
            self.task.drift,
            self.nodes,
            step_inputs.disturbance,
            pieces,
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
        change it; None: as designed. Effectors begin as the craft's ``stores`` say, unless the start has some.
        """
        still = (0,) * len(self.craft.commands)
        if self.craft.stores and not start.stores:
            start = replace(start, stores=tuple(store.initial for store in self.craft.stores))
        new = self.recalled(
            Episode(
                start,
                goal,
                body,
                past=(replace(start, stores=()),) * self._memory.states,
                clock=clock,
                commands=(still,) * self.remembered,
                violated=self._never(start, goal, clock),
            ),
            draws,
        )
        sensors = None if new.parameters is None else new.parameters.sensors
        if sensors is None or not sensors.repeats:
            return new
        return replace(new, reading=self.read(new, draws))

    @cached_property
    def forces(self) -> tuple[float, ...]:
        """Full force of each thruster, N."""
        return tuple(thruster.force for thruster in self.craft.thrusters)

    @cached_property
    def remembered(self) -> int:
        """How many commands an episode remembers."""
        return max(
            self._memory.felt, self._memory.obeyed, int(watches_switching(self.task, self.craft))
        )

    def _never(self, start: Any, goal: Any, clock: Field) -> Field | None:
        """What `Episode.violated` is at first."""
        if self.task.violation_ends or not self.task.constraints(start, goal):
            return None
        return clock * 0.0

    @cached_property
    def _memory(self) -> Memory:
        return Memory.of(self.conditions, self.timing.control_period)

    def recalled(self, episode: Episode, draws: Draws | None) -> Episode:
        """The episode with what it drew from its conditions, drawn again if it does not remember.

        Raises:
            ConfigError: there is nothing to draw with.
        """
        if self.conditions is None or episode.parameters is not None:
            return episode
        if draws is None:
            raise ConfigError(
                "what an episode meets is drawn by its seed and number: give `draws` with "
                "conditions."
            )
        return replace(
            episode,
            parameters=draw(
                self.conditions,
                self.craft,
                episode.body or Body.of(self.craft),
                self.timing.episode_steps,
                self.number(episode.clock, draws),
                draws,
            ),
        )

    def step_inputs(self, episode: Episode, command: Command, draws: Draws | None) -> StepInputs:
        """What moves the spacecraft while a command is held."""
        parameters = episode.parameters
        period = self.timing.control_period
        if parameters is None or draws is None:
            return StepInputs(episode.body or Body.of(self.craft), (command,))
        step = draws.real(self.timing.step(episode.clock))
        earlier = (
            tuple(map(draws.real, command)) for command in episode.commands[: self._memory.felt]
        )
        body, fails = parameters.flying(step * period)
        return StepInputs(
            body, (command, *earlier), parameters.lag, parameters.disturbance(step, period), fails
        )

    def sensed(self, episode: Episode, draws: Draws | None) -> Any:
        """The state as sensors tell it."""
        return episode.reading if episode.reading is not None else self.read(episode, draws)

    def read(self, episode: Episode, draws: Draws | None, last: Any = None) -> Any:
        """What sensors read anew; the last reading, if there was one, stands where they drop out."""
        parameters = episode.parameters
        if parameters is None or parameters.sensors is None or draws is None:
            return episode.state
        step = self.timing.step(episode.clock)
        time = draws.real(step) * self.timing.control_period
        return reading(
            (episode.state, *episode.past),
            parameters.sensors,
            lambda block: draws.random(self.craft.dimension, parameters.number, step * 16 + block),
            last,
            time,
        )


Mover = Callable[[Any, StepInputs], tuple[Any, ...]]
"""States at the checks of one control period, the last one at its end: `World.move`, or Drake."""


def step(
    world: World,
    episode: Episode,
    command: Command,
    draws: Draws | None = None,
    move: Mover | None = None,
) -> Outcome:
    """Hold the command, one number for each of the craft's ``commands``, for one control period.

    Under conditions it takes draws, and an episode with its parameters. By default our equations move.
    """
    task = world.task
    period = world.timing.control_period
    guarded: Field | None = None
    if world.setup.guard is not None:
        sensed = world.sensed(episode, draws)
        command, guarded = world.setup.guard.admitted(world, sensed, episode.goal, command)
    if episode.parameters is not None and episode.parameters.dwell is not None:
        count = len(world.craft.thrusters)
        before = [earlier[:count] for earlier in episode.commands]
        obeyed = episode.parameters.dwell.enforced(command[:count], before, period)
        command = (*obeyed, *command[count:])

    # Motion, and what is asked at every check.
    states = (move or world.move)(episode.state, world.step_inputs(episode, command, draws))
    state = states[-1]
    checked = _check_period(task, episode, states, period / world.timing.checks)
    goal = checked.goal
    lost = ~finite(*leaves(state))
    done = None if checked.done is None else checked.done & ~lost
    failed = task.failed(state, goal)
    if checked.done is not None:
        # What is won at a check is over: the rest of the period counts for nothing.
        failed = failed & ~checked.done
    failed = failed | lost
    if checked.violated is not None and task.violation_ends:
        failed = failed | checked.violated

    # The episode at the end of the period.
    clock = episode.clock + 1
    arrived = replace(
        episode,
        state=state,
        goal=goal,
        clock=clock,
        past=(replace(episode.state, stores=()), *episode.past)[: len(episode.past)],
        commands=(command, *episode.commands)[: len(episode.commands)],
    )
    if episode.reading is not None:
        arrived = replace(arrived, reading=world.read(arrived, draws, episode.reading))
    if episode.violated is not None:
        arrived = replace(arrived, violated=where(checked.violated, 1.0, episode.violated))

    # Reward and ends.
    transition = Transition(
        state,
        goal,
        command,
        episode.commands[0] if episode.commands else command,
        episode.state,
        period,
        world.forces,
    )
    reached = task.reached(state, goal) if done is None else done
    if arrived.violated is not None:
        reached = reached & (arrived.violated < 0.5)
    time_is_up = world.timing.step(clock) >= world.timing.episode_steps
    return Outcome(
        episode=arrived,
        command=command,
        terms=reward_terms(task, transition, done, checked.violated),
        failed=failed,
        done=done,
        truncated=time_is_up & ~(failed if done is None else failed | done),
        reached=reached & ~failed,
        margins=checked.margins,
        guarded=guarded,
    )


class _PeriodChecks(NamedTuple):
    """Result of the checks of one control period."""

    goal: Any
    """At the end of the period."""
    margins: dict[str, Field]
    """The least of each, until the episode was over."""
    violated: Field | None
    """Whether any was negative until then; None: the task has no constraints."""
    done: Field | None
    """Whether the mission was won before anything was violated that ends it; None: it cannot be won."""


def _check_period(
    task: Task, episode: Episode, states: tuple[Any, ...], apart: float
) -> _PeriodChecks:
    """Ask the task at every check of a control period, ``apart`` (s) from each other."""
    goal = episode.goal
    least: dict[str, Field] = {}
    violated: Field | None = None
    done: Field | None = None
    for state in states:
        goal = goal_after(task, goal, state, apart)
        margins = task.constraints(state, goal)
        won = task.done(state, goal)
        over = done
        if violated is not None and task.violation_ends:
            over = violated if over is None else over | violated
        if margins:
            now = reduce(operator.or_, (margin < 0.0 for margin in margins.values()))
            if over is None:
                least = margins if not least else _least(least, margins)
                violated = now if violated is None else violated | now
            else:
                # After the end of the episode nothing counts.
                smaller = _least(least, margins)
                least = {name: where(over, least[name], smaller[name]) for name in margins}
                violated = violated | (now & ~over)
        if won is not None:
            if violated is not None and task.violation_ends:
                won = won & ~violated
            done = won if done is None else done | won
    return _PeriodChecks(goal, least, violated, done)


def _least(one: dict[str, Field], other: dict[str, Field]) -> dict[str, Field]:
    return {name: where(other[name] < one[name], other[name], one[name]) for name in one}


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


class StepAndRestart(NamedTuple):
    """Result of one step and of the restart where an episode ended, in fields of any library."""

    after: Episode
    """The episode to act in next."""
    outcome: Outcome
    """Of the one that acted."""
    observation: tuple[Field, ...]
    """Of the episode to act in next."""
    final_observation: tuple[Field, ...]
    """Of the state arrived in."""


def step_and_restart(
    world: World, episode: Episode, command: Command, draws: Draws, plain: bool = False
) -> StepAndRestart:
    """`step` and, where an episode ended, `restart`.

    What is traced or compiled begins an episode everywhere in every step, and chooses; a ``plain`` step
    begins none as long as none ended.
    """
    remembers = episode.parameters is not None
    outcome = step(world, world.recalled(episode, draws), command, draws)
    restarts = not plain or bool(outcome.ended.any())
    after = restart(world, outcome, draws) if restarts else outcome.episode
    begins_with = world.observe(after, draws)
    final = world.observe(outcome.episode, draws)
    return StepAndRestart(
        after if remembers else replace(after, parameters=None), outcome, begins_with, final
    )
