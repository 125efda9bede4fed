"""What tests of robots share."""

from __future__ import annotations

from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def agent(tmp_path_factory) -> Path:
    """What a node flies: the shipped agent, as NumPy."""
    pytest.importorskip("rosbags")
    from rans.base.pretrained import pretrained_folder
    from rans.deploy.export import write_export

    folder = tmp_path_factory.mktemp("agent") / "go-to-pose-2d"
    write_export(pretrained_folder("go-to-pose-2d"), folder, "numpy", episodes=0)
    return folder


@pytest.fixture(autouse=True)
def _trusted(monkeypatch) -> None:
    """The agents of these tests are written by them, and a flight runs their agent.py."""
    monkeypatch.setenv("RANS_TRUST", "1")
