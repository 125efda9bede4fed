"""Guidance by convex programs: it keeps limits, and finds back to its way."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from rans_missions.bounds.first_starts import mission_bounds
from rans_missions.control.convex_guidance import ConvexGuidance, _tightened
from rans_missions.tasks import Dock

from rans.episode.flight import fly
from rans.episode.scenario import scenarios
from rans.evaluation.compare.contest import Contest
from rans.evaluation.measure.metrics import impulses, won
from rans.model.fields import Vec2
from rans.model.spacecraft_file import load_spacecraft
from rans.tasks.shapes import Ball, Cone, SpeedLimit

DEPUTY = load_spacecraft("afrl-deputy")


X, ZERO = Vec2(1.0, 0.0), Vec2(0.0, 0.0)


@pytest.mark.parametrize(
    "limit",
    [Ball(ZERO, ZERO, 1.0), Cone(ZERO, X, 0.5, 9.0), SpeedLimit(ZERO, 0.5, 0.1)],
    ids=lambda limit: type(limit).__name__,
)
def test_a_reserve_makes_every_limit_tighter(limit):
    """What keeps the tighter limit keeps the limit with room to spare."""
    place, velocity = Vec2(2.0, 0.9), Vec2(0.3, 0.4)
    assert 0.0 < _tightened(limit, 0.1).gap(place, velocity) < limit.gap(place, velocity)


@pytest.mark.slow
def test_it_docks_below_the_speed_limit_near_the_bound():
    task = Dock(deadline=(700.0, 700.0))
    starts = scenarios(task, DEPUTY, 7, 4)
    kept = fly(DEPUTY, task, ConvexGuidance(DEPUTY, task), starts, task.timing)
    assert won(kept).all()
    *_, bounds = mission_bounds(Contest(DEPUTY, task, task.timing, 7, 4), 4)
    ratios = impulses(kept) / bounds.lower
    assert (ratios >= 1.0).all()
    assert ratios.mean() < 1.02


class Pushed(ConvexGuidance):
    """Guidance whose first thrusters stick for a while: full thrust in periods 20 and 21."""

    _flown = 0

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        commands = super().act(state, goal, observation)
        if self._flown in (20, 21):
            commands[:] = 0.0
            commands[:, 2] = 0.05
        self._flown += 1
        return commands


@pytest.mark.slow
def test_it_plans_again_when_it_is_off_its_way():
    task = Dock(deadline=(1500.0, 1500.0))
    starts = scenarios(task, DEPUTY, 8, 2)
    guidance = Pushed(DEPUTY, task)
    assert won(fly(DEPUTY, task, guidance, starts, task.timing)).all()
