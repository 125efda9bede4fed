"""What commands print, by value: every figure stands in what was measured, with its unit."""

from __future__ import annotations

import re
import shlex
from types import SimpleNamespace
from typing import Any

import pytest

import validation.study.study
from rans.cli import main, train as training
from rans.model.spacecraft_file import load_spacecraft
from validation.study.checks import Check, Skipped, Study


def trainer_of(command: training.Train) -> Any:
    return SimpleNamespace(
        run=SimpleNamespace(path="runs/a"),
        config=command.resolved(),
        engine=SimpleNamespace(craft=load_spacecraft("floating-platform")),
    )


def test_the_suggested_training_keeps_settings_of_the_task():
    """Also by their short names; others, such as a number of steps, may contradict the quality."""
    command = training.Train("go-to-pose", set=("thrust_weight=0.1", "n_steps=8"))
    trainer = trainer_of(command)
    better = command._next(trainer)[-1].partition("   #")[0]
    assert better == "rans train go-to-pose --set thrust_weight=0.1 --quality good"
    assert len(training.Train("config.json")._next(trainer)) == 2  # the file has a length


@pytest.mark.parametrize("task", ["go-to-pose-priced", "multi-task"])
def test_what_a_training_suggests_is_of_tasks_that_a_comparison_takes(task):
    command = training.Train(task)
    trainer = trainer_of(command)
    compared = shlex.split(command._next(trainer)[1])[2:]
    assert all(name.partition("#")[2] in trainer.config.settings.parts() for name in compared)


def study_of(*checks: Check, skipped: tuple[Skipped, ...] = ()) -> Study:
    return Study("x", checks, {"seconds": {"all": 1.5}}, skipped)


def test_validate_says_what_failed_and_where(monkeypatch, ran):
    good = Check("mass", 0.0, 1e-9, "kg", "Rounding.", "state 2")
    bad = Check("way", 1.0, 1e-9, "m", "Truncation.", "flight 7")
    found = study_of(good, bad, skipped=(Skipped("kernel", "No compiler."),))
    monkeypatch.setattr(validation.study.study, "study", lambda *_: found)
    monkeypatch.setenv("COLUMNS", "120")
    printed = ran("validate", code=1)
    assert "FAIL way (flight 7). Its tolerance: Truncation." in printed
    assert "not run kernel: No compiler." in printed
    assert "1 of 2 checks passed in 1.5 s." in printed
    monkeypatch.setattr(validation.study.study, "study", lambda *_: study_of(good))
    assert "1 of 1 checks passed in 1.5 s." in ran("validate")


def test_notes_of_a_comparison_are_printed(tmp_path, capsys, monkeypatch):
    """Also beside names that are no mark-up, and all files are written before."""

    def fill(comparison, *_, **__):
        comparison.notes.append("No certificate [/red].")
        comparison.failures.append("LQR [bold]failed.")

    monkeypatch.setattr("rans.evaluation.compare.run.Comparison.fly", fill)
    assert main(f"compare lqr:go-to-pose-2d --with lqr --output {tmp_path}".split()) == 1
    assert capsys.readouterr().out.splitlines()[:2] == [
        "No certificate [/red].",
        "LQR [bold]failed.",
    ]
    assert "No certificate [/red]." in (tmp_path / "compare.html").read_text()


STYLES = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")
COLUMNS = 80
AGENT = "pretrained:go-to-pose-2d"
COMMANDS = {
    "list": [],
    "list orbit": [],
    "list free-flyer": ["-0.219 -0.219 0"],
    f"list {AGENT}": [],
    "faults floating-platform": [],
    "validate --quick --layer thrusters --output shown": [],
}
"""Each with cells or words that must be whole."""


@pytest.mark.usefixtures("here", "undrawn")
@pytest.mark.parametrize(
    "command",
    COMMANDS,
)
def test_it_fits(command, monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", str(COLUMNS))
    monkeypatch.setenv("FORCE_COLOR", "1")  # what Rich takes for a terminal
    assert main(command.split()) == 0
    lines = [STYLES.sub("", line).split("\r")[-1] for line in capsys.readouterr().out.splitlines()]
    assert max(map(len, lines)) <= COLUMNS
    for whole in COMMANDS[command]:
        assert any(whole in line for line in lines), whole
