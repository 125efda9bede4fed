"""Guidance by convex programs: it keeps limits, and finds back to its way."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from rans_missions.bounds.transfers import row_of, transfer_bounds
from rans_missions.control.convex_guidance import ConvexGuidance
from rans_missions.tasks import Dock, TargetOrbit

from rans.flight import fly
from rans.model.spacecraft_file import load_spacecraft
from rans.scenario import scenarios

DEPUTY = load_spacecraft("afrl-deputy")


@pytest.mark.slow
def test_it_docks_below_the_speed_limit_near_the_bound() -> None:
    task = Dock(deadline=(700.0, 700.0))
    starts = scenarios(task, DEPUTY, 7, 4)
    kept = row_of("", fly(DEPUTY, task, ConvexGuidance(DEPUTY, task), starts, task.timing))
    assert kept.docked.all()
    lower = np.array([answer.lower for answer in transfer_bounds(DEPUTY, task, starts, 700.0)])
    ratios = kept.impulse / lower
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
def test_it_plans_again_when_it_is_off_its_way() -> None:
    task = Dock(deadline=(1500.0, 1500.0))
    starts = scenarios(task, DEPUTY, 8, 2)
    guidance = Pushed(DEPUTY, task)
    assert row_of("", fly(DEPUTY, task, guidance, starts, task.timing)).docked.all()


@pytest.mark.slow
def test_on_an_ellipse_a_plan_is_flown_to_its_end(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two craft at other anomalies: the engine shares no table with the plans, of which two are enough."""
    task = Dock(deadline=(500.0, 500.0), orbit=TargetOrbit(0.5, 13_556.0))
    starts = scenarios(task, DEPUTY, 5, 2)
    timing = replace(task.timing, episode_steps=50)
    guidance = ConvexGuidance(DEPUTY, task, timing)
    plans = []
    make = guidance._planned

    def planned(*arguments: Any) -> Any:
        plans.append(make(*arguments))
        return plans[-1]

    monkeypatch.setattr(guidance, "_planned", planned)
    assert row_of("", fly(DEPUTY, task, guidance, starts, timing)).docked.all()
    assert len(plans) == 2
