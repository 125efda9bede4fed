"""Everybody in every world: the flights are those of evaluations, and nothing that was flown is lost."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rans_assurance.stress.run as run
from rans_assurance.stress.run import prepared
from rans_missions.tasks import Dock

from rans.errors import ConfigError
from rans.evaluation.compare.entrants import contest_of
from rans.evaluation.fly.contestants import contestant
from rans.evaluation.fly.episodes import fly_episodes
from rans.evaluation.fly.make_controller import controller
from rans.evaluation.measure.metrics import solved
from rans.evaluation.stress.outcome import StressOutcome
from rans.randomization.conditions_file import load_conditions
from tests.support.stress_runs import FIRST, small


@pytest.mark.slow
def test_flights_are_those_of_evaluations(monkeypatch: pytest.MonkeyPatch) -> None:
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
    alone = fly_episodes(agent.controller, agent.judged, 7, 1, first=2)
    error = alone.errors()["position"][-25:, 0].max()
    assert found.errors["position"][2] == pytest.approx(error, rel=1e-6)


@pytest.mark.slow
def test_the_lqr_bears_late_valves_longer() -> None:
    """With valves 0.1 s late it holds its goal, where the agent does not (audit: 100 %, 0 %)."""
    stress = small(episodes=16)
    stress.fly(workers=1)
    effect = stress.effects[0]
    sizes, shares = zip(*stress._rates(effect, "LQR"), strict=True)
    assert sizes == (0.0, *effect.sizes)
    assert shares[3] is not None
    assert shares[3].value == 1.0
    answer = stress.break_even(effect, "LQR")
    assert answer is not None
    assert answer.after == -1
    assert answer.size is not None
    assert answer.size < 0.1


@pytest.mark.slow
def test_a_controller_flies_a_named_world_as_it_was_tuned_for_it() -> None:
    """In `lab` the LQR that ships for `lab`, which a comparison in `lab` flies too; elsewhere the nominal one."""
    stress = small("lqr:go-to-pose-2d", conditions=("lab",))
    stress.effects = []
    stress.fly(workers=1)
    setup = stress.contest.setup._replace(conditions=load_conditions("lab"))
    found = stress.outcomes["lab", "LQR"].errors["position"]

    def largest(nominal: bool) -> np.ndarray:
        made = controller("lqr", stress.contest.setup if nominal else setup)
        flight = fly_episodes(made, setup, 7, 4)
        return flight.errors()["position"][-25:].max(axis=0)

    assert found == pytest.approx(largest(nominal=False), rel=1e-6)
    assert found != pytest.approx(largest(nominal=True), rel=1e-3)


@pytest.mark.slow
def test_a_controller_that_expects_errors_knows_those_of_each_level(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
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


@pytest.mark.slow
def test_another_process_finds_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    """One per processor, of which there is one here."""
    alone = small()
    together = small()
    alone.fly(workers=1)
    monkeypatch.setattr("rans.processes.processors", lambda: 1)
    together.fly()
    assert alone.outcomes.keys() == together.outcomes.keys()
    for key, found in alone.outcomes.items():
        np.testing.assert_allclose(together.outcomes[key].excess, found.excess, rtol=1e-9)


def test_slow_controllers_fly_fewer() -> None:
    stress = small(FIRST, "mpc", episodes=4, slow=1)
    agent, mpc = stress.contestants.values()
    assert (stress.episodes(agent), stress.episodes(mpc)) == (4, 1)


@pytest.mark.slow
def test_who_fails_is_told_once_and_the_rest_is_flown() -> None:
    stress = small("lqr:go-to-pose-2d", "python:tests.support.policies:broken", episodes=2)
    stress.fly(workers=1)
    assert len(stress.failures) == 1
    assert "no such layer" in stress.failures[0]
    assert {name for _, name in stress.outcomes} == {"LQR"}
    assert len(stress.outcomes) == len(stress.levels)


@pytest.mark.slow
def test_tasks_without_a_place_are_judged_by_their_own_tolerances() -> None:
    stress = small("pretrained:track-velocity-2d", "lqr", episodes=2, only=("force",))
    stress.fly(workers=1)
    assert list(stress.outcomes["perfect", "LQR"].errors) == ["velocity"]
    assert np.isfinite(stress.outcomes["perfect", "LQR"].excess).all()


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"only": ("mass",)}, r"did you mean more mass or less mass or centre of mass\?"),
        ({"only": ("latancy",)}, r"no effect named 'latancy' \(did you mean latency\?\)"),
        ({"conditions": ("moon",)}, "no set of conditions named 'moon'"),
    ],
)
def test_what_is_not_there(change: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ConfigError, match=sentence):
        small(**change)


def test_one_of_several_tasks_must_be_picked() -> None:
    with pytest.raises(ConfigError, match="has several tasks"):
        small("pretrained:multi-task-2d")


def test_one_trouble_alone_flies_nothing_that_is_not_shown() -> None:
    specs = ["lqr:go-to-pose-2d"]
    alone = prepared(contest_of(specs[0], 2, 7), specs, {}, ["latency"], 2)
    assert {level.effect for level in alone.levels} == {"perfect", "latency"}
    beside = prepared(
        contest_of(specs[0], 2, 7), specs, {"lab": load_conditions("lab")}, ["latency"], 2
    )
    assert {level.effect for level in beside.levels} == {"perfect", "lab", "latency"}
