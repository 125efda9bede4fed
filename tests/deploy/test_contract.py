"""Contract and golden pairs: what somebody who flies an agent elsewhere must know, and does not learn too late."""

from __future__ import annotations

import json
import re
import types
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rans import Conditions, SensorsConditions
from rans.base.files import plain
from rans.base.pretrained import pretrained_folder
from rans.deploy.contract import (
    FLIGHTS,
    contract,
    flights_of_training,
    golden,
)
from rans.episode.step import Setup
from rans.evaluation.fly.agent import Agent, load_policy
from rans.evaluation.fly.episodes import fly_episodes
from rans.fast.agent_files.agent import read_policy
from rans.fast.learn.run_folder import RunFolder
from tests.support.exports import exported, written

DOCS = Path(__file__).parents[2] / "docs"


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Callable[[str], Path]:
    """A shipped agent as NumPy with its contract and golden pairs, by its name."""
    root = tmp_path_factory.mktemp("agents")

    @cache
    def made(name: str) -> Path:
        run = RunFolder(pretrained_folder(name))
        config = run.config()
        craft = run.spacecraft()
        network = read_policy(run.agent_file).network
        setup = Setup(craft, config.settings, config.timing, config.conditions.or_none)
        count = FLIGHTS if name == "go-to-pose-2d" else 64
        flights = flights_of_training(Agent(network, name, craft), setup, count=count)
        memory = network.architecture.memory
        about = contract(name, config, craft, "", memory, flights.observations)
        written(root / name, network, "numpy")
        (root / name / "contract.json").write_text(json.dumps(plain(about)))
        pairs = golden(network, flights, craft, config.settings)
        (root / name / "golden.json").write_text(json.dumps(pairs))
        return root / name

    return made


def contract_of(folder: Path) -> dict[str, Any]:
    return json.loads((folder / "contract.json").read_text("utf-8"))


class States:
    """A controller that passes the states on to a loop written for a robot, and its commands back."""

    name = "loop"

    def __init__(self, act: Callable[[dict[str, Any], dict[str, Any]], Any]) -> None:
        self._act = act

    def reset(self, count: int) -> None:
        assert count == 1

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        given = [
            {
                "position": [float(x.p.x.item()), float(x.p.y.item())],
                "attitude": float(np.asarray(x.attitude.angle).item()),
                "velocity": [float(np.asarray(x.v.x).item()), float(np.asarray(x.v.y).item())],
                "spin": float(np.asarray(x.w).item()),
            }
            for x in (state, goal)
        ]
        return np.atleast_2d(self._act(*given))


def documented(folder: Path, stopped: Callable[[], bool], **robot: Any) -> dict[str, Any]:
    """Names of docs/export.md's loop, run in the folder of an agent on somebody's robot."""
    text = re.search(
        r"## On a robot.*?```python no-run\n(.*?)```", (DOCS / "export.md").read_text("utf-8"), re.S
    )
    assert text is not None
    code = text[1].replace('Path("contract.json")', f"Path({str(folder / 'contract.json')!r})")
    module = types.ModuleType("agent")
    vars(module).update(exported(folder))
    names: dict[str, Any] = {"flying": lambda: not stopped(), **robot}
    code = code.replace("from agent import Agent, check_wiring", "")
    code = code.replace("time.sleep(", "(lambda _: None)(")
    names |= {"Agent": module.Agent, "check_wiring": module.check_wiring}
    exec(compile(code, "loop", "exec"), names)
    return names


@pytest.mark.slow
def test_the_documented_loop_does_not_warn_on_flights_that_arrive(folder):
    """Ten flights of starts that the ranges are not from; each is flown by what the page says."""
    name = "go-to-pose-2d"
    names = documented(folder(name), lambda: True)
    run = load_policy(pretrained_folder(name))
    setup = Setup(run.craft, run.task.for_evaluation(), run.timing)
    agent = names["Agent"]()
    warnings = []

    def act(state, goal):
        command = agent.act(names["observe"](state, goal))
        warnings.extend([agent.note] if agent.note else [])
        return command

    for episode in range(10):
        agent.reset()
        flight = fly_episodes(States(act), setup, 99, 1, workers=1, first=episode)
        assert flight.verdict.held.all()
    assert warnings == []


