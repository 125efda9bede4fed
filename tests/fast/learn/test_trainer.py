from __future__ import annotations

import contextlib
import random
import subprocess
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from rans.errors import ConfigError
from rans.fast.learn.config import PPOSettings
from rans.fast.learn.run_folder import RunFolder
from rans.fast.learn.trainer import Trainer, check_device, run_path
from rans.model.timing import Timing
from rans.tasks import GoToPose
from tests.fast.training import CONFIG, TINY, after, ignore, resumed, tiny_trainer, weights
from tests.processes import python

ROOT = Path(__file__).parents[2]
EASY = GoToPose(spawn_distance=(0.5, 1.0), evaluation_distance=(0.5, 1.0), position_tolerance=9.0,
                attitude_tolerance=4.0)
"""Solved by whoever does not fail."""


def everything(trainer: Trainer) -> list[Any]:
    """All that decides how a training goes on, in comparable form."""
    saved = trainer._checkpoint()
    flat = [saved["steps"], saved["generator"].tolist(), saved["engine"]["seed"]]
    flat += [buffer.tolist() for buffer in saved["engine"]["buffers"]]
    return [*flat, weights(trainer.model.policy).tolist(), repr(saved["optimizer"])]


def test_same_config_same_bits(tmp_path: Path) -> None:
    results = []
    for name, seed in (("a", 4), ("b", 4), ("c", 5)):
        trainer = tiny_trainer(tmp_path / name, replace(CONFIG, seed=seed))
        trainer.train(ignore)
        results.append(everything(trainer))
    assert results[0] == results[1]
    assert results[0] != results[2]


TRAIN = """
import sys, torch
from pathlib import Path
from rans.fast.learn.run_folder import RunFolder, read_config
from rans.fast.learn.trainer import Trainer
torch.set_num_threads(1)
run = RunFolder(Path(sys.argv[1]))
trainer = Trainer(run.config(), run.spacecraft(), run)
trainer.resume()
trainer.train(lambda row: print(row["steps"], flush=True))
"""
"""A training in another process."""


def run_script(script: str, path: Path) -> contextlib.AbstractContextManager[subprocess.Popen[str]]:
    return python("-c", script, str(path), cwd=ROOT)


def test_another_process_gets_the_same_bits(tmp_path: Path) -> None:
    RunFolder(tmp_path / "there").begin(CONFIG, "rans train")
    with run_script(TRAIN, tmp_path / "there") as process:
        trainer = tiny_trainer(tmp_path / "here")
        trainer.train(ignore)
        _, errors = process.communicate()
    assert process.returncode == 0, errors
    assert everything(resumed(tmp_path / "there")) == everything(trainer)


@pytest.mark.parametrize("stop_at", [1, 5, 8])
def test_a_resumed_training_ends_as_if_never_stopped(tmp_path: Path, stop_at: int) -> None:
    """Wherever it was stopped; the same reports are made but for the one at the stop."""
    config = replace(CONFIG, report_interval=4)
    whole = tiny_trainer(tmp_path / "whole", config)
    whole.train(ignore)
    tiny_trainer(tmp_path / "cut", config).train(ignore, after(stop_at))
    trainer = resumed(tmp_path / "cut")
    assert trainer.model.num_timesteps == stop_at * 128
    torch.manual_seed(99)  # what happens between stop and resume is of no account
    trainer.resume()
    trainer.train(ignore)
    assert everything(trainer) == everything(whole)
    rows = {name: [row["steps"] for row in RunFolder(tmp_path / name).metrics()] for name in ("whole", "cut")}
    assert rows["whole"] == [512, 1024, 1536, 2048]
    assert rows["cut"] == sorted({*rows["whole"], stop_at * 128})
    for ours, theirs in zip(trainer.run.metrics(), whole.run.metrics(), strict=False):
        if ours["steps"] == theirs["steps"] > stop_at * 128:
            assert ours["success"] == theirs["success"]
            assert ours["train/loss"] == theirs["train/loss"]


