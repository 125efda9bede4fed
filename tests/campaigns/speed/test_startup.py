from __future__ import annotations

import time
from pathlib import Path

import pytest

from campaigns.speed.startup import PARTS, measured

ROOT = Path(__file__).parents[3]


def test_parts_are_all_of_a_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(ROOT)
    begun = time.time()
    parts = measured(["--version"], tmp_path / "parts.json")
    took = time.time() - begun
    assert capfd.readouterr().out.startswith("rans ")
    assert sum(parts.values()) == pytest.approx(took, abs=0.2)  # of reading a small file
    assert all(seconds > 0 for seconds in parts.values())
    # Importing rans takes thirty looks.
    assert "import Gymnasium and NumPy" in parts


def test_every_part_is_somewhere() -> None:
    """Functions that others renamed would be counted as anything else."""
    for _, place in PARTS:
        file, _, function = place.partition(":")
        if file.startswith("rans/") and function != "<module>":
            assert f"def {function}(" in (ROOT / file).read_text("utf-8"), place
