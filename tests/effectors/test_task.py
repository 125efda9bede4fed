"""A landing: a task on another's ground whose policy sees the propellant left, flown by every executor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

import rans
from rans import Timing
from rans.model.drift import Drift, UniformGravity
from rans.model.dynamics import State
from rans.tasks.observation_terms import ObservationTerm, Scalar
from rans.tasks.rewards import Transition
from tests.support.effector_crafts import LANDER

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


def test_policy_and_reward_see_the_propellant():
    engine = rans.Engine(LANDER, Descend(), 4, TIMING)
    np.testing.assert_allclose(engine.observe()[:, COLUMN], 400.0)
    step = engine.step(torch.full((4, 6), 0.8))
    used = 0.5 * 6 * 0.8 * 3100.0 / (225.0 * 9.80665)
    np.testing.assert_allclose(step.observation[:, COLUMN], 400.0 - used, rtol=1e-6)
    paid = step.terms[engine.term_names.index("propellant")]
    np.testing.assert_allclose(paid, -0.1 * used, rtol=1e-4)
