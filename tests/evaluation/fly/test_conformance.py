"""What every controller by name keeps to, also those of packages, in a task that it flies."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from rans import TASKS, ConfigError
from rans.episode.flight import fly
from rans.episode.scenario import Scenario, scenarios
from rans.episode.step import Setup
from rans.evaluation.fly.controllers import CONTROLLERS
from rans.evaluation.fly.make_controller import controller
from rans.model.fields import map_leaves
from rans.model.spacecraft_file import USUAL, load_spacecraft
from rans.tasks.derived import dimensions

COUNT = 2
PERIODS = 4
NAMES = sorted(filter(CONTROLLERS.comes_with_rans, CONTROLLERS))


def made(name: str) -> tuple[Any, Setup]:
    """The controller in the first task that it flies."""
    for task_name in ("go-to-pose", *filter(TASKS.comes_with_rans, TASKS)):
        task = TASKS[task_name]().for_evaluation()
        craft = load_spacecraft(task.spacecraft or USUAL[dimensions(task)[0]])
        setup = Setup(craft, task, replace(task.timing, episode_steps=PERIODS))
        try:
            return controller(name, setup), setup
        except ConfigError:
            continue
    raise AssertionError(name)


@pytest.mark.filterwarnings("ignore:.* does not know the constraints:UserWarning")
@pytest.mark.parametrize(
    "name",
    # It solves a cone program in every period.
    [pytest.param(name, marks=pytest.mark.slow if name == "convex" else ()) for name in NAMES],
)
def test_a_controller_flies_each_episode_for_itself(name):
    """Together, and the last alone by the same object, which no flight changes; within the ranges of the craft."""
    pilot, setup = made(name)
    craft, task, timing = setup[:3]
    starts = scenarios(task, craft, 23, COUNT)
    together = fly(craft, task, pilot, starts, timing).commands
    low, high = np.array([(one.low, one.high) for one in craft.commands]).T
    assert ((low <= together) & (together <= high)).all()
    last = (map_leaves(lambda x: x[-1:], each) for each in (starts.start, starts.goal))
    alone = fly(craft, task, pilot, Scenario(*last), timing).commands
    # Rounding of sums in another order.
    np.testing.assert_allclose(alone[:, 0], together[:, -1], rtol=0, atol=1e-12)
