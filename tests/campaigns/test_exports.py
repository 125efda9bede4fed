"""The campaign of exports at a small size; what it finds is tested in tests/deploy."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from campaigns import exports
from campaigns.exports import Exports, Row, Unequal
from validation.speed.exported import c_compilers


@pytest.mark.slow
def test_a_table_of_every_form(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert Exports(("go-to-pose-2d-fast",), 250, tmp_path / "exports.json", 1).run() == 0
    rows = json.loads((tmp_path / "exports.json").read_text())["rows"]
    compiled = [f"c, {name}" for name in c_compilers()]
    assert [(row["agent"], row["form"], row["observations"], row["unequal"]) for row in rows] == [
        ("go-to-pose-2d-fast", form, 250, 0) for form in ("sb3", "onnx", "numpy", *compiled)
    ]
    assert "beyond rounding" in capsys.readouterr().out
    Exports(("go-to-pose-2d",), 250, tmp_path / "exports.json", 1).run()  # the others' rows stay
    again = json.loads((tmp_path / "exports.json").read_text())["rows"]
    assert len(again) == 2 * len(rows)
    assert again[len(rows) :] == rows


@pytest.mark.slow
def test_a_difference_fails(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(exports, "unequal", lambda *_: Unequal(3, 1, 0.0))
    assert Exports(("go-to-pose-2d-fast",), 250, tmp_path / "exports.json", 1).run() == 1
    assert not Row("a", "onnx", 10, 0, 0, 2e-4).passed  # another memory
    assert Row("a", "onnx", 10, 3, 0, 0.0).passed  # ties
