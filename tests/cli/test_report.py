from __future__ import annotations

import json
from pathlib import Path

import pytest

from rans.cli import main
from rans.cli.report import Report
from validation.study.checks import Check, Study


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A run folder in which only checks were written."""
    checks = (
        Check("force", 1e-16, 1e-12, "N", "Rounding."),
        Check("way", 1.0, 1e-9, "m", "Planted."),
    )
    Study("Dynamics", checks).write(tmp_path / "validation.json")
    return tmp_path


def test_writes_the_page_and_ends_with_where_it_is(
    run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["report", str(run)]) == 0
    printed = capsys.readouterr().out
    assert "1 of 2" in printed
    # There is no agent to export.
    assert printed.splitlines()[-3:] == [
        f"The report is {run}/report.html.",
        "Next:",
        "  rans list AGENTS",
    ]
    assert "Something has failed." in (run / "report.html").read_text("utf-8")


@pytest.mark.parametrize("within", ["", "best"])
def test_the_agent_of_a_training_or_a_sweep_is_what_to_export(within: str, run: Path) -> None:
    folder = run / within
    folder.mkdir(exist_ok=True)
    (folder / "agent.safetensors").touch()
    assert Report(run).following() == (f"rans export {folder} --format c",)


def test_a_report_can_be_written_again(run: Path) -> None:
    assert main(["report", str(run)]) == 0
    (run / "validation.json").write_text(json.dumps({"title": "Later", "checks": []}))
    assert main(["report", str(run)]) == 0
    assert "Later" in (run / "report.html").read_text("utf-8")
