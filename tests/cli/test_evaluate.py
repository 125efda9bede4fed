from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from rans.cli import main
from tests.fast.training import tiny_trainer


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run folder with a briefly trained agent."""
    path = tmp_path_factory.mktemp("runs") / "first"
    tiny_trainer(path).train(lambda _: None)
    return path


@pytest.fixture
def run_folder(trained: Path, tmp_path: Path) -> Path:
    """A copy that a test may change."""
    return Path(shutil.copytree(trained, tmp_path / "run"))


def refused(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    assert main(["evaluate", *arguments]) == 2
    captured = capsys.readouterr()
    assert captured.err.count("\n") == 1
    return captured.err


def test_both_engines(capsys: pytest.CaptureFixture[str], run_folder: Path) -> None:
    """The second evaluation keeps what the first one wrote, and the motion is the same."""
    for engine in ("fast", "drake"):
        assert main(["evaluate", str(run_folder), "--episodes", "6", "--engine", engine]) == 0
        text = capsys.readouterr().out.replace("\n", "")
        assert str(run_folder / "evaluation.json") in text
    written = json.loads((run_folder / "evaluation.json").read_text())
    assert written.keys() == {"fast", "drake"}
    assert (run_folder / "evaluation.svg").read_text().startswith("<?xml")


def test_the_seed_decides(run_folder: Path) -> None:
    results = []
    for seed in ("1", "1", "2"):
        assert main(["evaluate", str(run_folder), "--episodes", "6", "--seed", seed]) == 0
        results.append(json.loads((run_folder / "evaluation.json").read_text())["fast"])
    assert results[0] == results[1] != results[2]


def test_wrong_arguments(capsys: pytest.CaptureFixture[str], run_folder: Path, tmp_path: Path) -> None:
    assert "--episodes must be >= 1, got 0" in refused(capsys, str(run_folder), "--episodes", "0")
    assert "is not a run folder" in refused(capsys, str(tmp_path / "nowhere"))
    (run_folder / "policy.zip").write_bytes(b"rubbish")
    assert "policy.zip is damaged" in refused(capsys, str(run_folder))
    (run_folder / "policy.zip").unlink()
    assert "no policy.zip yet" in refused(capsys, str(run_folder))
