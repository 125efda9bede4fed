"""Episodes and the step function that the engine, kernels, environments, flights and Drake share.

Everything is a pure function over fields (`rans.model.fields`) without branches, so that the same source steps one
spacecraft of numbers, a batch of NumPy or torch, and the symbols of a GPU kernel. Drivers differ in the function
that moves the spacecraft (the equations of RANS, or Drake) and in how the next episode begins. An operation in
another order changes every recorded flight (`tests/test_recorded.py`).
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial, reduce
from typing import Any, NamedTuple, Protocol

from rans.base.errors import ConfigError
from rans.effectors.motion import states_at_checks
from rans.model.accuracy import FARTHEST, chosen
from rans.model.body import Body
from rans.model.dynamics import NODES, advance
from rans.model.fields import Field, absolute, finite, leaves, map_leaves, where
from rans.model.random import Draws
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from rans.randomization.conditions import Conditions
from rans.randomization.memory import Memory
from rans.randomization.parameters import (
    EpisodeParameters,
    StepInputs,
    draw,
    examples,
    scaled,
)
from rans.randomization.sensors import reading
from rans.tasks.base import Task, goal_after, observation, reward_terms
from rans.tasks.derived import watches_switching
from rans.tasks.rewards import Transition

Command = tuple[Field, ...]
"""One field per command of the craft (`rans.model.spacecraft.Spacecraft.commands`)."""


@dataclass(frozen=True)
class Episode:
    """Data of one running episode, or of N."""

    state: Any
    """State of the spacecraft, a `State` of fields."""
    goal: Any
    """Goal, a `State` of fields, or of floats if the task's goal never varies."""
    body: Body | None = None
    """Body before conditions change it, of numbers, or of fields where spacecraft differ; None: as designed."""
    parameters: EpisodeParameters | None = None
    """Parameters drawn from the conditions; None: there are none, or they are drawn again in every step."""
    past: tuple[Any, ...] = ()
    """Earlier states, the newest first, for delayed readings."""
    reading: Any = None
    """Last reading of the sensors, where it may be kept; None: not stored."""
    clock: Field = 0
    """Clock, int32: control periods since the start of the episode in the low bits, and in the high bits the number
    of earlier episodes of this environment, which wraps around."""
    commands: tuple[Command, ...] = ()
    """Last commands, the newest first, as far as delayed valves or the reward need them."""
    violated: Field | None = None
    """1 where a constraint was violated before, else 0; None: there are none, or a violation ends the episode."""

    def memory(self) -> list[Field]:
        """Fields that vary, in the order of definition."""
        return [x for x in leaves(self) if not isinstance(x, int | float)]


@dataclass(frozen=True)
class Outcome:
    """Result of one control period, before any restart."""

    episode: Episode
    """Episode at the end of the period."""
    command: Command
    """Command that the effectors received."""
    terms: dict[str, Field]
    """Reward terms by name."""
    failed: Field
    """Whether the task failed, a violated constraint ends the episode, or the state was lost."""
    lost: Field
    """Whether the state left every path that a craft can take, or is not finite; the episode ended before that."""
    done: Field | None
    """Whether the mission succeeded before any failure; None: the task lasts until it is truncated."""
    truncated: Field
    """Whether the time is up and nothing else ended the episode in this step."""
    reached: Field
    """Whether every error is within its tolerance; for a mission that can succeed, whether it did.

    False where the episode failed, or a constraint was violated.
    """
    margins: dict[str, Field]
    """Least value of each margin of `Task.constraints` over the checks of the period, until the episode ended."""
    guarded: Field | None = None
    """Whether the guard replaced the command; None: there is no guard."""

    @property
    def reward(self) -> Field:
        """Reward: sum of the terms."""
        return sum(self.terms.values())

    @property
    def terminated(self) -> Field:
        """Whether the task ended the episode by failure or success."""
        return self.failed if self.done is None else self.failed | self.done

    @property
    def ended(self) -> Field:
        """Whether this was the last step of the episode."""
        return self.terminated | self.truncated

    @property
    def at_goal(self) -> Field:
        """Whether the episode ended at its goal: the mission succeeded, or the last state is within tolerances."""
        return self.reached & self.ended