def test_the_documented_loop_shuts_the_valves_on_an_old_state(folder):
    here = {
        "position": [1.0, 0.5],
        "attitude": 0.3,
        "velocity": [0.0, 0.0],
        "spin": 0.0,
    }
    ages = [0.0, 0.1, 1.0]
    commands = []
    said = []
    documented(
        folder("go-to-pose-2d"),
        lambda: not ages,
        estimated_state=lambda: (here | {"spin": 0.01 * len(ages)}, ages.pop(0)),
        goal=lambda: here | {"position": [0.0, 0.0]},
        valves=commands.append,
        warn=said.append,
    )
    assert len(commands) == 3
    assert np.sum(commands[0]) > 0
    assert list(commands[2]) == [0.0] * 8
    assert said == ["the state is 1.00 s old: valves shut"]


def planar(state: dict[str, Any], goal: dict[str, Any], error: str = "") -> np.ndarray:
    """An observation of go-to-pose in the plane, with a mistake that somebody may make."""
    heading = state["attitude"]
    v = np.array(state["velocity"])
    way = np.subtract(goal["position"], state["position"])
    turn = goal["attitude"] - heading
    if error == "own minus goal":
        way = -way
    if error == "velocity in the body frame":
        c, s = np.cos(heading), np.sin(heading)
        v = np.array([c * v[0] + s * v[1], c * v[1] - s * v[0]])
    if error == "way in the body frame":
        c, s = np.cos(heading), np.sin(heading)
        way = np.array([c * way[0] + s * way[1], c * way[1] - s * way[0]])
    if error == "turn the other way":
        turn = -turn
    if error == "goal at the origin":
        way = -np.array(state["position"])
    if error == "north, east, down":
        v, way = v[::-1], way[::-1]
    return np.array(
        [
            *(np.cos(heading), np.sin(heading)),
            *v,
            state["spin"],
            1.0,
            *way,
            *(np.cos(turn), np.sin(turn)),
        ]
    )


GOOD = planar(
    {"position": [2.0, 1.0], "attitude": 0.2, "velocity": [0.0, 0.0], "spin": 0.0},
    {"position": [0.0, 0.0], "attitude": 0.0},
)
"""A reading that an agent was tried on."""


@pytest.mark.parametrize(
    "error",
    [
        "own minus goal",
        "velocity in the body frame",
        "way in the body frame",
        "turn the other way",
        "goal at the origin",
        "north, east, down",
    ],
)
def test_a_wrong_wiring_is_found(error, folder):
    check = exported(folder("go-to-pose-2d"))["check_wiring"]
    assert check(planar) == (64, 64)
    assert check(lambda state, goal: planar(state, goal, error)) == (0, 64)


def matrix(quaternion: list[float]) -> np.ndarray:
    """R_WB of a unit quaternion, by SciPy."""
    from scipy.spatial.transform import Rotation

    w, *xyz = quaternion
    return Rotation.from_quat([*xyz, w]).as_matrix()


@pytest.mark.parametrize("error", ["", "transposed", "quaternion x, y, z, w", "spin in W"])
def test_a_wrong_wiring_in_space_is_found(error, folder):
    def observe(state, goal):
        own = state["attitude"]
        own = own if error != "quaternion x, y, z, w" else [own[3], *own[:3]]
        own = matrix(own)
        turn = own.T @ matrix(goal["attitude"])
        turn = turn.T if error == "transposed" else turn
        spin = own @ state["spin"] if error == "spin in W" else state["spin"]
        way = np.subtract(goal["position"], state["position"])
        return np.array([*own[:2].ravel(), *state["velocity"], *spin, 1.0, *way, *turn[:2].ravel()])

    check = exported(folder("go-to-pose-3d"))["check_wiring"]
    assert check(observe) == ((0, 64) if error else (64, 64))


