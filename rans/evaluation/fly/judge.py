"""Flights on all processors where one would take long: in Drake, and of controllers that are slow."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import as_completed
from dataclasses import replace
from typing import Any, Literal, NamedTuple

import numpy as np

from rans.flight import Controller, Flight, Setup, fly
from rans.model.fields import map_leaves
from rans.model.random import Draws
from rans.processes import deaths_told, submitted
from rans.scenario import drawn, draws

EngineName = Literal["fast", "drake"]

_SHARE = 64
"""Episodes a process flies at once in Drake: from here on more of them take no less time each."""
_SLOW_SHARE = 8
"""The same of a controller that says it is ``slow``, which takes its time for every episode."""


class Flown(NamedTuple):
    """N flights, and how their controller fared."""

    flight: Flight
    stopped: int
    """Times that the controller's solver found nothing; 0 of a controller without one."""


def flown(
    controller: Controller,
    setup: Setup,
    seed: int,
    episodes: int,
    engine: EngineName = "fast",
    workers: int | None = None,
    progress: Callable[[int], object] = lambda _: None,
    first: int = 0,
) -> Flown:
    """Fly from the task's starts; `RansError` if Drake refuses the mass properties, or a process died.

    Args:
        controller: can be pickled; one that is slow has a true attribute ``slow``.
        setup: what flies, what for and how long; with the starts to fly from.
        seed: of starts and goals; they are those of `rans.scenario.scenarios`.
        episodes: how many.
        engine: what computes the motion.
        workers: processes (see `rans.processes.submitted`); by default one per processor.
        progress: called with the number of episodes that were flown since the last call.
        first: number of the first episode of the seed.
    """
    slow = getattr(controller, "slow", False)
    share = _SLOW_SHARE if slow else _SHARE if engine == "drake" else episodes
    end = first + episodes
    jobs = [(seed, begin, min(share, end - begin)) for begin in range(first, end, share)]
    if len(jobs) == 1:
        only = _flown(controller, setup, engine, *jobs[0])
        progress(episodes)
        return only
    with submitted(
        _work,
        jobs,
        min(len(jobs), workers) if workers else None,
        _load,
        (controller, setup, engine),
    ) as futures:
        with deaths_told(f"flew {controller.name}"):
            for done in as_completed(futures):
                progress(done.result().flight.commands.shape[1])
        return _joined([future.result() for future in futures])


_given: list[Any] = []
"""Controller, setup and engine, in each worker process."""


def _load(*given: Any) -> None:
    import torch

    torch.set_num_threads(1)  # one process per processor
    _given[:] = given


def _work(seed: int, first: int, count: int) -> Flown:
    controller, setup, engine = _given
    return _flown(controller, setup, engine, seed, first, count)


def _flown(
    controller: Controller, setup: Setup, engine: EngineName, seed: int, first: int, count: int
) -> Flown:
    flight = fly_drawn(controller, setup, draws(seed, count, first), engine)
    return Flown(flight, getattr(controller, "failures", 0))


def fly_drawn(
    controller: Controller, setup: Setup, own: Draws, engine: EngineName = "fast"
) -> Flight:
    """The N episodes that draw like this, in this process; ``own.first`` are their numbers, (N,)."""
    craft, task, timing, conditions = setup
    starts = drawn(task, craft, own)
    if engine == "fast":
        return fly(craft, task, controller, starts, timing, conditions=conditions, draws=own)
    from rans.reference.flight import fly_in_drake

    return fly_in_drake(craft, task, controller, starts, timing, conditions=conditions, draws=own)


def _joined(parts: list[Flown]) -> Flown:
    """Flights of other episodes of the same task as one; episodes are the last axis of a field."""

    def join(*fields: Any) -> np.ndarray:
        return np.concatenate(fields, axis=-1)

    flights = [part.flight for part in parts]
    joined = replace(
        flights[0],
        states=map_leaves(join, *(f.states for f in flights)),
        goals=map_leaves(join, *(f.goals for f in flights)),
        commands=np.concatenate([f.commands for f in flights], axis=1),
    )
    return Flown(joined, sum(part.stopped for part in parts))
