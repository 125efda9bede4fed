"""``rans validate`` as a user runs it."""

from __future__ import annotations

import json

import validation.study
from rans.cli import main
from validation.checks import Check, Report


def test_quick_validation_passes_and_is_written(tmp_path, capsys) -> None:
    folder = tmp_path / "checked"
    code = main(["validate", "--quick", "--seed", "7", "--output", str(folder)])
    printed = capsys.readouterr().out
    assert code == 0, printed
    assert "every thruster: force" in printed
    read = json.loads((folder / "validation.json").read_text("utf-8"))
    assert read["passed"]
    assert read["settings"]["spacecraft"] == "floating-platform"
    assert read["settings"]["seed"] == 7
    assert str(len(read["checks"])) in printed


def test_a_failed_check_ends_with_code_1(monkeypatch, capsys) -> None:
    broken = Check("way flown", 1.0, 1e-9, "m", "Planted.")
    report = Report("broken", (broken,), {"seconds": 0.0})
    monkeypatch.setattr(validation.study, "study", lambda *_: report)
    assert main(["validate"]) == 1
    assert "FAIL" in capsys.readouterr().out


def test_an_unknown_spacecraft_is_one_sentence(capsys) -> None:
    assert main(["validate", "--spacecraft", "flying-saucer"]) == 2
    said = capsys.readouterr().err
    assert "flying-saucer" in said
    assert "Traceback" not in said
    assert len(said.splitlines()) == 1