@pytest.mark.slow
def test_a_contract_says_what_an_engineer_asks_first(folder):
    perfect = contract_of(folder("go-to-pose-2d"))
    robust = contract_of(folder("go-to-pose-2d-robust"))
    assert perfect["conditions"]["of_training"] == {}
    assert "no latency" in perfect["conditions"]["summary"]
    assert "latency up to 0." in robust["conditions"]["summary"]
    assert robust["conditions"]["of_training"]["thrusters"]["latency"]
    assert perfect["readings"]["oldest"] == pytest.approx(0.2)
    columns = perfect["observation"]
    assert columns[6]["meaning"] == "p_WG - p_WB: position of the goal minus own"
    assert columns[9]["meaning"].startswith("R_WB^T R_WG")
    assert [column["valid"] for column in columns[:2]] == [[-1.0, 1.0]] * 2
    assert columns[6]["valid"][1] > 4.5  # the farthest start
    assert perfect["tasks"][0]["task"] == "go-to-pose"
    assert perfect["tasks"][0]["flag"] == 1.0
    assert perfect["trade_off"] is None


def test_readings_may_be_as_old_as_in_any_condition_of_the_training():
    """The training of `go-to-pose-2d-robust` has outages of up to 1 s in two of its further conditions."""
    run = RunFolder(pretrained_folder("go-to-pose-2d-robust"))
    config = run.config()
    seen = np.zeros((1, 1, 10), np.float32)
    readings = contract("", config, run.spacecraft(), "", 0, seen)["readings"]
    assert readings["oldest"] == pytest.approx(0.2 + 1.0)
    late = Conditions(sensors=SensorsConditions(delay=(0.0, 2.0)))
    config = replace(config, conditions=Conditions(others=(late,)))
    readings = contract("", config, run.spacecraft(), "", 0, seen)["readings"]
    assert readings["age_of_training"] == pytest.approx(0.4)
    assert readings["oldest"] == pytest.approx(0.6)


@pytest.mark.slow
def test_which_end_of_a_trade_off_is_fast(folder):
    assert contract_of(folder("go-to-pose-2d-trade-off"))["trade_off"] == {
        "column": 10,
        "0": "fast",
        "1": "thrifty",
        "valid": [0.0, 1.0],
    }


def test_wild_readings_are_held_and_then_shut_the_valves(folder):
    agent = exported(folder("go-to-pose-2d"))["Agent"]()
    wild = GOOD.copy()
    wild[6] = 1e9
    assert not agent.act(wild).any()  # the first one: there is none to hold
    agent.reset()
    command = agent.act(GOOD)
    assert command.any()
    assert agent.note == ""
    for bad in (wild, np.full(10, np.nan), GOOD):  # a reading that repeats under thrust is none
        agent.reset()
        agent.act(GOOD)
        np.testing.assert_array_equal(agent.act(bad), command)
        assert "held the last one (1 of 1)" in agent.note
        assert not agent.act(bad).any()
        assert "shut all valves" in agent.note
        assert not agent.act(bad).any()
        assert agent.act(GOOD * 0.99).any()


@pytest.mark.parametrize("name", ["go-to-pose-2d", "go-to-pose-2d-faults"])
def test_an_answer_that_is_not_finite_shuts_the_valves(folder, name):
    names = exported(folder(name))
    agent = names["Agent"]()
    answer = names["answer"]
    command = np.full((1, 8), np.nan, np.float32)
    names["answer"] = lambda w, observation, memory: (command, memory + np.nan)
    assert not agent.act(GOOD).any()
    assert "shut all valves" in agent.note
    names["answer"] = answer
    assert agent.act(GOOD).any()
    assert agent.note == ""


def test_one_flight_that_spins_does_not_set_a_valid_range():
    """The valid range is that of 511 flights below 1 rad/s, though one of 512 reaches 8 rad/s."""
    run = RunFolder(pretrained_folder("go-to-pose-2d"))
    seen = np.zeros((3, 512, 10), np.float32)
    seen[1] = np.linspace(-1.0, 1.0, 512)[:, None]
    seen[2, 17] = -8.0
    about = contract("one", run.config(), run.spacecraft(), "", 0, seen)
    low, high = about["observation"][4]["valid"]
    assert about["observation"][4]["name"] == "w_z"
    assert -1.3 < low < -1.1
    assert 1.1 < high < 1.3
    assert about["observation"][4]["refused"][0] > -5.0
