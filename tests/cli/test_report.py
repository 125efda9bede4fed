from __future__ import annotations

import json
from pathlib import Path

import pytest

from rans.base.files import write_json
from rans.cli import main
from rans.cli.report import Report
from rans.evaluation.measure.aggregate import measure
from tests.support.evaluation_flights import two_episodes
from tests.support.training import tiny_trainer
from validation.study.checks import Check, Study


@pytest.fixture
def run(tmp_path) -> Path:
    """A run folder in which only checks were written."""
    checks = (
        Check("force", 1e-16, 1e-12, "N", "Rounding."),
        Check("way", 1.0, 1e-9, "m", "Planted."),
    )
    Study("Dynamics", checks).write(tmp_path / "validation.json")
    return tmp_path


def test_writes_the_page_and_ends_with_where_it_is(run, capsys):
    assert main(["report", str(run)]) == 0
    printed = capsys.readouterr().out
    assert "1 of 2" in printed
    # There is no agent to export.
    assert printed.splitlines()[-3:] == [
        f"The report is {run}/report.html.",
        "Next:",
        "  rans list AGENTS",
    ]
    assert "verdict bad" in (run / "report.html").read_text("utf-8")


def test_the_agent_of_a_training_is_what_to_export(run):
    (run / "agent.safetensors").touch()
    assert Report(run).following() == (f"rans export {run} --format c",)


def test_an_agent_that_seldom_solves_is_trained_on(tmp_path):
    """After 2,048 steps, 4,000 in two digits; an evaluation counts more than the training."""
    run = tiny_trainer(tmp_path / "run").run
    (run.path / "agent.safetensors").touch()
    run.save_checkpoint({})
    run.append_metrics({"steps": 2048, "seconds": 1.0, "success": 0.1})
    trained_on = f"rans train --resume {run.path} --total-timesteps 4000"
    assert Report(run.path).following() == (trained_on,)
    write_json(run.path / "evaluation.json", measure(two_episodes()).to_json())
    assert Report(run.path).following() == (f"rans export {run.path} --format c",)


def test_a_report_can_be_written_again(run):
    assert main(["report", str(run)]) == 0
    (run / "validation.json").write_text(json.dumps({"title": "Later", "checks": []}))
    assert main(["report", str(run)]) == 0
    assert "Later" in (run / "report.html").read_text("utf-8")
