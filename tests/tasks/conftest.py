"""Every task with every price charged, in the plane and in space, in batches of any states.

A task knows of a spacecraft its dimension and its count of thrusters only: one craft of each dimension
says what all would.
"""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

from rans import Spacecraft
from rans.episode.scenario import scenarios
from rans.model.spacecraft_file import load_spacecraft
from rans.tasks import TASKS, SingleTask
from rans.tasks.derived import dimensions
from tests.support.crafts import ANY_CRAFT, random_states
from tests.support.transitions import COUNT


@pytest.fixture(params=sorted(ANY_CRAFT))
def task(request) -> Any:
    return priced(TASKS[request.param]())


def priced(task: Any) -> Any:
    """The task, or every part of it, with whatever is off by default switched on a little."""
    if isinstance(task, SingleTask):
        off = [one.name for one in fields(task) if type(one.default) is float and not one.default]
        return replace(task, **dict.fromkeys(off, 0.01))
    return replace(
        task, **{name.replace("-", "_"): priced(part) for name, part in task.parts().items()}
    )


@pytest.fixture(params=["floating-platform", "free-flyer"])
def craft(request) -> Spacecraft:
    result = load_spacecraft(request.param)
    if "task" in request.fixturenames:
        task = request.getfixturevalue("task")
        if result.dimension not in dimensions(task):
            pytest.skip("the task does not work in this dimension")
    return result


@pytest.fixture
def states(craft) -> Any:
    return random_states(craft.dimension, COUNT, seed=1)


@pytest.fixture
def goals(task, craft) -> Any:
    return scenarios(task, craft, seed=2, count=COUNT).goal


@pytest.fixture
def commands(craft) -> tuple[tuple[np.ndarray, ...], ...]:
    """A command and the one before it."""
    rng = np.random.default_rng(3)
    return tuple(
        tuple(rng.integers(0, 2, (len(craft.thrusters), COUNT)).astype(float)) for _ in range(2)
    )
