"""Controllers in the drift of their task: against SciPy's integrator, and against the engine's own step."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest
from rans_optimal.mpc import MPC, shortest

from rans import LQR, Switching, Timing
from rans.episode.flight import fly
from rans.episode.scenario import scenarios
from rans.episode.step import Setup, World, step
from rans.model.coordinates import around
from rans.model.drift import FREE, ClohessyWiltshire, Drift, step_goal
from rans.model.fields import leaves, map_leaves
from rans.model.spacecraft_file import load_spacecraft
from rans.tasks import GoToPosition

PLATFORM = load_spacecraft("floating-platform")
FLYER = load_spacecraft("free-flyer")
ORBIT = ClohessyWiltshire(0.05)
"""Forty times as fast as a low orbit, so that the drift matters within a minute."""


@dataclass(frozen=True)
class Place(GoToPosition):
    """In a drift; the goal may be anywhere, and moves as free points do."""

    pulled: Drift = FREE
    aside: tuple[float, float, float] = field(default=(0.0, 0.0, 0.0))
    """Of the goal from the origin, m."""

    def __post_init__(self) -> None:
        """Settings may be anything."""

    @property
    def drift(self) -> Drift:
        return self.pulled

    def sample(self, random: Any) -> tuple[Any, Any]:
        start, goal = super().sample(random)
        aside = type(goal.p)(*self.aside[: len(goal.p.columns())])
        return replace(start, p=start.p + aside), replace(goal, p=goal.p + aside)


@dataclass(frozen=True)
class Chase(Place):
    """The goal moves as free points do."""

    def later(self, goal: Any, time: Any) -> Any:
        return step_goal(goal, self.drift, time)


@pytest.mark.parametrize("craft", [PLATFORM, FLYER], ids=lambda craft: craft.name)
@pytest.mark.parametrize("chased", [False, True])
def test_the_mpcs_prediction_is_the_engines_step(craft, chased):
    """In float64, of a goal that stands still and of one that drifts; in space the engine steps more finely."""
    task = (Chase if chased else Place)(pulled=ORBIT, aside=(2.0, -1.0, 0.5))
    timing = Timing(substeps=1)
    world = World(Setup(craft, task, timing))
    starts = scenarios(task, craft, 4, 5)
    start = replace(starts.start, v=starts.start.p.scale(0.1))
    commands = np.random.default_rng(0).uniform(size=(5, len(craft.thrusters)))
    outcome = step(world, world.begin(start, starts.goal), tuple(commands.T))
    controller = MPC(craft, task, timing)
    goals = controller._goals(start, starts.goal)
    errors = shortest(start, starts.goal)
    flown = controller._program._flown
    plan = np.zeros(controller._plans.shape[1:])
    for k in range(5):
        plan[:, 0] = commands[k]
        variables = np.array(flown(plan, errors[:, k], goals[:, :, k]))[:, 0]
        predicted = variables[plan.size :][: len(errors)]
        goal = map_leaves(lambda x, k=k: np.asarray(x)[k], outcome.episode.goal)
        there = around(goal, predicted)
        engine = map_leaves(lambda x, k=k: np.asarray(x)[k], outcome.episode.state)
        np.testing.assert_allclose(leaves(there.p), leaves(engine.p), rtol=0, atol=1e-12)
        np.testing.assert_allclose(leaves(there.v), leaves(engine.v), rtol=0, atol=1e-12)


@pytest.mark.parametrize("kind", [LQR, Switching, MPC], ids=lambda kind: kind.name)
def test_a_goal_that_drifts_is_followed(kind):
    """It goes round a moving ellipse of the orbit, up to 0.2 m/s fast."""
    task = Chase(pulled=ORBIT, aside=(1.0, 0.0, 0.0), spawn_distance=(2.0, 3.0))
    timing = Timing(episode_steps=60)
    starts = scenarios(task, PLATFORM, 7, 2)
    flight = fly(PLATFORM, task, kind(PLATFORM, task, timing), starts, timing)
    moved = (
        map_leaves(lambda x: x[-1], flight.goals).p - map_leaves(lambda x: x[0], flight.goals).p
    ).norm()
    assert moved.min() > 0.3
    assert flight.errors()["position"][-10:].max() < 0.1
