"""Scenarios: where an episode starts and where it should end.

A scenario is a function of (seed, episode) alone: scenario 7 of seed 3 is the same in the fast engine, in
Drake and in an optimal control problem, on every device, however many spacecraft fly.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from rans.errors import ConfigError
from rans.model.dynamics import State
from rans.model.fields import leaves, map_leaves, unflatten
from rans.model.random import Draws, seed_words
from rans.model.spacecraft import Spacecraft
from rans.tasks.base import Task
from rans.tasks.derived import check_dimension
from rans.tasks.observation_terms import Dimension

EVALUATION_SEED = 2023
"""Scenarios that agents are judged on; no training should use them."""
SELECTION_SEED = 2024
"""Scenarios that decide when a training may end."""
TUNING_SEED = 2025
"""Scenarios that controllers without training are tuned on."""
FAILURES_SEED = 2027
"""Scenarios that trainings look for the agent's failures in, to begin episodes there."""
ASSURANCE_SEED = 2026
"""Scenarios that `rans assure` counts failures in: nobody was trained, selected, tuned or judged on them."""


@dataclass(frozen=True)
class Scenario:
    """Where an episode starts and where it should end.

    >>> from rans.scenario import scenario
    >>> one = scenario(rans.GoToPose(), 2, seed=3, episode=7)
    >>> one.goal.p
    Vec2(x=0.0, y=0.0)
    """

    start: State
    goal: State


def draws(seed: int, count: int, first: int = 0) -> Draws:
    """What episodes ``first`` to ``first + count - 1`` of a seed draw with.

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
    one = draws(seed, 1, episode)
    found = Scenario(*task.sample(one.random(dimension, one.first)))
    return map_leaves(lambda x: float(np.squeeze(x)), found)


def batch(scenarios: Sequence[Scenario]) -> Scenario:
    """Many scenarios as one whose fields are float64 arrays (N,)."""
    columns = zip(*map(leaves, scenarios), strict=True)
    return unflatten(scenarios[0], [np.array(column, dtype=np.float64) for column in columns])


def scenarios(task: Task, craft: Spacecraft, seed: int, count: int, first: int = 0) -> Scenario:
    """Scenarios ``first`` to ``first + count - 1`` of a seed as one batch of float64 arrays (N,).

    Raises:
        ConfigError: the task works in the other dimension alone, or the seed has more than 64 bits.
    """
    return sampled_scenarios(task, craft, draws(seed, count, first))


def sampled_scenarios(task: Task, craft: Spacecraft, own: Draws) -> Scenario:
    """The scenarios of N episodes with these random numbers, as one batch of float64 arrays (N,).

    Raises:
        ConfigError: see `rans.tasks.derived.check_dimension`.
    """
    check_dimension(task, craft.dimension)
    found = Scenario(*task.sample(own.random(craft.dimension, own.first)))
    return map_leaves(lambda x: np.full(len(own.first), x, np.float64), found)


def each(starts: Scenario) -> Iterator[Scenario]:
    """The scenarios of a batch, of floats."""
    for k in range(len(leaves(starts.start)[0])):
        yield map_leaves(lambda field, k=k: float(field[k]), starts)