def test_rows_after_the_checkpoint_are_taken_again(tmp_path: Path) -> None:
    """Killed between checkpoints: later rows are dropped, also a row that was only half written."""
    config = replace(CONFIG, report_interval=2)
    trainer = tiny_trainer(tmp_path / "run", config)
    trainer.train(ignore, after(4))
    checkpoint = trainer.run.checkpoint_file.read_bytes()
    trainer.train(ignore, after(5))
    trainer.run.checkpoint_file.write_bytes(checkpoint)
    with trainer.run.metrics_file.open("a") as file:
        file.write('{"steps": 99999, "succ')
    again = resumed(tmp_path / "run")
    assert [row["steps"] for row in again.run.metrics()] == [256, 512]
    again.train(ignore)
    assert [row["steps"] for row in again.run.metrics()] == list(range(256, 2049, 256))


def test_killed_at_any_moment(tmp_path: Path) -> None:
    """SIGKILL, again and again, with a checkpoint after every iteration; it ends as if nothing was."""
    config = replace(CONFIG, total_timesteps=60 * 128, report_interval=2)
    whole = tiny_trainer(tmp_path / "whole", config)
    whole.train(ignore)
    script = TRAIN.replace("torch.set_num_threads", "import rans.fast.learn.trainer as t; "
                           "t._CHECKPOINT_SECONDS = 0; torch.set_num_threads")
    RunFolder(tmp_path / "cut").begin(config, "rans train")
    moments = random.Random(3)
    for kill in (True, True, False):
        with run_script(script, tmp_path / "cut") as process:
            if kill:
                assert process.stdout is not None
                process.stdout.readline()
                time.sleep(moments.uniform(0, 0.05))
                process.kill()
            _, errors = process.communicate()
        assert kill or process.returncode == 0, errors
    assert everything(resumed(tmp_path / "cut")) == everything(whole)
    steps = [row["steps"] for row in RunFolder(tmp_path / "cut").metrics()]
    assert steps == [row["steps"] for row in whole.run.metrics()]


def test_without_a_checkpoint_it_starts_over(tmp_path: Path) -> None:
    whole = tiny_trainer(tmp_path / "whole")
    whole.train(ignore)
    RunFolder(tmp_path / "cut").begin(CONFIG, "rans train")
    RunFolder(tmp_path / "cut").append_metrics({"steps": 128})
    trainer = resumed(tmp_path / "cut")
    trainer.train(ignore)
    assert everything(trainer) == everything(whole)
    assert [row["steps"] for row in trainer.run.metrics()] == [2048]


def test_what_a_run_holds(tmp_path: Path) -> None:
    rows: list[dict[str, Any]] = []
    trainer = tiny_trainer(tmp_path / "run", replace(CONFIG, report_interval=8))
    trainer.train(rows.append)
    assert rows == trainer.run.metrics()
    assert [row["steps"] for row in rows] == [1024, 2048]
    assert rows[0]["seconds"] < rows[1]["seconds"] == pytest.approx(trainer.seconds, abs=1e-3)
    rate = 1024 / (rows[1]["seconds"] - rows[0]["seconds"])
    assert rows[1]["steps_per_s"] == pytest.approx(rate, rel=0.1)  # seconds are rounded to milliseconds
    for key in ("success", "error/position", "error/attitude", "return/position", "return/thrust",
                "train/loss", "rollout/success_rate"):
        assert np.isfinite(rows[1][key]), key
    names = {file.name for file in (tmp_path / "run").iterdir()}
    assert names == {"config.json", "spacecraft.toml", "metrics.jsonl", "checkpoint.pt", "policy.zip",
                     "tensorboard"}
    assert len(list((tmp_path / "run" / "tensorboard").iterdir())) == 1


