"""Scenarios: where an episode starts and where it should end.

A scenario is a function of (seed, episode) alone: scenario 7 of seed 3 is the same in the fast engine, in
Drake and in an optimal control problem, on every device, however many spacecraft fly.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rans.errors import ConfigError
from rans.model.dynamics import State
from rans.model.fields import leaves, map_leaves, unflatten
from rans.model.random import Draws, seed_words
from rans.model.spacecraft import Spacecraft
from rans.tasks.base import Task
from rans.tasks.sight import Dimension

EVALUATION_SEED = 2023
"""Scenarios that agents are judged on; no training should use them."""
SELECTION_SEED = 2024
"""Scenarios that decide when a training may end."""


@dataclass(frozen=True)
class Scenario:
    """Where an episode starts and where it should end."""

    start: State
    goal: State
    draws: Draws | None = dataclasses.field(default=None, compare=False)
    """What else the episode draws with, under conditions; None: nothing can be drawn."""


def scenario(task: Task, dimension: Dimension, seed: int, episode: int) -> Scenario:
    """Scenario number ``episode`` of a seed, as float64 numbers.

    Raises:
        ConfigError: the seed has more than 64 bits or the episode more than 31.
    """
    if not 0 <= episode < 2**31:
        raise ConfigError(f"the episode must be a whole number from 0 to {2**31 - 1}, got {episode}.")
    draws = _draws(seed, np.array([episode], dtype=np.int32))
    start, goal = task.sample(draws.random(dimension, draws.first))
    start, goal = (map_leaves(lambda x: float(np.squeeze(x)), s) for s in (start, goal))
    return Scenario(start, goal, draws)


def batch(scenarios: Sequence[Scenario]) -> Scenario:
    """Many scenarios as one whose fields are float64 arrays (N,)."""
    def stack(states: Sequence[State]) -> State:
        columns = zip(*map(leaves, states), strict=True)
        return unflatten(states[0], [np.array(column, dtype=np.float64) for column in columns])

    return Scenario(stack([one.start for one in scenarios]), stack([one.goal for one in scenarios]),
                    _together([one.draws for one in scenarios]))


def _together(draws: Sequence[Draws | None]) -> Draws | None:
    """What many draw with, if all can, as arrays (N,)."""
    rows = [np.broadcast_arrays(one.low, one.high, one.first) for one in draws if one is not None]
    if len(rows) < len(draws):
        return None
    low, high, first = (np.concatenate(column).astype(np.int32) for column in zip(*rows, strict=True))
    return Draws(low, high, first, 0, np.float64)


def scenarios(task: Task, craft: Spacecraft, seed: int, count: int, first: int = 0) -> Scenario:
    """Scenarios ``first`` to ``first + count - 1`` of a seed as one batch of float64 arrays (N,)."""
    draws = _draws(seed, np.arange(first, first + count, dtype=np.int32))
    start, goal = map_leaves(lambda x: np.full(count, x, np.float64), task.sample(
        draws.random(craft.dimension, draws.first)))
    return Scenario(start, goal, draws)


def _draws(seed: int, numbers: np.ndarray) -> Draws:
    return Draws(*seed_words(seed), numbers, 0, np.float64)
