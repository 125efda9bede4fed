"""Commands and observations of spacecraft whose filters are tested."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from rans.policy.filter_bank import Filters
from rans.policy.kalman_filter import Filter
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


def made(craft: Spacecraft, task: Task, drift: float, response: float = 0.0) -> Filter:
    """One filter of a bank."""
    bank = craft, task, TIMING.control_period, (drift,), (response,), 25.0, 5.0
    (one,) = Filters.of(*bank).each
    return one
