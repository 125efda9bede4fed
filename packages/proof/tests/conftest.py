"""An agent of poses with its certificate; verdicts of tests stay out of the user's folder."""

from __future__ import annotations

import math
from pathlib import Path
from types import ModuleType

import pytest

from tests.support.processes import ROOT
from tests.support.scripts import module_of

PERIOD = 0.1
OFF = {"mass": 0.02, "thrust": 0.02, "position": 0.001, "velocity": 0.001}
OFF |= {"heading": 0.003, "spin": 0.005, "opening": 0.0005, "shutting": 0.0005}


@pytest.fixture(autouse=True)
def state(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Folder of the user's state."""
    folder = tmp_path_factory.mktemp("home") / "state"
    monkeypatch.setenv("XDG_STATE_HOME", str(folder))
    return folder


@pytest.fixture(autouse=True)
def here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Certificates of a test are small: they are checked in its own process."""
    monkeypatch.setattr("rans.processes.processors", lambda: 1)


@pytest.fixture(scope="session")
def example() -> ModuleType:
    """The script that writes the agent of the page."""
    return module_of(ROOT / "examples/proofs/pulse_agent.py")


@pytest.fixture(scope="session")
def folder(example: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Its run folder, which no test may change."""
    folder = tmp_path_factory.mktemp("agents") / "pulse-agent"
    example.write_agent(folder)
    return folder


@pytest.fixture(scope="session")
def files(folder: Path) -> dict[str, bytes]:
    """Contents of the files that a certificate is about."""
    from rans_proof.verdicts import FILES

    return {name: (folder / name).read_bytes() for name in FILES}


@pytest.fixture(scope="session")
def certificate(files: dict[str, bytes], tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """An honest certificate of the agent with all errors."""
    pytest.importorskip("flint")
    from rans_proof.pose_flights import read_run
    from rans_proof.pose_trap import PoseErrors, PoseStart, pose_trap, write_pose_trap

    keep = 0.05, 5.0
    start = PoseStart(0.02, 1.5, 0.02, 0.05)
    off = PoseErrors(**OFF)
    near = start._replace(heading=math.radians(start.heading))
    trap = pose_trap(read_run(files), (keep[0], math.radians(keep[1])), near, off)
    file = tmp_path_factory.mktemp("certificates") / "pose.json"
    write_pose_trap(trap, keep, start, off, files, PERIOD, file)
    return file.read_bytes()
