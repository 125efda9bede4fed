"""The most informative commands: flown by a node's pilot in a box, and worth more than others."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rans_robot.identify.excite import Excitation
from rans_robot.pilot import MessagePilot, exported_agent
from rans_robot.twin import Craft, TwinPlan

import rans
from rans.cli import main
from rans.errors import ConfigError
from rans.model.spacecraft_file import load_spacecraft
from rans.tasks.go_to_pose import GoToPose
from tests.support.robots import plan

pytest.importorskip("rosbags")


@pytest.mark.parametrize("name", ["floating-platform", "free-flyer"])
def test_a_flight_stays_in_its_box_and_ends(name: str, tmp_path: Path) -> None:
    folder = rans.excite(name, tmp_path / "most", box=2.0, seconds=12.0)
    pilot = MessagePilot(plan(folder), GoToPose())
    craft = pilot.craft
    zeros = (0.0,) * (3 if craft.dimension == 2 else 6)
    twin = Craft(
        TwinPlan(craft, 0.2, start=zeros, conditions=rans.load_conditions("lab"), rate=5.0)
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


def information() -> float:
    """Logarithm of the determinant of the information about a platform that stands still."""
    craft = load_spacecraft("floating-platform")
    make = Excitation(craft, 0.2, 3.0, 0)
    total = np.eye(make.size)
    for _ in range(100):
        command = make.choose(np.zeros(6))
        (rows,) = make.after(command[None], np.zeros(6), 0.2)[1]
        total += rows.T @ rows
    return float(np.linalg.slogdet(total)[1])


def test_chosen_commands_tell_more_than_random_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    chosen = information()
    monkeypatch.setattr("rans_robot.identify.excite._CANDIDATES", 1)
    # The determinant is the product of 14 squares: intervals are a tenth narrower in the geometric mean.
    assert chosen > information() + 3.0


def test_the_command_says_how_to_fly(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], refused: Any
) -> None:
    folder = tmp_path / "most"
    line = f"identify --excite atmos --output {folder}"
    assert main(line.split()) == 0
    said = capsys.readouterr()
    assert f"rans fly {folder} --seconds 60" in " ".join((said.out + said.err).split())
    assert "exists already" in refused(line)
    with pytest.raises(ConfigError, match="has reaction wheels"):
        rans.excite("pingu", tmp_path / "pingu")


def test_a_folder_has_no_code_and_its_files_belong_together(tmp_path: Path) -> None:
    """A name that ends a docstring once stood in an agent.py, which the command ran."""
    folder = rans.excite("floating-platform", tmp_path / "most")
    assert not [*folder.glob("*.py")]
    file = folder / "excitation.json"
    file.write_text(file.read_text().replace('"seed": 0', '"seed": 1'))
    with pytest.raises(ConfigError, match="golden pairs"):
        exported_agent(folder)
