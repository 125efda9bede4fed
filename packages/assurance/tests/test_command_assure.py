"""``rans assure`` as a user runs it."""

from __future__ import annotations

import html
import json
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from rans_assurance.functions import assure
from scipy.stats import binomtest

import rans
from rans.cli import main
from rans.evaluation.measure.metrics import solved
from rans.fast.flights import BATCH, Flights

AGENT: str = "pretrained:go-to-pose-2d"
LAB: str = f"assure {AGENT} --conditions lab"
"""In conditions in which four in five of the agent's flights fail."""
DEFAULTS: dict[str, Any] = assure.__kwdefaults__ or {}
"""Default arguments of `rans.assure`, which the command has too."""


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    # Each failed flight that is repeated takes a second of Drake.
    monkeypatch.setitem(DEFAULTS, "worst", 0)


def test_python_flies_the_conditions_that_it_names():
    """It flew everything nominal, and bounded a failure probability of 0.8 by 0.02."""
    named = rans.assure("go-to-pose-2d", conditions="lab", episodes=64)
    own = rans.assure("go-to-pose-2d", conditions=rans.load_conditions("lab"), episodes=64)
    assert named.campaign.failures == own.campaign.failures
    assert main(f"{LAB} --episodes 64 --output here".split()) == 0
    read = json.loads(Path("here/assurance-lab.json").read_text("utf-8"))
    assert read["bounds"]["any"]["failures"] == named.campaign.bound().events > 0
    # What was asked is stated by its content, also where it has a name.
    assert "position within 5 cm" in dict(read["scope"]["rows"])["requirement"]
    assert ["conditions", "body.mass 0.75 to 1.25"] in read["scope"]["rows"]


@pytest.mark.slow
def test_numbers_a_page_and_commands_that_show_failures_again(monkeypatch, capsys):
    line = f"{LAB} --episodes 60"
    command = line.split()
    monkeypatch.setitem(DEFAULTS, "worst", 1)
    monkeypatch.setattr(sys, "argv", ["rans", *command])
    assert main(command) == 0
    printed = capsys.readouterr().out
    folder = Path("runs/evaluations/pretrained-go-to-pose-2d")
    read = (folder / "assurance-lab.json").read_text("utf-8")
    found = json.loads(read)
    failed = sum(map(len, found["campaign"]["listed"].values()))
    low, high = binomtest(failed, 60).proportion_ci(0.98, "exact")  # 1 % beyond either end
    assert failed > 0
    assert found["bounds"]["any"]["at least"] == pytest.approx(low, rel=1e-6)
    assert found["bounds"]["any"]["at most"] == pytest.approx(high, rel=1e-6)
    assert f"{failed} of 60 flights failed" in printed
    assert found["command"] == f"rans {line}"
    policy = Path(rans.__file__).parent / "data/pretrained/go-to-pose-2d/agent.safetensors"
    listed = subprocess.run(
        ["sha256sum", policy], capture_output=True, text=True, check=True
    ).stdout
    assert found["about"]["hashes"]["weights (agent.safetensors)"] == listed.split()[0]
    assert main(["report", str(folder)]) == 0
    report = (folder / "report.html").read_text("utf-8")
    assert f"{failed} of 60 flights failed" in report
    assert found["replays"]["judged"][0]["see"] in html.unescape(report)
    shown = []
    monkeypatch.setattr("rans.api.pages.Replay.html", lambda replay: shown.extend(replay.flights))
    monkeypatch.setattr("rans.cli.view._serve", lambda page, *_: page())
    assert main(shlex.split(found["replays"]["judged"][0]["see"])[1:]) == 0
    assert solved(shown[0]).tolist() == [False]


def test_ctrl_c_keeps_what_was_flown(monkeypatch, capsys):
    """So does a kill: it is written before the interrupt, and not by it alone."""
    monkeypatch.setattr("rans.show.progress._SAVED_EVERY", 0.0)
    monkeypatch.setitem(BATCH, "cpu", 32)
    part = Flights._part
    file = Path("here/assurance.json")

    def interrupted(self, first, count, seed):
        if first:
            assert file.exists()
            raise KeyboardInterrupt
        return part(self, first, count, seed)

    monkeypatch.setattr(Flights, "_part", interrupted)
    assert main(f"assure {AGENT} --output here --episodes 64".split()) == 130
    assert json.loads(file.read_text("utf-8"))["campaign"]["flights"] == 32
    said = capsys.readouterr()
    assert "Interrupted" in said.out
    assert "interrupted; what was written is kept" in said.err


def test_a_bound_that_is_refuted_ends_with_1(monkeypatch, capsys):
    monkeypatch.setitem(DEFAULTS, "confidence", 0.6)
    assert main(f"{LAB} --failure-below 3e-3".split()) == 1
    assert "Refuted" in capsys.readouterr().out