class Guard(Protocol):
    """A safety filter between a policy and the effectors of a spacecraft.

    It is a pure function over fields, so that it works in every engine. A guard that branches on values, and thus
    cannot be traced or compiled, has a true attribute ``by_values``; engines then step without a generated program,
    on NumPy or torch. One with an attribute ``delay``, s, above 0 has a further argument ``before``: the commands
    of earlier control periods that may still be queued, the latest first.
    """

    def admitted(
        self, world: World, state: Any, goal: Any, command: Command
    ) -> tuple[Command, Field]:
        """Safe command in place of the desired one, and whether it differs from it (bool).

        Args:
            world: spacecraft, task and equations of motion.
            state: measured state.
            goal: goal with the episode's data in its ``notes``.
            command: desired command, one field per command of the craft.
        """
        ...


class Setup(NamedTuple):
    """Spacecraft, task, timing, conditions and guard of episodes."""

    craft: Spacecraft
    """Spacecraft."""
    task: Task
    """Task with its starts; ``task.for_evaluation()`` has the starts of evaluations."""
    timing: Timing = Timing()
    """Control period, substeps, checks and length of an episode."""
    conditions: Conditions | None = None
    """Domain randomization, disturbances, faults and sensors of the episodes; None: everything is nominal."""
    guard: Guard | None = None
    """Safety filter between policy and effectors; None: every command is executed."""


