"""The campaign of exports at a small size; what it finds is tested in tests/deploy."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest

from campaigns.exports import Exports, Row
from campaigns.runner import run
from campaigns.table import CAMPAIGNS
from validation.speed.exported import c_compilers


@pytest.mark.slow
def test_a_table_of_every_form(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "validation").mkdir()
    assert run(CAMPAIGNS["exports"], Exports(("go-to-pose-2d-fast",), 250, 1), tmp_path) == 0
    file = tmp_path / "validation" / "exports.json"
    rows = json.loads(file.read_text())["rows"]
    compiled = [f"c, {name}" for name in c_compilers()]
    assert [(row["agent"], row["form"], row["observations"], row["unequal"]) for row in rows] == [
        ("go-to-pose-2d-fast", form, 250, 0) for form in ("sb3", "onnx", "numpy", *compiled)
    ]
    assert "onnx" in capsys.readouterr().out
    run(CAMPAIGNS["exports"], Exports(("go-to-pose-2d",), 250, 1), tmp_path)  # others' rows stay
    again = json.loads(file.read_text())["rows"]
    assert len(again) == 2 * len(rows)
    assert again[: len(rows)] == rows


def test_a_difference_fails() -> None:
    def failed(**difference: Any) -> bool:
        row = {**asdict(Row("a", "onnx", 10, 0, 0, 0.0)), **difference}
        return Exports().failed({"rows": [row]})

    assert failed(unequal=3, beyond_rounding=1)
    assert failed(memory=2e-4)
    assert not failed(unequal=3)  # ties
