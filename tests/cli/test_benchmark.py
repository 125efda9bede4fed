from __future__ import annotations

import json
from pathlib import Path

import pytest
import torch

from rans.cli import main


@pytest.fixture(autouse=True)
def _wide(monkeypatch: pytest.MonkeyPatch) -> None:
    """Tables are as wide as they need to be."""
    monkeypatch.setenv("COLUMNS", "160")


@pytest.mark.slow  # compiles the engine
@pytest.mark.filterwarnings("ignore:.*torch.jit.script_method:DeprecationWarning")  # torch's own
def test_figures(capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("validation.speed._REPEATS", 2)
    monkeypatch.setattr("validation.speed._REPEAT_SECONDS", 0.01)
    file = tmp_path / "speed.json"
    arguments = ["--device", "cpu", "--num-envs", "64", "--output", str(file)]
    assert main(["benchmark", *arguments]) == 0
    text = capsys.readouterr().out
    for part in ("memory copy", "floating-platform, 64 environments", "PPO, floating-platform", "M steps/s"):
        assert part in text
    content = json.loads(file.read_text())
    assert [row["unit"] for row in content["measurements"]] == ["GB/s", "M steps/s", "M steps/s"]
    assert all(row["value"] > 0 < row["warm_up"] for row in content["measurements"])
    assert content["environment"]["device"] == "CPU"


@pytest.mark.parametrize(("arguments", "message"), [
    (["--device", "tpu"], "device must be cpu or cuda, got 'tpu'"),
    (["--device", "cpu", "--num-envs", "0"], "must be a whole number >= 1, got 0"),
    (["--task", "hover"], "no task named 'hover'"),
    (["--spacecraft", "nowhere.toml"], "nowhere.toml"),
    pytest.param(["--device", "cuda"], "torch sees no CUDA device", marks=pytest.mark.skipif(
        torch.cuda.is_available(), reason="there is a CUDA device")),
])
def test_wrong_arguments(capsys: pytest.CaptureFixture[str], arguments: list[str], message: str) -> None:
    assert main(["benchmark", *arguments]) == 2
    assert message in capsys.readouterr().err


def test_without_a_compiler(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("CXX", raising=False)
    monkeypatch.setenv("PATH", "/nowhere")
    assert main(["benchmark", "--device", "cpu"]) == 2
    assert "needs a C++ compiler" in capsys.readouterr().err