@dataclass(frozen=True)
class World:
    """Setup of episodes with derived data, constant while episodes run."""

    setup: Setup
    nodes: int = NODES
    """Nodes of the quadrature in the plane (`rans.model.dynamics.advance`)."""

    def __post_init__(self) -> None:
        """Choose the substeps; under conditions for the largest accelerations in 1,024 episodes."""
        setup = self.setup
        period = setup.timing.control_period
        for effector in setup.craft.further_effectors:
            effector.check_flight(setup.craft, setup.task.drift, period, setup.conditions)
        bodies = None
        torque = 0.0
        if setup.conditions is not None:
            steps = setup.timing.episode_steps
            bodies = examples(setup.conditions, setup.craft, steps).strongest()
            torque = setup.conditions.steady_torque
        timing = chosen(setup.craft, setup.timing, bodies, torque)
        object.__setattr__(self, "setup", setup._replace(timing=timing))
        # Computed here because the compiler of torch cannot trace cached properties.
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
        """Timing of the setup, with the number of substeps chosen."""
        return self.setup.timing

    @property
    def conditions(self) -> Conditions | None:
        """Conditions of the setup."""
        return self.setup.conditions

    def move(
        self, state: Any, step_inputs: StepInputs, integrate: Callable[..., Any] = advance
    ) -> tuple[Any, ...]:
        """States at the checks of a control period by the equations of motion; the last one is at its end.

        Args:
            state: state at the start of the period.
            step_inputs: command, body and disturbance.
            integrate: replaces `rans.model.dynamics.advance`, for programs that are printed.
        """
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
            self.task.drift if step_inputs.drift is None else step_inputs.drift,
            self.nodes,
            step_inputs.disturbance,
            pieces,
            integrate,
        )

    def observe(self, episode: Episode, draws: Draws | None = None) -> tuple[Field, ...]:
        """Columns of the observation of an episode."""
        return observation(self.task, self.sensed(episode, draws), episode.goal)

    def number(self, clock: Field, draws: Draws) -> Field:
        """Number of the episode at a clock; with the seed it determines all draws."""
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
        """New episode from a start to a goal.

        Args:
            start: state at the start; without stores, those of the effectors take their initial values.
            goal: goal at the start.
            clock: clock as in `Episode`.
            draws: seed of the random numbers; needed under conditions.
            body: body before conditions change it; None: see `Episode`.

        Raises:
            ConfigError: there are conditions and no ``draws``.
        """
        # As if the craft had been at the start for ever, with all valves shut.
        still = (0,) * self.craft.command_count
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
        # Sensors that repeat readings need a first one.
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
        """Number of last commands that an episode stores: the most that lag, faults, guard and reward look back.

        Too few would read past the end of `Episode.commands`; more cost memory in every kernel.
        """
        delay = getattr(self.setup.guard, "delay", 0.0)
        queued = math.ceil(delay / self.timing.control_period - 1e-9)
        return max(
            self._memory.felt,
            self._memory.obeyed,
            queued,
            int(watches_switching(self.task, self.craft)),
        )

    def _never(self, start: Any, goal: Any, clock: Field) -> Field | None:
        """Initial value of `Episode.violated`."""
        if self.task.violation_ends or not self.task.constraints(start, goal):
            return None
        return clock * 0.0

    @cached_property
    def _memory(self) -> Memory:
        return Memory.of(self.conditions, self.timing.control_period)

    def recalled(self, episode: Episode, draws: Draws | None) -> Episode:
        """The episode with its parameters, which are drawn again if it does not store them.

        Raises:
            ConfigError: there are conditions and no ``draws``.
        """
        if self.conditions is None or episode.parameters is not None:
            return episode
        if draws is None:
            raise ConfigError(
                "the parameters of an episode are drawn by its seed and number: give `draws` with "
                "conditions."
            )
        number = self.number(episode.clock, draws)
        base = episode.body or Body.of(self.craft)
        return replace(
            episode,
            parameters=draw(
                self.conditions, self.craft, base, self.timing.episode_steps, number, draws
            ),
        )

    def step_inputs(self, episode: Episode, command: Command, draws: Draws | None) -> StepInputs:
        """Body, commands and disturbances of a control period in which a command is held.

        Draws depend on the number of the step, so that an episode that goes on from a stored state draws the same.
        """
        parameters = episode.parameters
        period = self.timing.control_period
        drift = self.task.drift_at(episode.goal)
        if parameters is None or draws is None:
            return StepInputs(episode.body or Body.of(self.craft), (command,), drift=drift)
        step = draws.real(self.timing.step(episode.clock))
        earlier = (
            tuple(map(draws.real, command)) for command in episode.commands[: self._memory.felt]
        )
        body, fails = parameters.flying(step * period)
        factors = parameters.thrust_factors(self.timing.step(episode.clock), draws)
        if factors is not None:
            body = scaled(body, factors)
            if fails is not None:
                fails = replace(fails, body=scaled(fails.body, factors))
        return StepInputs(
            body,
            (command, *earlier),
            parameters.lag,
            parameters.disturbance(step, period),
            fails,
            drift,
        )

    def sensed(self, episode: Episode, draws: Draws | None) -> Any:
        """Measured state of the episode."""
        return episode.reading if episode.reading is not None else self.read(episode, draws)

    def read(self, episode: Episode, draws: Draws | None, last: Any = None) -> Any:
        """New reading of the sensors; the last reading, if there is one, is kept where they drop out.

        Each step has 16 blocks of random numbers: sensors may not take more, or steps would share them.
        """
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
"""Function to the states at the checks of a control period, the last one at its end: `World.move`, or Drake."""