def test_solved_twice_in_a_row(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One lucky report does not end a training; nor does a stop between reports make two of one."""
    config = replace(CONFIG, report_interval=2, solved_share=0.9, total_timesteps=10_000)
    found = iter([0.95, 0.2, 0.9, 0.91, 0.99, 0.99])
    trainer = tiny_trainer(tmp_path / "run", config)
    monkeypatch.setattr(trainer.selection, "judge", lambda: (next(found), {"position": 1.0}))
    trainer.train(ignore, after(7))  # reports at iterations 2, 4, 6, and at 7 because of the stop
    assert [row["success"] for row in trainer.run.metrics()] == [0.95, 0.2, 0.9, 0.91]
    assert not trainer.solved
    again = resumed(tmp_path / "run")
    monkeypatch.setattr(again.selection, "judge", lambda: (next(found), {"position": 1.0}))
    again.train(ignore)
    assert again.solved
    assert again.model.num_timesteps == 8 * 128


def test_a_finished_training_is_left_alone(tmp_path: Path) -> None:
    config = replace(CONFIG, settings=EASY, solved_share=1.0, report_interval=1)
    trainer = tiny_trainer(tmp_path / "run", config)
    trainer.train(ignore)
    assert trainer.solved
    assert trainer.model.num_timesteps == 2 * 128
    again = resumed(tmp_path / "run")
    again.train(lambda _: pytest.fail("it trained on"))
    assert again.solved
    assert everything(again) == everything(trainer)


def test_a_warm_up_that_takes_all_steps_is_reported(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As where few steps are wanted of a GPU, which compiles and records in the first iterations."""
    trainer = tiny_trainer(tmp_path / "run", replace(CONFIG, total_timesteps=384))
    monkeypatch.setattr(trainer, "_warm_up", lambda: [trainer._iterate() for _ in range(3)])
    trainer.train(ignore)
    assert [row["steps"] for row in trainer.run.metrics()] == [384]


def test_an_agent_without_a_checkpoint_is_not_lost(tmp_path: Path) -> None:
    """A sweep leaves such a one; to resume would begin anew and write over it."""
    tiny_trainer(tmp_path / "run").train(ignore)
    (tmp_path / "run" / "checkpoint.pt").unlink()
    with pytest.raises(ConfigError, match=r"agent without a checkpoint .* anew with --config .*config\.json"):
        resumed(tmp_path / "run")
    assert len(RunFolder(tmp_path / "run").metrics()) == 1


def test_it_learns(tmp_path: Path) -> None:
    """From 3 to 4 m away to the goal: five seeds were within 0.01 to 0.20 m after so many steps.

    The attitude is no measure: one of the five had not found it yet.
    """
    config = replace(CONFIG, ppo=PPOSettings(), timing=Timing(), total_timesteps=230_000, report_interval=28)
    rows: list[dict[str, Any]] = []
    tiny_trainer(tmp_path / "run", config).train(rows.append)
    assert rows[-1]["error/position"] < 0.6


def test_devices() -> None:
    check_device("cpu")
    for wrong in ("tpu", "gpu", "", "meta", "cuda:1"):
        with pytest.raises(ConfigError, match="device must be cpu or cuda, got"):
            check_device(wrong)
    if not torch.cuda.is_available():
        with pytest.raises(ConfigError, match="torch sees no CUDA device"):
            check_device("cuda")


def test_nothing_is_written_for_a_config_that_cannot_work(tmp_path: Path) -> None:
    run = RunFolder(tmp_path / "run")
    config = replace(CONFIG, ppo=replace(TINY, n_steps=21, batch_size=21 * 16))
    with pytest.raises(ConfigError, match="n_steps must not exceed the episode's 20 steps"):
        Trainer(config, tiny_trainer(tmp_path / "good").run.spacecraft(), run)
    assert not run.path.exists()


def test_new_folders(tmp_path: Path) -> None:
    config = replace(CONFIG, spacecraft=str(tmp_path / "mine.toml"), seed=7)
    first = run_path(config, tmp_path)
    assert first == tmp_path / "go-to-pose-mine-seed7"
    first.mkdir()
    assert run_path(config, tmp_path).name == "go-to-pose-mine-seed7-2"
