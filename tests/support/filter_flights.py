"""Commands and observations of spacecraft whose filters are tested."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from rans_estimation.filter_bank import Filters
from rans_estimation.kalman_filter import Filter

from rans import Spacecraft, Timing
from rans.episode.scenario import draws, scenarios
from rans.episode.step import Episode, World, step
from rans.fast.learn.config import FilterSettings, PPOSettings
from rans.tasks.base import Task
from rans.tasks.derived import layout

COUNT = 48
SEED = 5
TIMING = Timing()


def commands(craft: Spacecraft, often: float, seed: int = 1) -> Any:
    """Of every step: random ones, each thruster open so often."""
    random = np.random.default_rng(seed)
    while True:
        yield tuple((random.random((len(craft.thrusters), COUNT)) < often).astype(float))


def in_body(craft: Spacecraft, task: Task, columns: Sequence[Any]) -> list[np.ndarray]:
    seen = layout(task, craft.dimension).in_body(columns)
    return [np.broadcast_to(np.asarray(x, float), COUNT) for x in seen]


def followed(
    world: World, filters: Filter, given: Any
) -> Iterator[tuple[Episode, list[np.ndarray], list[Any]]]:
    """Yield the episode at every step of a flight, what is read of it and what the filter remembered before."""
    craft, task = world.craft, world.task
    body = layout(task, craft.dimension).body
    own = draws(SEED, COUNT)
    chosen = scenarios(task, craft, SEED, COUNT)
    now = world.begin(chosen.start, chosen.goal, 0, own)
    memory: list[Any] = [np.zeros(COUNT)] * filters.width(body)
    for command in given:
        read = in_body(craft, task, world.observe(now, own))
        yield now, read, memory
        memory = filters.next_memory(body, read, memory, command)
        now = step(world, now, command, own).episode


def made(craft: Spacecraft, task: Task, drift: float, response: float = 0.0) -> Filter:
    """One filter of a bank."""
    (one,) = bank(craft, task, (drift,), (response,)).each
    return one


def bank(
    craft: Spacecraft,
    task: Task,
    drift: tuple[float, ...],
    response: tuple[float, ...] = (),
    period: float = TIMING.control_period,
) -> Filters:
    settings = PPOSettings(filters=FilterSettings(drift, response))
    return Filters.of(craft, task, layout(task, craft.dimension), period, settings)