def step(
    world: World,
    episode: Episode,
    command: Command,
    draws: Draws | None = None,
    move: Mover | None = None,
    rewarded: bool = True,
) -> Outcome:
    """Hold a command for one control period, then evaluate reward and ends of the episode.

    Args:
        world: setup of the episodes.
        episode: episode; under conditions with its parameters (`World.recalled`).
        command: one field per command of the craft.
        draws: seed of the random numbers; needed under conditions.
        move: function that moves the spacecraft; None: `World.move`.
        rewarded: whether to evaluate the terms of the reward, which the outcome otherwise lacks.
    """
    task = world.task
    period = world.timing.control_period
    guarded: Field | None = None
    if world.setup.guard is not None:
        sensed = world.sensed(episode, draws)
        queued: dict[str, Any] = {}
        if getattr(world.setup.guard, "delay", 0.0):
            queued["before"] = episode.commands
        command, guarded = world.setup.guard.admitted(
            world, sensed, episode.goal, command, **queued
        )
    if episode.parameters is not None and episode.parameters.dwell is not None:
        count = world.craft.thruster_count
        before = [earlier[:count] for earlier in episode.commands]
        obeyed = episode.parameters.dwell.enforced(command[:count], before, period)
        command = (*obeyed, *command[count:])

    # Motion, and constraints, memory and success at every check.
    states = (move or world.move)(episode.state, world.step_inputs(episode, command, draws))
    state = states[-1]
    checked = _check_period(task, episode, states, period / world.timing.checks)
    goal = checked.goal

    # A state that no craft reaches ends the episode where it was a period earlier.
    lost = ~finite(*leaves(state)) | _is_off_its_path(episode.state, state, period)
    state = map_leaves(partial(where, lost), episode.state, state)
    if goal is not episode.goal:
        goal = map_leaves(
            lambda old, new: new if new is old or isinstance(new, float) else where(lost, old, new),
            episode.goal,
            goal,
        )
    done = None if checked.done is None else checked.done & ~lost
    failed = task.failed(state, goal)
    if checked.done is not None:
        # A success at a check ends the episode; the rest of the period is ignored.
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
        terms=reward_terms(task, transition, done, checked.violated) if rewarded else {},
        failed=failed,
        lost=lost,
        done=done,
        truncated=time_is_up & ~(failed if done is None else failed | done),
        reached=reached & ~failed,
        margins=checked.margins,
        guarded=guarded,
    )


def _is_off_its_path(before: Any, after: Any, period: float) -> Field:
    """Whether a state is one that no accepted craft reaches from another in a control period, s.

    Its way differs from that at its final velocity by ten times as much as that of the fastest craft that is
    accepted (`rans.model.accuracy.FARTHEST`), which leaves room for disturbances and orbits. The rule is the same
    for every craft and in every engine.
    """
    columns = zip(before.p.columns(), after.p.columns(), after.v.columns(), strict=True)
    return (
        reduce(operator.add, (absolute(q - p - v * period) for p, q, v in columns))
        > 10.0 * FARTHEST
    )


class _PeriodChecks(NamedTuple):
    """Result of the checks of one control period."""

    goal: Any
    """Goal at the end of the period."""
    margins: dict[str, Field]
    """Least value of each margin until the end of the episode."""
    violated: Field | None
    """Whether any margin was negative until then; None: the task has no constraints."""
    done: Field | None
    """Whether the mission succeeded before a violation that ends it; None: the task has no success."""


def _check_period(
    task: Task, episode: Episode, states: tuple[Any, ...], apart: float
) -> _PeriodChecks:
    """Evaluate goal, constraints and success at every check of a control period, ``apart`` (s) from each other."""
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
                # Margins after the end of the episode are ignored.
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
    """Next episode where one has ended, elsewhere the same episode.

    It computes both everywhere and chooses, since nothing may branch; printed programs move the draws to where an
    episode ended.
    """
    ended = outcome.ended
    arrived = outcome.episode

    def choose(new: Field, old: Field) -> Field:
        never_varies = new is old or isinstance(old, int | float)
        return old if never_varies else where(ended, new, old)

    clock = world.timing.next_episode(arrived.clock)
    begun = world.begin(*world.scenario(clock, draws), clock, draws, arrived.body)
    return map_leaves(choose, begun, arrived)


class StepAndRestart(NamedTuple):
    """Result of a step and of the restart where an episode ended."""

    after: Episode
    """Episode of the next step."""
    outcome: Outcome
    """Outcome of this step."""
    observation: tuple[Field, ...]
    """Observation of the episode of the next step."""
    final_observation: tuple[Field, ...]
    """Observation at the end of this step, before a restart."""


def step_and_restart(
    world: World, episode: Episode, command: Command, draws: Draws, plain: bool = False
) -> StepAndRestart:
    """`step` and, where an episode has ended, `restart`.

    Traced and compiled programs begin an episode everywhere in every step and then select; a ``plain`` step begins
    episodes only if one has ended.
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
