"""Guidance for descents: it lands near the bound of its start, in both engines, and finds back to its way."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rans_missions.control.landing_guidance import LandingGuidance
from rans_missions.convex.landing import Descent, Lander, best_landing
from rans_missions.tasks.land import Land

from rans.evaluation.fly.agent import LoadedRun
from rans.evaluation.fly.contestants import contestant
from rans.evaluation.fly.episodes import fly_episodes
from rans.evaluation.measure.metrics import won
from rans.flight import Flight, fly
from rans.model.spacecraft_file import load_spacecraft
from rans.randomization.conditions_file import load_conditions
from rans.reference.flight import fly_in_drake
from rans.scenario import EVALUATION_SEED, Scenario, scenarios

LANDER = load_spacecraft("mars-lander-steered")
TASK = Land()


def used(flight: Flight) -> float:
    left = flight.states.stores[0]
    return float(left[0, 0] - left[flight.lengths[0], 0])  # type: ignore[index]


def starts(seed: int) -> Scenario:
    return scenarios(TASK, LANDER, seed, 1)


@pytest.mark.slow
def test_it_lands_near_the_bound_and_breaks_no_limit_in_both_engines() -> None:
    begun = starts(7)
    p, v = (np.array(x.columns()).ravel() for x in (begun.start.p, begun.start.v))
    descent = Descent.of(TASK, craft=LANDER)
    bound = best_landing(Lander.of(LANDER), descent, (p, v), 0.5, "bound")
    assert bound is not None
    guidance = LandingGuidance(LANDER, TASK)
    for flying in (fly, fly_in_drake):
        flight = flying(LANDER, TASK, guidance, begun, TASK.timing)
        assert won(flight).all()
        assert 1.0 < used(flight) / bound.propellant < 1.015


class Kicked(LandingGuidance):
    """Guidance whose engines give two thirds more than they should for two seconds, and whose wheels then err."""

    _flown = 0

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        commands = super().act(state, goal, observation)
        if 80 <= self._flown < 84:
            commands[:, :6] = 0.5
        if self._flown == 84:
            commands[:, 6:8] = 0.3
        self._flown += 1
        return commands


@pytest.mark.slow
def test_it_plans_again_when_it_is_off_its_way() -> None:
    guidance = Kicked(LANDER, TASK)
    flight = fly(LANDER, TASK, guidance, starts(8), TASK.timing)
    assert won(flight).all()


def _engine_out(folder: Path) -> tuple[LoadedRun, LoadedRun]:
    """Landing guidance by name, without conditions and under those of a dead engine."""
    file = folder / "engine-out.toml"
    file.write_text('[faults]\nthrusters = [0]\nkinds = ["dead"]\n', encoding="utf-8")
    nominal = contestant("landing:land-3d")
    return nominal, nominal.under(load_conditions(file))


def _lands(guidance: LandingGuidance, run: LoadedRun) -> bool:
    """Whether it lands under the run's conditions from the first start, which has a landing."""
    flight = fly_episodes(guidance, run.judged, EVALUATION_SEED, 1, workers=1)
    return bool(won(flight).all())


@pytest.mark.slow
def test_it_expects_the_dead_engines_of_conditions(tmp_path: Path) -> None:
    """Guidance that is made by its name gets the conditions, and lands from a start that has a landing."""
    nominal, run = _engine_out(tmp_path)
    assert run.conditions is not None
    assert run.conditions.dead == (0,)
    guidance = run.controller
    assert isinstance(guidance, LandingGuidance)
    assert guidance is not nominal.controller
    assert guidance.expecting(run.conditions) is guidance
    assert _lands(guidance, run)


def test_without_conditions_it_expects_no_dead_engine(tmp_path: Path) -> None:
    nominal, run = _engine_out(tmp_path)
    guidance = run.controller
    assert isinstance(guidance, LandingGuidance)
    assert isinstance(nominal.controller, LandingGuidance)
    assert guidance.dead == (0,)
    assert guidance.expecting(None).dead == nominal.controller.dead == ()
