"""One control period of many episodes at once, as a pure function over fields.

Dynamics, named reward terms, termination, truncation, final observation, automatic reset and next
observation are one expression without branches, so that it compiles into one kernel.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from rans.model.body import Body
from rans.model.dynamics import NODES, held
from rans.model.fields import Field, leaves, map_leaves, where
from rans.model.random import Random
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from rans.tasks.base import Task, observation


@dataclass(frozen=True)
class Episodes:
    """What the engine remembers of N running episodes."""

    state: Any
    """`State` of fields (N,)."""
    goal: Any
    """`State` of fields (N,), or of floats where the task's goal never varies."""
    clock: Field
    """int32: control periods since the episode's start in the low bits, and above them how many episodes of
    this environment came before. Their count wraps around."""
    previous: tuple[Field, ...] = ()
    """The last command, one field per thruster, int8; empty where the task does not look at it."""

    def memory(self) -> list[Field]:
        """Every field that varies, in a fixed order: state and goal, clock, last command."""
        goal = (x for x in leaves(self.goal) if not isinstance(x, float))
        return [*leaves(self.state), *goal, self.clock, *self.previous]


@dataclass(frozen=True)
class Outcome:
    """What one control period gave, before any reset where it matters."""

    observation: tuple[Field, ...]
    """Of the next state to act in: the first of a new episode where the old one ended."""
    final_observation: tuple[Field, ...]
    """Of the state arrived in."""
    terms: dict[str, Field]
    """Reward by name."""
    reward: Field
    """Sum of the terms."""
    terminated: Field
    """The task failed."""
    truncated: Field
    """Time is up, and the task did not fail in the same step."""
    reached: Field
    """Every error is within the task's tolerance."""


@dataclass(frozen=True)
class Simulation:
    """Everything about the episodes that does not change while they run."""

    craft: Spacecraft
    task: Task
    timing: Timing
    dtype: Any
    """Floating dtype of the fields, of their library."""
    body: Body
    """Numbers, or fields (N,)."""
    nodes: int = NODES
    """Of the quadrature in the plane (`rans.model.dynamics.advance`)."""

    @property
    def step_mask(self) -> int:
        """Ones in the bits of a clock that hold its control periods."""
        return 2**self.timing.episode_steps.bit_length() - 1

    def next_episode(self, clock: Field) -> Field:
        """The clock at the start of the next episode."""
        return (clock | self.step_mask) + 1

    def number(self, clock: Field, numbers: tuple[Field, Any]) -> Field:
        """Number of the episode, for an environment whose numbers these are (`step`)."""
        first, stride = numbers
        return first + (clock >> self.step_mask.bit_length()) * stride

    def begin(self, seed: tuple[Field, Field], number: Field) -> tuple[Any, Any]:
        """Start and goal of the episodes with these numbers."""
        return self.task.sample(Random(self.craft.dimension, *seed, number, self.dtype))

    def move(self, state: Any, command: tuple[Field, ...]) -> Any:
        """The state after the command was held for one control period."""
        return held(state, self.craft, self.body, command, self.timing, nodes=self.nodes)

    def step(self, episodes: Episodes, command: tuple[Field, ...], seed: tuple[Field, Field],
             numbers: tuple[Field, Any]) -> tuple[Episodes, Outcome]:
        """Hold the command for one control period; start anew where an episode ended.

        Args:
            episodes: as they run.
            command: one field per thruster, 0 (shut) to 1 (open).
            seed: its two words (`rans.scenario.seed_words`).
            numbers: the number of each environment's first episode, and how far from one of its episodes to
                the next. With the seed an episode's number decides start and goal.
        """
        task, goal = self.task, episodes.goal
        state = self.move(episodes.state, command)
        clock = episodes.clock + 1
        terms = task.reward(state, goal, command, episodes.previous or command)
        terminated = task.failed(state, goal)
        truncated = ((clock & self.step_mask) >= self.timing.episode_steps) & ~terminated
        ended = terminated | truncated
        arrived = Episodes(state, goal, clock, command if episodes.previous else ())
        after = self._restart(ended, arrived, seed, numbers)
        return after, Outcome(
            observation=observation(task, after.state, after.goal),
            final_observation=observation(task, state, goal),
            terms=terms,
            reward=sum(terms.values()),
            terminated=terminated,
            truncated=truncated,
            reached=task.reached(state, goal),
        )

    def _restart(self, ended: Field, arrived: Episodes, seed: tuple[Field, Field],
                 numbers: tuple[Field, Any]) -> Episodes:
        """Where an episode ended, the next one."""
        clock = self.next_episode(arrived.clock)
        start, goal = self.begin(seed, self.number(clock, numbers))
        choose = lambda new, old: old if new is old else where(ended, new, old)  # noqa: E731
        return Episodes(
            state=map_leaves(choose, start, arrived.state),
            goal=map_leaves(lambda new, old: old if isinstance(old, float) else choose(new, old),
                            goal, arrived.goal),
            clock=where(ended, clock, arrived.clock),
            previous=tuple(where(ended, valve * 0, valve) for valve in arrived.previous),
        )
