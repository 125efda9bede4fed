"""Trainings from several seeds are judged by what their flights show, and one that fails names its log."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import rans
from campaigns.seeds import Seeds, _on_gpu, judged
from rans.errors import ConfigError, RansError
from rans.files import read_json
from rans.pretrained import pretrained_folder
from rans.scenario import SELECTION_SEED


@pytest.mark.slow
def test_trains_from_every_seed_and_judges_each(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = "--device", "cpu", "--set", "total_timesteps=20000"
    asked = Seeds("go-to-position", options, (3,), at_once=1, starts=4, flights=4, output=tmp_path)
    assert asked.run() == 0
    told = tmp_path / "go-to-position-seed3" / "metrics.jsonl"
    before = told.read_bytes()
    assert asked.run() == 0  # again: nothing is left to train
    assert told.read_bytes() == before
    assert read_json(tmp_path / "go-to-position-seed3" / "config.json")["seed"] == 3
    found = read_json(tmp_path / "go-to-position.json")
    assert found["runs"] == {"go-to-position-seed3": judged(told.parent, 4, 4)}
    assert "go-to-position-seed3" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("given", "count", "shown"),
    [
        (None, 2, ["0", "1", "0"]),
        ("5,7", 2, ["5", "7", "5"]),
        ("3", 1, ["3"] * 3),
        (None, 0, [None] * 3),
    ],
)
def test_trainings_take_the_gpus_by_turns(
    given: str | None, count: int, shown: list[str | None], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("CUDA_VISIBLE_DEVICES", raising=False)
    if given is not None:
        monkeypatch.setenv("CUDA_VISIBLE_DEVICES", given)
    monkeypatch.setattr("torch.cuda.device_count", lambda: count)
    assert [_on_gpu(number).get("CUDA_VISIBLE_DEVICES") for number in range(3)] == shown


@pytest.mark.slow
def test_a_training_that_fails_names_its_log(tmp_path: Path) -> None:
    with pytest.raises(RansError, match=r"seed0 ended with 2: .*seed0\.log says why"):
        Seeds("go-to-pose", ("--device", "nowhere"), (0,), output=tmp_path).run()
    assert "nowhere" in (tmp_path / "go-to-pose-seed0.log").read_text()


@pytest.mark.parametrize("wrong", [{"seeds": ()}, {"at_once": 0}, {"starts": 0}, {"flights": -1}])
def test_refuses_to_do_nothing(wrong: dict[str, Any], tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="must name at least one"):
        Seeds("go-to-pose", output=tmp_path / "new", **wrong).run()
    assert not (tmp_path / "new").exists()


@pytest.mark.slow
def test_judges_as_an_evaluation_does() -> None:
    """Of the thrifty agent, which never arrives soon; "failed" is of other flights than the rest."""
    found = judged(pretrained_folder("go-to-pose-2d-thrifty"), 16, 16)[""]
    metrics = rans.evaluate("go-to-pose-2d-thrifty", episodes=16, seed=SELECTION_SEED)
    values = {row.name: row.value for row in metrics.rows}
    assert found["impulse"] == pytest.approx(values["impulse"])
    assert found["duty at rest"] == pytest.approx(values["duty at rest"])
    assert 100.0 * found["error"] == pytest.approx(values["position error"])
