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

from rans.model.accuracy import chosen
from rans.model.body import Body
from rans.model.dynamics import NODES, held
from rans.model.fields import Field, finite, leaves, map_leaves, where
from rans.model.random import Random
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from rans.model.trace import UNTRACEABLE, Symbol, depends
from rans.tasks.base import Task, observation, symbolic
from rans.tasks.rewards import Transition

Command = tuple[Field, ...]
"""One field per thruster."""


@dataclass(frozen=True)
class Episode:
    """What is known of N running episodes, or of one: states and goals are a `State` of fields each."""

    state: Any
    goal: Any
    """Of floats where the task's goal never varies."""
    clock: Field
    """int32: control periods since the episode's start in the low bits, and above them how many episodes of
    this environment came before. Their count wraps around."""
    previous: Command = ()
    """The last command; empty where the task's reward does not look at it."""
    body: Body | None = None
    """What flies: numbers, or fields where spacecraft differ; None: as designed."""

    def memory(self) -> list[Field]:
        """Every field that varies, in a fixed order: state, goal and body, clock, last command."""
        varying = (x for tree in (self.goal, self.body) for x in leaves(tree)
                   if x is not None and not isinstance(x, int | float))
        return [*leaves(self.state), *varying, self.clock, *self.previous]


@dataclass(frozen=True)
class Outcome:
    """What one control period gave, before any reset."""

    episode: Episode
    """As it arrived."""
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

    def __post_init__(self) -> None:
        object.__setattr__(self, "timing", chosen(self.craft, self.timing))

    def move(self, episode: Episode, command: Command) -> Any:
        """The state after the command was held for one control period, by our equations."""
        return held(episode.state, self.craft, episode.body or Body.of(self.craft), command, self.timing,
                    self.task.drift, self.nodes)

    def observe(self, episode: Episode) -> tuple[Field, ...]:
        """What a policy sees now."""
        return observation(self.task, episode.state, episode.goal)

    @property
    def step_mask(self) -> int:
        """Ones in the bits of a clock that hold its control periods."""
        return 2**self.timing.episode_steps.bit_length() - 1

    def next_episode(self, clock: Field) -> Field:
        """The clock at the start of the next episode."""
        return (clock | self.step_mask) + 1

    def number(self, clock: Field, numbers: tuple[Field, Any]) -> Field:
        """Number of the episode, for an environment whose numbers these are (`restart`)."""
        return numbers[0] + (clock >> self.step_mask.bit_length()) * numbers[1]

    def begin(self, seed: tuple[Field, Field], number: Field, dtype: Any) -> tuple[Any, Any]:
        """Start and goal of the episodes with these numbers, as fields of this floating dtype."""
        return self.task.sample(Random(self.craft.dimension, *seed, number, dtype))

    @cached_property
    def watches_switching(self) -> bool:
        """Whether the reward looks at the previous command, found by running it on symbols."""
        thrusters = range(len(self.craft.thrusters))
        command, previous = (tuple(Symbol.input(f"{name} {i}") for i in thrusters)
                             for name in ("command", "previous"))
        try:
            task, state, goal = symbolic(self.task, self.craft.dimension)
            terms = task.reward(Transition(state, goal, command, previous))
        except UNTRACEABLE:  # only torch or NumPy can follow this task, which may look at anything
            return True
        return depends(terms.values(), previous)


Mover = Callable[[Episode, Command], Any]
"""The state after a command was held for one control period: `World.move`, or Drake."""


def step(world: World, episode: Episode, command: Command, move: Mover | None = None) -> Outcome:
    """Hold the command, 0 (shut) to 1 (open) each, for one control period; by default our equations move."""
    task = world.task
    state = (move or world.move)(episode, command)
    goal = task.next_goal(episode.goal, state, world.timing.control_period)
    clock = episode.clock + 1
    terminated = task.failed(state, goal) | ~finite(*leaves(state))
    previous = command if episode.previous else ()
    return Outcome(
        episode=replace(episode, state=state, goal=goal, clock=clock, previous=previous),
        terms=task.reward(Transition(state, goal, command, episode.previous or command)),
        terminated=terminated,
        truncated=((clock & world.step_mask) >= world.timing.episode_steps) & ~terminated,
        reached=task.reached(state, goal))


def restart(world: World, outcome: Outcome, seed: tuple[Field, Field], numbers: tuple[Field, Any],
            dtype: Any) -> Episode:
    """The next episode where one ended, elsewhere the same.

    Seed (`rans.model.random.seed_words`) and number of an episode decide its start and goal, fields of this
    floating dtype. ``numbers`` are that of each environment's first episode, and how far it is from one of
    its episodes to the next.
    """
    ended, arrived = outcome.ended, outcome.episode
    clock = world.next_episode(arrived.clock)

    def chosen(new: Field, old: Field) -> Field:
        never_varies = new is old or isinstance(old, float)
        return old if never_varies else where(ended, new, old)

    begun = world.begin(seed, world.number(clock, numbers), dtype)
    state, goal = map_leaves(chosen, begun, (arrived.state, arrived.goal))
    return replace(arrived, state=state, goal=goal, clock=where(ended, clock, arrived.clock),
                   previous=tuple(where(ended, valve * 0, valve) for valve in arrived.previous))
