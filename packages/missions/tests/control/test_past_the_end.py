"""Every controller of the registry, and agents of missions, far past the end of what they fly.

In an episode the end hides what a controller does next. A simulator of somebody else, or a robot, goes on.
"""

from __future__ import annotations

import warnings
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from rans_missions.tasks import Dock, FinalApproach, Hold, Rendezvous
from rans_missions.tasks.orbital import OrbitalMission

from rans.episode.flight import Controller
from rans.episode.scenario import Scenario, scenarios
from rans.episode.step import Setup
from rans.evaluation.fly.controllers import CONTROLLERS
from rans.model.fields import Vec3, map_leaves
from rans.model.spacecraft_file import load_spacecraft
from tests.support.past_the_end import flown_on

REVERSALS = 3.0
"""Speed tolerances that holding may spend in 500 s: to stop from it, or turn round at half of it, three times. A
limit cycle that fires in every period spends hundreds."""
SLOW = "mpc", "convex"
MISSIONS: dict[str, OrbitalMission] = {"hold": Hold(), "dock": Dock(), "rendezvous": Rendezvous()}


def setup_of(task: Any) -> Setup:
    """One substep: orbits are exact with any number, and these craft turn slowly."""
    task = task.for_evaluation()
    return Setup(load_spacecraft(task.spacecraft), task, replace(task.timing, substeps=1))


def made(name: str, setup: Setup) -> Controller:
    with warnings.catch_warnings():
        # Some do not know the constraints, and say so.
        warnings.simplefilter("ignore", UserWarning)
        return CONTROLLERS[name](*setup[:3])


def near_starts(setup: Setup, seconds: float, count: int = 2) -> Scenario:
    """One or two craft 8 tolerances below and above the goal, with so many s until the deadline and the arrival."""
    task = setup.task
    assert isinstance(task, OrbitalMission)
    drawn: Any = scenarios(task, setup.craft, 1, count)
    zero = np.zeros(count)
    way = Vec3(np.array([-8.0, 8.0])[:count] * task.position_tolerance, zero, zero)
    left = np.full(count, seconds)
    arrival = left - task.timing.control_period
    notes = replace(drawn.goal.notes, deadline=left, arrival=arrival, won=zero)
    start = replace(drawn.start, p=drawn.goal.p + way, v=way.scale(0.0))
    return Scenario(start, replace(drawn.goal, notes=notes))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "mission"),
    [
        ("lqr", "rendezvous"),
        ("switching", "hold"),
        ("mission", "hold"),
        ("mission", "rendezvous"),
        ("mpc", "hold"),
        ("convex", "rendezvous"),
    ],
)
def test_controllers_hold_long_after_the_last_deadline(name, mission):
    """For 500 s. Every controller has a mission; that of missions has all, because it plans for them."""
    setup = setup_of(MISSIONS[mission])
    task = setup.task
    assert isinstance(task, OrbitalMission)
    # Near the goal, with 400 s after the deadline to come to rest.
    starts = near_starts(setup, 100.0, 1 if name in SLOW else 2)
    latest = 500.0
    continued = flown_on(setup, made(name, setup), starts, latest + 500.0)
    rest = continued.after(latest)
    assert rest.spent(500.0).max() < REVERSALS * task.velocity_tolerance
    assert rest.reached.all()
    assert rest.margin.min() > 0.0


@pytest.mark.slow
def test_a_missed_deadline_is_followed_by_a_new_plan():
    """From far away with no time left: the craft comes, within the limits, and without haste."""
    setup = setup_of(MISSIONS["dock"])
    task = setup.task
    assert isinstance(task, OrbitalMission)
    drawn = scenarios(task, setup.craft, 3, 1)
    goal = map_leaves(lambda x: x, drawn.goal)
    passed = goal.notes.deadline * 0.0 - 50.0
    notes = replace(goal.notes, deadline=passed, arrival=passed)
    starts = Scenario(drawn.start, replace(goal, notes=notes))
    once = task.deadline[1]
    continued = flown_on(setup, made("mission", setup), starts, once + 1000.0)
    assert continued.margin.min() > 0.0
    assert continued.reached[-1].all()
    planned = flown_on(
        setup,
        made("mission", setup),
        Scenario(drawn.start, task.plan(drawn.start, goal, np.full(1, once))),
        once,
    )
    # The same plan, and what staying costs.
    stays = REVERSALS * task.velocity_tolerance * 2.0
    assert continued.change.sum() < planned.change.sum() + stays


@pytest.mark.slow
def test_a_docked_craft_turns_with_its_port():
    """In the corridor, within the tolerances, for 200 s after the last contact."""
    setup = setup_of(FinalApproach(spawn_distance=(14.0, 16.0)))
    starts = scenarios(setup.task, setup.craft, 4, 8)
    continued = flown_on(setup, made("corridor", setup), starts, 600.0)
    assert continued.won.all()
    rest = continued.after(400.0)
    assert rest.reached.all()
    assert rest.margin.min() > 0.0
