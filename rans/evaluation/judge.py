"""Any contestant flown in Drake, on all processors."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import as_completed
from concurrent.futures.process import BrokenProcessPool
from typing import Any

import numpy as np

from rans.errors import RansError
from rans.evaluation.agent import LoadedRun
from rans.evaluation.contestants import contestant
from rans.evaluation.protocols import ProtocolName
from rans.fields import map_leaves
from rans.flight import Flight, scenarios
from rans.processes import submitted
from rans.reference.flight import fly_in_drake

_SHARE = 64
"""Episodes a process flies at once: from here on more of them take no less time each."""

_runs: list[LoadedRun] = []
"""The contestant, in each worker process."""


def fly_contestant_in_drake(spec: str, seed: int, episodes: int, workers: int | None = None,
                            progress: Callable[[int], object] = lambda _: None,
                            protocol: ProtocolName = "own") -> Flight:
    """Fly a contestant from its task's evaluation starts, moved by Drake.

    Args:
        spec: see `contestant`.
        seed: of starts and goals; they are those of `rans.flight.scenarios`.
        episodes: how many, from episode 0 of the seed on.
        workers: processes (see `rans.processes.submitted`); by default one per processor.
        progress: called with the number of episodes that were flown since the last call.
        protocol: see `contestant`.

    Raises:
        ConfigError: see `contestant`; or Drake refuses the spacecraft's mass properties.
        RansError: a worker process died.
    """
    jobs = [(seed, first, min(_SHARE, episodes - first)) for first in range(0, episodes, _SHARE)]
    with submitted(_fly, jobs, min(len(jobs), workers) if workers else None, _load,
                   (spec, protocol)) as futures:
        try:
            for done in as_completed(futures):
                progress(done.result().commands.shape[1])
        except BrokenProcessPool as error:
            raise RansError("a process that flew in Drake died; the usual cause is too little "
                            "memory.") from error
        return _joined([future.result() for future in futures])


def _load(spec: str, protocol: ProtocolName) -> None:
    import torch

    torch.set_num_threads(1)  # one process per processor
    _runs[:] = [contestant(spec, protocol)]


def _fly(seed: int, first: int, count: int) -> Flight:
    controller, craft, task, timing = _runs[0]
    task = task.for_evaluation()
    return fly_in_drake(craft, task, controller, scenarios(task, craft, seed, count, first), timing)


def _joined(flights: list[Flight]) -> Flight:
    """Flights of other episodes of the same task as one; episodes are the last axis of a field."""
    def join(*fields: Any) -> np.ndarray:
        return np.concatenate(fields, axis=-1)

    first, *others = flights
    return Flight(first.craft, first.task, first.timing,
                  map_leaves(join, first.states, *(f.states for f in others)),
                  map_leaves(join, first.goals, *(f.goals for f in others)),
                  np.concatenate([f.commands for f in flights], axis=1), first.controller, first.engine)
