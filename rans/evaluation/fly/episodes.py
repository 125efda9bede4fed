"""Flights of the episodes of a seed by any controller, on all processors if it is slow or flies in Drake."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import count, takewhile
from typing import Any, NamedTuple

import numpy as np

from rans.base.choices import EngineName
from rans.base.executors import chosen_executor
from rans.base.processes import Workers
from rans.base.progress import Progress, unseen
from rans.episode.flight import Controller, Flight, fly
from rans.episode.scenario import Endpoints, draws, sampled_scenarios
from rans.episode.step import Setup
from rans.fast.threads import one_thread
from rans.model.fields import map_leaves
from rans.model.random import Draws

_SHARE = 64
"""Number of episodes that a process flies at once in Drake: with more an episode takes no less time."""
_FAST_SHARE = 16384
"""Number of episodes of a fast controller in a job of an executor: an agent flies them in some seconds."""
_SLOW_SHARE = 8
"""Number of episodes that a process flies at once of a controller whose attribute ``slow`` is true."""


def fly_episodes(
    controller: Controller,
    setup: Setup,
    seed: int,
    episodes: int,
    engine: EngineName = "fast",
    workers: int | None = None,
    progress: Progress = unseen,
    first: int = 0,
    endpoints: Endpoints | None = None,
    parts: dict[int, Flight] | None = None,
) -> Flight:
    """Fly consecutive episodes of a seed.

    Args:
        controller: controller, which can be pickled; an attribute ``slow`` says that it is slow for every episode,
            or how many a process flies at once, and ``together`` that its commands belong to the numbers of
            episodes, which then fly in one process.
        setup: spacecraft, task with its starts, and timing.
        seed: seed of starts and goals, which are those of `rans.episode.scenario.scenarios`.
        episodes: number of episodes.
        engine: engine that computes the motion.
        workers: processes, by default one per processor; 1: this one (see `rans.base.processes.Workers`).
        progress: reports episodes.
        first: number of the first episode.
        endpoints: start and goal of all episodes, of which only the conditions differ; None: sampled ones.
        parts: receives flights as they end, for `so_far` after an interrupt.

    Raises:
        RansError: Drake refuses the mass properties, or a process died.
    """
    # Parts of the episodes; flights are the same however they are divided.
    slow = getattr(controller, "slow", False)
    at_once = episodes if chosen_executor() is None else min(episodes, _FAST_SHARE)
    episodes_in_part = slow or (_SHARE if engine == "drake" else at_once)
    if slow is True:
        episodes_in_part = _SLOW_SHARE
    if getattr(controller, "together", False):
        episodes_in_part = episodes
    end = first + episodes
    jobs = [
        (seed, begin, min(episodes_in_part, end - begin))
        for begin in range(first, end, episodes_in_part)
    ]
    pool = Workers(
        _Flyer,
        (controller, setup, engine, endpoints),
        1 if len(jobs) == 1 else workers,
        f"flew {controller.name}",
    )
    # Parts may end in any order.
    parts = {} if parts is None else parts
    for number, part in pool.finished(_Flyer.fly, jobs):
        parts[number] = part
        progress(part.commands.shape[1])
    return so_far(parts)


def so_far(parts: Mapping[int, Flight]) -> Flight:
    """The first episodes of `fly_episodes`, as many as have all ended, from its parts with the number 0."""
    first = [parts[k] for k in takewhile(parts.__contains__, count())]
    return _joined(first) if len(first) > 1 else first[0]


class _Flyer(NamedTuple):
    """A controller with its setup, in each process."""

    controller: Controller
    setup: Setup
    engine: EngineName
    endpoints: Endpoints | None

    def fly(self, seed: int, first: int, count: int) -> Flight:
        """Fly consecutive episodes of a seed."""
        own = draws(seed, count, first)
        with one_thread():
            return fly_draws(self.controller, self.setup, own, self.engine, self.endpoints)


def fly_draws(
    controller: Controller,
    setup: Setup,
    own: Draws,
    engine: EngineName = "fast",
    endpoints: Endpoints | None = None,
) -> Flight:
    """Fly the N episodes of given random numbers in this process.

    Args:
        controller: see `fly_episodes`.
        setup: see `fly_episodes`.
        own: random numbers of the episodes; ``own.first`` are the episodes' numbers, (N,).
        engine: engine that computes the motion.
        endpoints: see `fly_episodes`.
    """
    craft, task, timing, conditions, guard = setup
    starts = sampled_scenarios(task, craft, own)
    if endpoints is not None:
        starts = endpoints.applied(starts)
    fly_in_engine = fly
    if engine != "fast":
        from rans.reference.flight import fly_in_drake as fly_in_engine

    flight = fly_in_engine(
        craft, task, controller, starts, timing, conditions=conditions, draws=own, guard=guard
    )
    return replace(flight, first=int(own.first[0]))


def _joined(flights: list[Flight]) -> Flight:
    """Flights of several groups of episodes of a task as one; episodes are the last axis of a field.

    Groups must be of one task and in the order of their starts. Settings are those of the first.
    """

    def join(*fields: Any) -> np.ndarray:
        return np.concatenate(fields, axis=-1)

    return replace(
        flights[0],
        states=map_leaves(join, *(f.states for f in flights)),
        goals=map_leaves(join, *(f.goals for f in flights)),
        commands=np.concatenate([f.commands for f in flights], axis=1),
        margins={name: join(*(f.margins[name] for f in flights)) for name in flights[0].margins},
        done=None if flights[0].done is None else join(*(f.done for f in flights)),
        lengths=None if flights[0].lengths is None else join(*(f.lengths for f in flights)),
        guarded=None if flights[0].guarded is None else join(*(f.guarded for f in flights)),
        stopped=sum(f.stopped for f in flights),
    )
