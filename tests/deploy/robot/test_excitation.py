"""The most informative commands: flown by a node's pilot in a box, and worth more than others."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import rans
from rans.cli import main
from rans.deploy.robot.pilot import MessagePilot, Plan
from rans.deploy.robot.twin import Craft, TwinPlan
from rans.errors import ConfigError
from rans.evaluation.fly.exported import code_of
from rans.evaluation.identify.excite import Excitation
from rans.model.spacecraft_file import load_spacecraft
from rans.tasks.go_to_pose import GoToPose

pytest.importorskip("rosbags")


@pytest.mark.parametrize("name", ["floating-platform", "free-flyer"])
def test_a_flight_stays_in_its_box_and_ends(name: str, tmp_path: Path) -> None:
    folder = rans.excite(name, tmp_path / "most", box=2.0, seconds=12.0)
    plan = Plan(str(folder), {"name": "go-to-pose", "settings": {}})
    pilot = MessagePilot(plan, GoToPose())
    craft = pilot.craft
    zeros = (0.0,) * (3 if craft.dimension == 2 else 6)
    twin = Craft(
        TwinPlan(
            craft, 0.2, start=zeros[:3], conditions=rans.load_conditions("lab"), rate=5.0, seed=3
        )
    )
    reach = 0.0
    fired = np.zeros(craft.thruster_count, dtype=bool)
    for k in range(65):
        now = (k + 1) * 200_000_000
        for message in pilot.interface.state(twin.motion, now):
            pilot.receive(message.topic, message.data, now)
        command = pilot.decide(now).command
        if k >= 60:
            assert not command.any()
        fired |= command > 0.0
        twin.hold(command)
        twin.advance()
        reach = max(reach, float(np.max(np.abs(twin.motion.position))))
    assert fired.all()
    assert reach < 1.0


def test_regressors_are_derivatives_of_the_acceleration() -> None:
    """Newton and Euler by hand, with each parameter moved by a little."""
    craft = load_spacecraft("free-flyer")
    columns = np.array(craft.wrench_map)
    inertia = np.array(craft.inertia)
    n = len(columns)
    make = Excitation(columns, craft.mass, inertia, np.zeros(n), 0.2, 3.0, 0)
    random = np.random.default_rng(1)
    command = (random.random(n) < 0.3).astype(float)
    rotation = np.linalg.qr(random.normal(size=(3, 3)))[0]

    def acceleration(parameters: np.ndarray) -> np.ndarray:
        gain = 1.0 + 0.3 * parameters[:n]
        wrench = (command * gain) @ columns
        tensor = inertia.copy()
        entries = iter(parameters[n : n + 6])
        for i in range(3):
            for j in range(i, 3):
                change = 0.3 * np.sqrt(inertia[i, i] * inertia[j, j]) * next(entries)
                tensor[i, j] += change
                if i != j:
                    tensor[j, i] += change
        centre = 0.03 * parameters[n + 6 : n + 9]
        torque = wrench[3:] - np.cross(centre, wrench[:3])
        size = 0.5 * np.max(np.linalg.norm(columns[:, :3], axis=1))
        lever = 0.5 * np.max(np.linalg.norm(columns[:, 3:], axis=1))
        force = wrench[:3] + rotation.T @ (size * parameters[n + 9 : n + 12])
        torque = torque + rotation.T @ (lever * parameters[n + 12 :])
        return np.concatenate([force / craft.mass, np.linalg.solve(tensor, torque)])

    (rows,) = make.regressors(command[None], rotation)
    assert rows.shape == (6, n + 15)
    for k in range(n + 15):
        step = np.zeros(n + 15)
        step[k] = 1e-6
        slope = (acceleration(step) - acceleration(-step)) / 2e-6
        assert rows[:, k] == pytest.approx(slope, abs=1e-7)


def information() -> float:
    """Logarithm of the determinant of the information about a platform that stands still."""
    craft = load_spacecraft("floating-platform")
    columns = np.array(craft.wrench_map)
    inertia = np.array([[craft.inertia[2][2]]])
    make = Excitation(columns, craft.mass, inertia, np.zeros(8), 0.2, 3.0, 0)
    total = np.eye(make.size)
    for _ in range(100):
        command = make.choose(np.zeros(2), np.eye(2), np.zeros(2), np.zeros(1))
        (rows,) = make.regressors(command[None], np.eye(2)) * 20.0
        total += rows.T @ rows
    return float(np.linalg.slogdet(total)[1])


def test_chosen_commands_tell_more_than_random_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    chosen = information()
    monkeypatch.setattr("rans.evaluation.identify.excite._CANDIDATES", 1)
    # The determinant is the product of 14 squares: intervals are a tenth narrower in the geometric mean.
    assert chosen > information() + 3.0


def test_the_command_says_how_to_fly(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "most"
    assert main(["identify", "--excite", "atmos", "--output", str(folder)]) == 0
    said = capsys.readouterr()
    assert "--trust --seconds 60" in " ".join((said.out + said.err).split())
    right, count = code_of(folder / "agent.py").check()
    assert (right, count) == (32, 32)
    assert main(["identify", "--excite", "atmos", "--output", str(folder)]) == 2
    assert "exists already" in capsys.readouterr().err
    with pytest.raises(ConfigError, match="reaction wheels"):
        rans.excite("pingu", tmp_path / "pingu")
