"""The engines' agreement is judged as it should be, and an agent flown on many processes is the same."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rans.cli import main
from rans.evaluation.fly.agent import load_agent
from rans.evaluation.fly.judge import flown
from rans.evaluation.fly.protocols import Setup
from rans.evaluation.measure.engines import compare_engines, wilson
from rans.model.fields import leaves, map_leaves
from rans.reference.flight import fly_in_drake
from rans.scenario import scenarios
from tests.evaluation.flights import many_episodes


def moved(flight: Any, way: Any) -> Any:
    """The same flight, farther from its goal by a way, of all episodes or one of each."""
    states = replace(flight.states, p=replace(flight.states.p, x=flight.states.p.x - way))
    return replace(flight, states=states, engine="drake")


def test_equal_flights_agree() -> None:
    flight = many_episodes(40)
    comparison = compare_engines(flight, replace(flight, engine="drake"))
    assert comparison.passed
    assert comparison.same_commands == 1.0
    assert [pair.difference for pair in comparison.pairs] == [0.0] * 4


@pytest.mark.parametrize(("way", "agrees"), [(0.9e-3, True), (1.1e-3, False)])
def test_a_millimetre_is_the_bound_of_the_position(way: float, agrees: bool) -> None:
    flight = many_episodes(40)
    comparison = compare_engines(flight, moved(flight, way))
    pair = {p.name: p for p in comparison.pairs}["position error"]
    assert pair.difference == pytest.approx(100 * way, rel=1e-9)
    assert (pair.passed, comparison.passed) == (agrees, agrees)


def test_an_engine_that_loses_its_numbers_disagrees() -> None:
    flight = many_episodes(8)
    assert compare_engines(flight, moved(flight, np.nan)).passed is False


def test_fewer_solved_than_the_interval_allows_fail() -> None:
    """40 of 40 solved have the interval 91.2 % to 100 %: 37 may be, 36 may not."""
    flight = many_episodes(40)
    flight = replace(flight, states=map_leaves(lambda x: 0.0 * x, flight.states),
                     goals=map_leaves(lambda x: 0.0 * x, flight.goals))
    for lost, passed in ((3, True), (4, False)):
        way = np.zeros(40)
        way[:lost] = 1.0
        pair = compare_engines(flight, moved(flight, way)).pairs[0]
        assert (pair.drake, pair.passed) == (100.0 - 2.5 * lost, passed)


def test_wilsons_interval_by_hand() -> None:
    """81 of 263 (Newcombe, Statistics in Medicine 17, 1998, table I): 0.2553 to 0.3662."""
    assert wilson(81 / 263, 263) == pytest.approx((0.2553, 0.3662), abs=5e-5)
    assert wilson(0.0, 20) == pytest.approx((0.0, 0.1611), abs=5e-5)  # the same table, 0 of 20


def test_json_has_no_infinity() -> None:
    flight = many_episodes(8)
    far = moved(flight, 5.0)
    table = compare_engines(flight, far).to_json()
    read = json.loads(json.dumps(table, allow_nan=False))
    assert read["passed"] is False
    settling = {pair["name"]: pair for pair in read["pairs"]}["settling time"]
    assert float(settling["drake"]) == math.inf


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run folder of an agent that has hardly begun to learn."""
    folder = tmp_path_factory.mktemp("runs") / "young"
    assert main(["train", "go-to-pose", "--run", str(folder), "--total-timesteps", "8192",
                 "--set", "timing.episode_steps=20", "--set", "ppo.n_steps=16"]) == 0
    return folder


def test_processes_fly_what_one_would(run: Path) -> None:
    """70 episodes are two shares; the network's sums depend on the batch in the last bits only."""
    counted: list[int] = []
    agent, craft, task, timing = load_agent(run)
    task = task.for_evaluation()
    together, _ = flown(agent, Setup(craft, task, timing), 5, 70, "drake", 2, counted.append)
    alone = fly_in_drake(craft, task, agent, scenarios(task, craft, 5, 70), timing)
    assert sorted(counted) == [6, 64]
    assert np.array_equal(together.commands, alone.commands)
    for ours, theirs in zip(leaves(together.states), leaves(alone.states), strict=True):
        assert ours == pytest.approx(theirs, abs=1e-9)  # rounding of bodies integrated together
    assert together.engine == "drake"


def test_both_engines_on_the_command_line(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["evaluate", str(run), "--episodes", "4", "--engine", "both"]) == 0
    assert "in both engines" in capsys.readouterr().out
    read = json.loads((run / "evaluation.json").read_text("utf-8"))
    assert read.keys() >= {"fast", "drake", "both"}
    assert read["both"]["passed"] is True


def altered(run: Path, target: Path, name: str, change: Any) -> Path:
    """A copy of a run folder with one file changed."""
    target.mkdir()
    for file in run.iterdir():
        if file.is_file():
            (target / file.name).write_bytes(file.read_bytes())
    text = (target / name).read_text("utf-8")
    (target / name).write_text(change(text), "utf-8")
    return target


@pytest.mark.parametrize(("name", "change", "message"), [
    ("config.json", lambda text: text.replace('"gamma"', '"discount"'), "unknown key 'discount'"),
    ("spacecraft.toml", lambda text: text.rpartition("[[thruster]]")[0], "are of different runs"),
], ids=["of another version", "for other thrusters"])
def test_a_run_that_does_not_fit_is_one_sentence(run: Path, tmp_path: Path, name: str, change: Any,
                                                 message: str, capsys: Any) -> None:
    strange = altered(run, tmp_path / "strange", name, change)
    capsys.readouterr()
    assert main(["evaluate", str(strange), "--engine", "drake"]) == 2
    lines = [line for line in capsys.readouterr().err.splitlines() if "warning" not in line]
    assert len(lines) == 1
    assert message in lines[0]
