"""On a terminal of 80 columns nothing is wider, and no word or number is broken."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from rans.cli import main

STYLES = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")
COLUMNS = 80
AGENT = "pretrained:go-to-pose-2d"
COMMANDS = {
    "list": [],
    "list lab": [],
    "list orbit": [],
    "list TASKS": [],
    "list SPACECRAFT": [],
    "list AGENTS": [],
    "list CONTROLLERS": [],
    "list CONDITIONS": [],
    "list free-flyer": ["-0.219 -0.219 0"],
    f"list {AGENT}": [],
    "faults floating-platform --picture picture.svg": [],
    f"assure {AGENT} --episodes 300 --worst 0": ["flights", "any failure", "not finite", "0.0152"],
    f"assure {AGENT} --failure-below 1e-4 --episodes 0": [],
    f"evaluate {AGENT} --episodes 4": [],
    "sweep go-to-pose --seeds 1 --set total_timesteps=8192 --output a/folder/whose/name/is/rather/long/for": [],
    "validate --quick --layer thrusters --output shown": [],
}
"""Each with cells or words that must be whole."""


@pytest.mark.parametrize("command", COMMANDS)
def test_it_fits(
    command: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", str(COLUMNS))
    monkeypatch.setenv("FORCE_COLOR", "1")  # what Rich takes for a terminal
    assert main(command.split()) == 0
    lines = [STYLES.sub("", line).split("\r")[-1] for line in capsys.readouterr().out.splitlines()]
    assert max(map(len, lines)) <= COLUMNS
    for whole in COMMANDS[command]:
        assert any(whole in line for line in lines), whole
