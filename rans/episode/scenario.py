"""Scenarios: start and goal of an episode.

A scenario is a function of (seed, episode) alone: scenario 7 of seed 3 is the same in the fast engine, in Drake and
in an optimal control problem, on every device and for any number of spacecraft.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rans.base.errors import ConfigError, brief
from rans.model.dynamics import State
from rans.model.fields import leaves, map_leaves, unflatten
from rans.model.random import Draws, seed_words
from rans.model.spacecraft import Spacecraft
from rans.tasks.base import Task
from rans.tasks.derived import check_dimension
from rans.tasks.observation_terms import Dimension

EVALUATION_SEED = 2023
"""Seed of evaluations; no training should use it."""
SELECTION_SEED = 2024
"""Seed of the selection of agents during training."""
TUNING_SEED = 2025
"""Seed on which controllers without training are tuned."""
ASSURANCE_SEED = 2026
"""Seed of `rans assure`, which training, selection, tuning and evaluation do not use."""

CHOICE_SEED = 2032
"""Seed of the flights that choose a value of an agent for any craft (`rans.evaluation.fly.choice`)."""

LARGEST = 1e9
"""Largest number of a start, goal or zone of a user's own, m, rad and s: the Moon is at 4e8 m, and the squares of
larger numbers near the end of single precision."""


@dataclass(frozen=True)
class Scenario:
    """Start and goal of an episode.

    >>> from rans.episode.scenario import scenario
    >>> one = scenario(rans.GoToPose(), 2, seed=3, episode=7)
    >>> one.goal.p
    Vec2(x=0.0, y=0.0)
    """

    start: State
    goal: State


@dataclass(frozen=True)
class Endpoints:
    """A start and a goal of a user's own, in place of those that a task samples.

    >>> from rans.episode.scenario import Endpoints
    >>> own = Endpoints(start=rans.state((3.0, 1.0), attitude=0.7))
    >>> sampled = rans.scenarios(rans.GoToPose(), rans.load_spacecraft("atmos"), 7, 2)
    >>> own.applied(sampled).start.p.x
    array([3., 3.])
    """

    start: State | None = None
    """State of floats, as `rans.state` makes it; None: the starts are sampled."""
    goal: State | None = None
    """State of floats; None: the goals are sampled."""

    def episodes(self, count: int, conditions: object | None) -> int:
        """Number of episodes that differ: 1 from one start without conditions, else ``count``."""
        return 1 if self.start is not None and conditions is None else count

    def applied(self, sampled: Scenario) -> Scenario:
        """The scenarios with this start and goal; deadlines and other notes of the task stay.

        Args:
            sampled: N sampled scenarios, with fields (N,).

        Raises:
            ConfigError: start or goal is no state, or one of another dimension than the scenarios.
        """
        start = sampled.start
        goal = sampled.goal
        if self.goal is not None:
            goal = _placed("goal", self.goal, goal)
        return Scenario(start if self.start is None else _placed("start", self.start, start), goal)


def draws(seed: int, count: int, first: int = 0) -> Draws:
    """Random numbers of episodes ``first`` to ``first + count - 1`` of a seed.

    Raises:
        ConfigError: the seed has more than 64 bits.
    """
    return Draws(*seed_words(seed), np.arange(first, first + count, dtype=np.int32), 0, np.float64)


def scenario(task: Task, dimension: Dimension, seed: int, episode: int) -> Scenario:
    """Scenario number ``episode`` of a seed, as float64 numbers.

    Raises:
        ConfigError: the seed has more than 64 bits or the episode more than 31.
    """
    if not 0 <= episode < 2**31:
        raise ConfigError(
            f"the episode must be a whole number from 0 to {2**31 - 1}, got {episode}."
        )
    source = draws(seed, 1, episode)
    sampled = Scenario(*task.sample(source.random(dimension, source.first)))
    return map_leaves(lambda x: float(np.squeeze(x)), sampled)


def batch(scenarios: Sequence[Scenario]) -> Scenario:
    """N scenarios as one with float64 arrays (N,)."""
    columns = zip(*map(leaves, scenarios), strict=True)
    return unflatten(scenarios[0], [np.array(column, dtype=np.float64) for column in columns])


def scenarios(task: Task, craft: Spacecraft, seed: int, count: int, first: int = 0) -> Scenario:
    """Scenarios ``first`` to ``first + count - 1`` of a seed as one batch of float64 arrays (N,).

    >>> starts = rans.scenarios(rans.GoToPose(), rans.load_spacecraft("atmos"), seed=7, count=2)
    >>> len(starts.start.p.x)
    2

    Raises:
        ConfigError: the task is for the other dimension only, or the seed has more than 64 bits.
    """
    return sampled_scenarios(task, craft, draws(seed, count, first))


def sampled_scenarios(task: Task, craft: Spacecraft, draws: Draws) -> Scenario:
    """Scenarios of N episodes with these random numbers, as one batch of float64 arrays (N,).

    Raises:
        ConfigError: the task is for the other dimension only.
    """
    check_dimension(task, craft.dimension)
    sampled = Scenario(*task.sample(draws.random(craft.dimension, draws.first)))
    return map_leaves(lambda x: np.full(len(draws.first), x, np.float64), sampled)


def _placed(what: str, value: object, sampled: State) -> State:
    """A state repeated for N episodes, with the notes and stores of the sampled states."""
    if type(value) is not type(sampled):
        dimension = len(sampled.p.columns())
        raise ConfigError(
            f"the {what} must be a state of {dimension} dimensions, as rans.state((...)) makes it, "
            f"got {brief(value)}."
        )
    count = np.shape(leaves(sampled)[0])
    motion = replace(value, notes=None, stores=())
    if not (np.abs(leaves(motion)) <= LARGEST).all():
        raise ConfigError(
            f"the {what} must be of finite numbers of at most {LARGEST:g} (m, rad, s), got {brief(value)}."
        )
    repeated = map_leaves(lambda x: np.full(count, float(x)), motion)
    return replace(repeated, notes=sampled.notes, stores=sampled.stores)


def each(starts: Scenario) -> Iterator[Scenario]:
    """Yield the scenarios of a batch, with floats."""
    for k in range(len(leaves(starts.start)[0])):
        yield map_leaves(lambda field, k=k: float(field[k]), starts)
