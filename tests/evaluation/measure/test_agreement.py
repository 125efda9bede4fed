"""The engines' agreement is judged as it should be, and an agent flown on many processes is the same."""

from __future__ import annotations

import io
import json
import math
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from rans.cli import main
from rans.episode import Setup
from rans.evaluation.fly.agent import load_policy
from rans.evaluation.fly.episodes import fly_episodes
from rans.evaluation.measure.agreement import compare_engines
from rans.files import write_json
from rans.model.fields import leaves, map_leaves
from rans.reference.flight import fly_in_drake
from rans.scenario import scenarios
from rans.terminal import rendered
from tests.support.evaluation_flights import TrackNothing, flight_of, many_episodes


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
    flight = replace(
        flight,
        states=map_leaves(lambda x: 0.0 * x, flight.states),
        goals=map_leaves(lambda x: 0.0 * x, flight.goals),
    )
    for lost, passed in ((3, True), (4, False)):
        way = np.zeros(40)
        way[:lost] = 1.0
        pair = compare_engines(flight, moved(flight, way)).pairs[0]
        assert (pair.drake.value, pair.passed) == (100.0 - 2.5 * lost, passed)


def test_the_table_says_who_is_where() -> None:
    """Four flights that rest 1 cm and 3 degrees from the goal, and in Drake 1.2 cm and 3.05 degrees.

    Wilson's lower end of 4 of 4 is 1 / (1 + 1.96^2 / 4), 51 %.
    """
    near = np.full((11, 4), 0.01)
    commands = np.zeros((10, 4, 8))
    fast = flight_of(near, 3.0, commands)
    commands = commands.copy()
    commands[7, 2, 5] = 1.0  # one thruster in one of 40 decisions
    comparison = compare_engines(fast, flight_of(1.2 * near, 3.05, commands))
    assert (
        comparison.title
        == "by hand: the same 4 episodes of 5 s with floating-platform in both engines"
    )
    console = Console(file=io.StringIO(), width=140)
    console.print(rendered(comparison.table()))
    lines = [
        [cell.strip() for cell in line.replace("┃", "│").split("│")[1:-1]]
        for line in console.file.getvalue().splitlines()  # type: ignore[attr-defined]
    ]
    assert [line for line in lines if line] == [
        ["quantity", "fast (95 %)", "Drake (95 %)", "gap", "allowed", "verdict"],
        ["solved, %", "100 (51 to 100)", "100 (51 to 100)", "+0.0e+00", "-49, +0", "pass"],
        ["position error, cm", "1", "1.2", "+2.0e-01", "-0.1, +0.1", "FAIL"],
        ["attitude error, deg", "3", "3.05", "+5.0e-02", "-0.1, +0.1", "pass"],
        ["settling time, s", "0", "0", "+0.0e+00", "", ""],
    ]
    assert (
        "In 97.50% of all control periods both opened the same thrusters."
        in console.file.getvalue()  # type: ignore[attr-defined]
    )


@pytest.mark.parametrize(
    ("task", "bound"),
    [
        (None, {"error_degrees": 0.1}),
        (TrackNothing(), {"speed": (1e-3, 0.0)}),
        (TrackNothing(), {"spin": math.radians(0.1)}),
    ],
    ids=["attitude", "velocity", "spin"],
)
@pytest.mark.parametrize("share", [0.9, 1.1])
def test_bounds_of_the_others(task: Any, bound: dict[str, Any], share: float) -> None:
    still: dict[str, Any] = {"distance": np.ones((11, 1)), "error_degrees": 0.0, "task": task}
    flown: dict[str, Any] = still | {name: share * np.array(value) for name, value in bound.items()}
    assert compare_engines(flight_of(**still), flight_of(**flown)).passed is (share < 1.0)


def test_json_has_no_infinity(tmp_path: Path) -> None:
    flight = many_episodes(8)
    write_json(tmp_path / "x.json", compare_engines(flight, moved(flight, 5.0)).to_json())
    read = json.loads((tmp_path / "x.json").read_text())
    assert read["passed"] is False
    settling = {pair["name"]: pair for pair in read["pairs"]}["settling time"]
    assert float(settling["drake"]) == math.inf


def test_another_process_flies_what_this_one_would(
    trained: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In two shares; the network's sums depend on the batch in the last bits only."""
    monkeypatch.setattr("rans.evaluation.fly.episodes._SHARE", 8)
    counted: list[int] = []
    loaded = load_policy(trained)
    agent = loaded.controller
    craft = loaded.craft
    task = loaded.task
    timing = loaded.timing
    task = task.for_evaluation()
    together = fly_episodes(agent, Setup(craft, task, timing), 5, 11, "drake", 1, counted.append)
    alone = fly_in_drake(craft, task, agent, scenarios(task, craft, 5, 11), timing)
    assert sorted(counted) == [3, 8]
    assert 0.1 < together.commands.mean() < 0.9
    assert np.array_equal(together.commands, alone.commands)
    for ours, theirs in zip(leaves(together.states), leaves(alone.states), strict=True):
        assert ours == pytest.approx(theirs, abs=1e-9)  # rounding of bodies integrated together
    assert together.engine == "drake"


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_both_engines_on_the_command_line(
    trained: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = Path(shutil.copytree(trained, tmp_path / "run"))
    assert main(f"evaluate {run} --episodes 4 --engine both".split()) == 0
    assert "in both engines" in capsys.readouterr().out
    read = json.loads((run / "evaluation.json").read_text("utf-8"))
    assert read.keys() >= {"fast", "drake", "both"}
    assert read["both"]["passed"] is True
