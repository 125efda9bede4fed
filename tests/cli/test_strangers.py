"""A run folder of a stranger, with code where weights belong: every command tells and runs nothing."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import pytest

from tests.support.strangers import trapped
from tests.support.training import archived


@pytest.fixture
def run(trained: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy with a trap in its agent."""
    monkeypatch.chdir(tmp_path)
    folder = Path(shutil.copytree(trained, tmp_path / "run"))
    trapped(archived(folder), tmp_path / "ran")
    return folder


COMMANDS = [
    "evaluate run",
    "compare run",
    "compare lqr:go-to-pose-2d sb3:run/policy.zip --with --episodes 2 --certified 0",
    "view run --save page.html",
    "export run --output shipped --force",
]


@pytest.mark.parametrize("command", COMMANDS)
def test_a_trap_is_a_sentence(run: Path, command: str, told: Any) -> None:
    text = told(command)
    assert "holds code that would run posix.mkdir" in text
    assert "Traceback" not in text
    assert not (run.parent / "ran").exists()
