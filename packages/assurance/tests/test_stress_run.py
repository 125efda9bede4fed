"""Everybody in every world: the flights are those of evaluations, and nothing that was flown is lost."""

from dataclasses import replace

import numpy as np
import pytest
import rans_assurance.stress.run as run
from rans_assurance.stress.outcome import StressOutcome
from rans_assurance.stress.run import prepared
from rans_missions.tasks import Dock

from rans import ConfigError
from rans.evaluation.compare.entrants import contest_of
from rans.evaluation.fly.contestants import contestant
from rans.evaluation.fly.episodes import fly_episodes
from rans.evaluation.fly.make_controller import controller
from rans.evaluation.measure.metrics import solved
from rans.randomization.conditions_file import load_conditions
from tests.support.stress_runs import FIRST, small


@pytest.mark.slow
def test_flights_are_those_of_evaluations(monkeypatch):
    """Also when they are flown in several shares, and one alone when it is seen again."""
    monkeypatch.setattr(run, "_SHARE", 3)
    stress = small(FIRST, conditions=("lab",))
    stress.effects = []
    counts = list[int]()
    stress.fly(lambda *_: counts.append, workers=1)
    assert sum(counts) == 4 * len(stress.levels)
    agent = contestant(FIRST).under(load_conditions("lab"))
    flight = fly_episodes(agent.controller, agent.judged, 7, 4)
    found = stress.outcomes["lab", "go-to-pose-2d"]
    assert found.solved.tolist() == solved(flight).tolist()
    alone = fly_episodes(agent.controller, agent.judged, 7, 1, first=3)
    error = alone.errors()["position"][-25:, 0].max()
    assert found.errors["position"][3] == pytest.approx(error, rel=1e-6)


@pytest.mark.slow
def test_a_controller_flies_a_named_world_as_it_was_tuned_for_it():
    """In `lab` the LQR that ships for `lab`, which a comparison in `lab` flies too; elsewhere the nominal one."""
    stress = small("lqr:go-to-pose-2d", conditions=("lab",))
    stress.effects = []
    stress.fly(workers=1)
    setup = stress.contest.setup._replace(conditions=load_conditions("lab"))
    found = stress.outcomes["lab", "LQR"].errors["position"]

    def largest(nominal):
        made = controller("lqr", stress.contest.setup if nominal else setup)
        flight = fly_episodes(made, setup, 7, 4)
        return flight.errors()["position"][-25:].max(axis=0)

    assert found == pytest.approx(largest(nominal=False), rel=1e-6)
    assert found != pytest.approx(largest(nominal=True), rel=1e-3)


@pytest.mark.slow
def test_a_controller_that_expects_errors_knows_those_of_each_level(tmp_path, monkeypatch):
    # The beginning of a docking, in which noise is burnt already.
    monkeypatch.setattr(Dock, "timing", replace(Dock.timing, episode_steps=20, substeps=1))
    noisy = tmp_path / "noisy.toml"
    noisy.write_text("[sensors.position]\nnoise = 0.05\n\n[sensors.velocity]\nnoise = 0.001\n")
    stress = small("mission:dock-3d", episodes=1, conditions=(str(noisy),))
    stress.effects = []
    stress.fly(workers=1)
    informed = contestant("mission:dock-3d").under(load_conditions(noisy))
    for level, conditions in zip(stress.levels, (None, informed.conditions), strict=True):
        expected = controller("mission", informed.judged._replace(conditions=conditions))
        setup = stress.contest.setup._replace(conditions=conditions)
        flight = fly_episodes(expected, setup, 7, 1)
        found = stress.outcomes[level.name, "mission"].errors["position"]
        assert found == pytest.approx(StressOutcome.of(flight).errors["position"], rel=1e-6)


def test_slow_controllers_fly_fewer():
    stress = small(FIRST, "mpc", episodes=4, slow=1)
    agent, mpc = stress.contestants.values()
    assert (stress.episodes(agent), stress.episodes(mpc)) == (4, 1)


@pytest.mark.slow
def test_tasks_without_a_place_are_judged_by_their_own_tolerances():
    stress = small("pretrained:track-velocity-2d", "lqr", episodes=2, only=("force",))
    stress.fly(workers=1)
    assert list(stress.outcomes["perfect", "LQR"].errors) == ["velocity"]
    assert np.isfinite(stress.outcomes["perfect", "LQR"].excess).all()


def test_a_word_of_several_effects_is_answered_by_all_of_them():
    with pytest.raises(ConfigError, match="did you mean more mass or less mass or centre of mass"):
        small(only=("mass",))


def test_one_trouble_alone_flies_nothing_that_is_not_shown():
    specs = ["lqr:go-to-pose-2d"]
    alone = prepared(contest_of(specs[0], 2, 7), specs, {}, ["latency"], 2)
    assert {level.effect for level in alone.levels} == {"perfect", "latency"}
    beside = prepared(
        contest_of(specs[0], 2, 7), specs, {"lab": load_conditions("lab")}, ["latency"], 2
    )
    assert {level.effect for level in beside.levels} == {"perfect", "lab", "latency"}
