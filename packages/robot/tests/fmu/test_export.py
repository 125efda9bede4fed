"""FMUs of agents, read, checked and flown by FMPy, which shares no code with RANS."""

from __future__ import annotations

import json
import shutil
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rans_robot.fmu.export import write_fmu

from rans import ConfigError
from rans.base.pretrained import pretrained_folder
from rans.cli import main
from rans.deploy.export import write_export
from rans.deploy.program import Ports
from rans.episode.step import Setup
from rans.evaluation.fly.agent import load_policy
from rans.evaluation.fly.episodes import fly_episodes
from rans.policy.program import Program

fmpy = pytest.importorskip("fmpy")
fmi2 = pytest.importorskip("fmpy.fmi2")
validation = pytest.importorskip("fmpy.validation")
if shutil.which("cc") is None:
    pytest.skip("needs a C compiler", allow_module_level=True)

PERIOD = 0.2


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("fmu") / "agent"
    write_export(pretrained_folder("go-to-pose-2d"), folder, "fmu", episodes=8)
    return folder


@pytest.fixture
def unit(folder) -> Iterator[Any]:
    """The unit, ready for its first step."""
    unzipped = fmpy.extract(str(folder / "agent.fmu"))
    about = fmpy.read_model_description(unzipped)
    slave = fmi2.FMU2Slave(
        guid=about.guid, unzipDirectory=unzipped, modelIdentifier="agent", instanceName="one"
    )
    slave.instantiate()
    slave.setupExperiment(startTime=0.0)
    slave.enterInitializationMode()
    slave.exitInitializationMode()
    yield slave
    slave.terminate()
    slave.freeInstance()
    shutil.rmtree(unzipped)


def stepped(unit: Any, observation: np.ndarray, time: float, step: float = PERIOD) -> np.ndarray:
    """Commands after a step with an observation."""
    unit.setReal(list(range(10)), [float(x) for x in observation])
    unit.doStep(time, step)
    return np.array(unit.getReal(list(range(10, 18))))


def test_fmpy_finds_no_problem(folder):
    """Against the schema of FMI 2.0, and its rules for variables, units and the structure of the model."""
    file = str(folder / "agent.fmu")
    assert validation.validate_fmu(file) == []
    assert fmpy.supported_platforms(file) == ["c-code", "linux64"]
    about = fmpy.read_model_description(file)
    contract = json.loads((folder / "contract.json").read_text("utf-8"))
    inputs = [one for one in about.modelVariables if one.causality == "input"]
    assert [one.unit for one in inputs] == [column["unit"] for column in contract["observation"]]
    assert float(about.defaultExperiment.stepSize) == contract["control_period"]


class InOtherHands:
    """A controller whose commands are those of the unit."""

    name = "FMU"

    def __init__(self, unit: Any) -> None:
        self.unit = unit
        self.periods = 0

    def reset(self, count: int) -> None:
        assert count == 1

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        command = stepped(self.unit, observation[0], self.periods * PERIOD)
        self.periods += 1
        return command[None]


def test_it_flies_as_the_agent(unit):
    """A whole flight in RANS's engine: every command and every state is that of the agent itself."""
    run = load_policy(pretrained_folder("go-to-pose-2d"))
    setup = Setup(run.craft, run.task.for_evaluation(), run.timing)
    own = fly_episodes(run.controller, setup, 7, 1, workers=1)
    other = fly_episodes(InOtherHands(unit), setup, 7, 1, workers=1)
    assert own.verdict.held.all()
    np.testing.assert_array_equal(other.commands, own.commands)


def test_the_agent_acts_once_a_period_whatever_the_steps(folder, unit):
    """A step within a period changes nothing, and a restart begins anew."""
    pairs = json.loads((folder / "golden.json").read_text("utf-8"))
    rows = np.array(pairs["observation"], np.float32)
    first = rows[0]
    commands = pairs["command"]
    other = rows[[command != commands[0] for command in commands].index(True)]
    begun = stepped(unit, first, 0.0, 0.05)
    for k in (1, 2, 3):
        np.testing.assert_array_equal(stepped(unit, other, 0.05 * k, 0.05), begun)
    assert (stepped(unit, other, 0.2, 0.05) != begun).any()
    unit.reset()
    unit.setupExperiment(startTime=5.0)
    np.testing.assert_array_equal(stepped(unit, first, 5.0), begun)


def test_readings_that_are_none_are_held_and_then_shut(folder, unit):
    """The watchdogs of the C export stand around the agent here too; notes has its flags (agent.h)."""
    pairs = json.loads((folder / "golden.json").read_text("utf-8"))
    row = np.array(pairs["observation"][[*map(any, pairs["command"])].index(True)])
    begun = stepped(unit, row, 0.0)
    assert unit.getInteger([18]) == [0]
    nothing = np.full(10, np.nan)
    np.testing.assert_array_equal(stepped(unit, nothing, 0.2), begun)
    assert unit.getInteger([18])[0] & 1
    assert not stepped(unit, nothing, 0.4).any()
    assert unit.getInteger([18])[0] & 2
    # Nor is one that repeats under thrust.
    unit.reset()
    unit.setupExperiment(startTime=0.0)
    opened = [bool(stepped(unit, row, 0.2 * k).any()) for k in range(5)]
    assert opened == [True, True, False, False, False]


@pytest.mark.slow
def test_the_same_agent_gives_the_same_bytes(folder, tmp_path):
    again = tmp_path / "agent"
    write_export(pretrained_folder("go-to-pose-2d"), again, "fmu", episodes=8)
    one, other = (zipfile.ZipFile(made / "agent.fmu") for made in (folder, again))
    assert one.namelist() == other.namelist()
    for name in one.namelist():
        assert one.read(name) == other.read(name), name


def test_an_agent_without_a_contract_is_refused(tmp_path):
    with pytest.raises(ConfigError, match="need a contract"):
        write_fmu(tmp_path, Program(), Ports(10, 8), "it", "")


@pytest.mark.slow
def test_the_command_writes_it(tmp_path):
    line = f"export pretrained:go-to-pose-2d --format fmu --episodes 8 --output {tmp_path}/mine"
    assert main(line.split()) == 0
    assert validation.validate_fmu(f"{tmp_path}/mine/agent.fmu") == []
