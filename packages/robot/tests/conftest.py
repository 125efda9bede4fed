"""What tests of robots share."""

from __future__ import annotations

from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def agent(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What a node flies: the shipped agent, as NumPy."""
    pytest.importorskip("rosbags")
    from rans_robot.pilot import export_for_flight

    from rans.pretrained import pretrained_folder

    folder = tmp_path_factory.mktemp("agent") / "go-to-pose-2d"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("rans_robot.pilot._RANGE_FLIGHTS", 64)
        export_for_flight(pretrained_folder("go-to-pose-2d"), folder)
    return folder


@pytest.fixture(autouse=True)
def _trusted(monkeypatch: pytest.MonkeyPatch) -> None:
    """The agents of these tests are written by them, and a flight runs their agent.py."""
    monkeypatch.setenv("RANS_TRUST", "1")
