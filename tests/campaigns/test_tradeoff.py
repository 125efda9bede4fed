from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

import campaigns.tradeoff as tradeoff
from campaigns.command import ended
from campaigns.tradeoff import Tradeoff, Trained, _said, tradeoff_figure
from rans.fast.learn.config import TrainConfig
from rans.fast.learn.recipes import preset
from validation.speed.training import Success


@pytest.mark.slow
def test_only_the_number_of_environments_differs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And with it minibatches and iterations between reports, so that both hold as many steps as before."""
    asked: list[tuple[Any, ...]] = []

    def stand_in(*arguments: Any) -> Success:
        asked.append(arguments)
        return Success(True, 2.0, 0.0, 3_000_000)

    monkeypatch.setattr(tradeoff, "train_until_solved", stand_in)
    Tradeoff(num_envs=(64, 256), seeds=2, output=tmp_path / "x.json").run()
    usual = preset("go-to-pose", 2, "cpu")
    rollout = usual.n_envs * usual.n_steps
    assert [(a[0].n_envs, a[3]) for a in asked] == [(64, 0), (64, 1), (256, 0), (256, 1)]
    for settings, device, spacecraft, _, interval in asked:
        assert (device, spacecraft) == ("cpu", "floating-platform")
        assert settings.n_envs * settings.n_steps == 4 * settings.batch_size
        assert (
            interval * settings.n_envs * settings.n_steps == TrainConfig.report_interval * rollout
        )
    rows = json.loads((tmp_path / "x.json").read_text())["trainings"]
    assert rows[2] == {
        "num_envs": 256,
        "seed": 0,
        "solved": True,
        "seconds": 2.0,
        "warm_up": 0.0,
        "steps": 3_000_000,
    }
    assert (tmp_path / "x.svg").read_text().startswith("<?xml")


def test_an_interrupt_loses_no_training_that_ended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ends = iter([Success(True, 2.0, 0.0, 10**6)])

    def stand_in(*_: Any) -> Success:
        if (end := next(ends, None)) is None:
            raise KeyboardInterrupt
        return end

    monkeypatch.setattr(tradeoff, "train_until_solved", stand_in)
    monkeypatch.setattr(
        "sys.argv", ["tradeoff", "--num-envs", "64", "--output", str(tmp_path / "x.json")]
    )
    assert ended("tradeoff", tradeoff.main) == 130
    assert len(json.loads((tmp_path / "x.json").read_text())["trainings"]) == 1


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (
            ["--num-envs", "66"],
            "--num-envs must be multiples of 4, the number of minibatches, got 66.",
        ),
        (["--seeds", "0"], "--seeds must be >= 1, got 0."),
        (["--spacecraft", "nobody"], "nobody"),
    ],
)
def test_wrong_values_are_sentences(
    given: list[str], said: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", ["tradeoff", *given])
    assert ended("tradeoff", tradeoff.main) == 2
    assert said in capsys.readouterr().err


def test_steps_are_shown_in_millions() -> None:
    figure = tradeoff_figure(
        "",
        [
            Trained(32, seed, Success(True, 1.0, 0.0, steps))
            for seed, steps in enumerate((2_000_000, 500_000, 8_000_000))
        ],
    )
    line, *marks = figure.axes[1].lines
    assert [(x, y) for x, y in line.get_xydata()] == [(32, 2.0)]  # type: ignore[union-attr]
    assert [float(mark.get_ydata()[0]) for mark in marks] == [2.0, 0.5, 8.0]  # type: ignore[index]
    assert figure.axes[1].get_ylabel() == "million steps"


def test_the_figure_joins_medians_and_shows_what_was_not_solved() -> None:
    ends = {32: (5.0, 9.0, 8.0), 128: (3.0, 4.0, 8.0)}
    figure = tradeoff_figure(
        "",
        [
            Trained(count, seed, Success(seconds < 9.0, seconds, 0.0, 10**6))
            for count, found in ends.items()
            for seed, seconds in enumerate(found)
        ],
    )
    line, *marks = figure.axes[0].lines
    assert [(x, y) for x, y in line.get_xydata()] == [(32, 8.0), (128, 4.0)]  # type: ignore[union-attr]
    assert [mark.get_fillstyle() for mark in marks].count("none") == 1


@pytest.mark.parametrize(("solved", "said"), [(True, "solved"), (False, "not solved")])
def test_what_a_training_of_the_tradeoff_says(solved: bool, said: str) -> None:
    assert _said(Success(solved, 1.234, 9.0, 2_500_000)) == (
        f"{said} after 1.23 s of training, 2.50 M steps"
    )
