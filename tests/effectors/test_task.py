"""A landing: a task on another's ground whose policy sees the propellant left, flown by every executor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

import rans
from rans.flight import fly
from rans.model.drift import Drift, UniformGravity
from rans.model.dynamics import State
from rans.model.timing import Timing
from rans.reference.flight import DrakeMover
from rans.scenario import scenarios
from rans.tasks.observation_terms import ObservationTerm, Scalar
from rans.tasks.rewards import Transition
from tests.support.effector_crafts import LANDER
from tests.support.effector_flights import scripted

MARS = 3.7114


@dataclass(frozen=True)
class Descend(rans.GoToPosition):
    """Positions on Mars, with propellant in sight and a price of 0.1 for each kilogram used."""

    failure_distance: float = 1e4

    @property
    def drift(self) -> Drift:
        return UniformGravity((0.0, 0.0, -MARS))

    def observation_terms(self, state: State, goal: State) -> tuple[ObservationTerm, ...]:
        return (
            *super().observation_terms(state, goal),
            Scalar("propellant", "kg", state.stores[0]),
        )

    def reward(self, transition: Transition) -> dict[str, Any]:
        before = transition.before
        assert before is not None
        used = before.stores[0] - transition.state.stores[0]
        return {**super().reward(transition), "propellant": used * -0.1}


COLUMN = [one.name for one in rans.tasks.observation_columns(Descend(), 3)].index("propellant")
TIMING = Timing(control_period=0.5, episode_steps=20)


def test_policy_and_reward_see_the_propellant() -> None:
    engine = rans.Engine(LANDER, Descend(), 4, TIMING)
    np.testing.assert_allclose(engine.observe()[:, COLUMN], 400.0)
    step = engine.step(torch.full((4, 6), 0.8))
    used = 0.5 * 6 * 0.8 * 3100.0 / (225.0 * 9.80665)
    np.testing.assert_allclose(step.observation[:, COLUMN], 400.0 - used, rtol=1e-6)
    paid = step.terms[engine.term_names.index("propellant")]
    np.testing.assert_allclose(paid, -0.1 * used, rtol=1e-4)


def test_thrust_carries_the_lander_against_gravity() -> None:
    """By hand: six engines of 3100 N at 80 %, canted by 27 degrees, push 1905 kg by 6.96 m/s^2."""
    task = Descend()
    engine = rans.Engine(LANDER, task, 2, Timing(control_period=0.5, episode_steps=5), seed=1)
    before = np.array(engine.state.v.columns())
    engine.step(torch.full((2, 6), 0.8))
    gained = np.array(engine.state.v.columns()) - before
    gained[2] += 0.5 * MARS
    lift = 6 * 0.8 * 3100.0 * np.cos(np.radians(27.0)) / 1905.0
    np.testing.assert_allclose(np.linalg.norm(gained, axis=0), 0.5 * lift, rtol=2e-3)


def test_drake_lands_alike_and_pays_alike() -> None:
    task = Descend()
    starts = scenarios(task, LANDER, 3, 3)
    pilot = scripted(LANDER)
    ours = fly(LANDER, task, pilot, starts, TIMING)
    mover = DrakeMover(LANDER, TIMING, task.drift)
    drake = fly(LANDER, task, pilot, starts, TIMING, mover)
    np.testing.assert_allclose(ours.states.v.z, drake.states.v.z, rtol=0, atol=1e-6)
    for name, paid in ours.rewards().items():
        np.testing.assert_allclose(paid, drake.rewards()[name], rtol=0, atol=1e-5)
    used = ours.states.stores[0][0] - ours.states.stores[0][-1]
    np.testing.assert_allclose(ours.rewards()["propellant"].sum(axis=0), -0.1 * used, rtol=1e-9)
