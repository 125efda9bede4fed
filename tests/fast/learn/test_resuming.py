"""Trainings that were stopped or killed end as if nothing was; what cannot be resumed says so."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from rans import ConfigError
from rans.episode.flight import fly
from rans.episode.scenario import scenarios
from rans.evaluation.fly.agent import load_policy
from rans.fast.learn.config import FilterSettings, MemorySettings
from rans.fast.learn.run_folder import RunFolder
from rans.fast.learn.trainer import Trainer
from tests.support.training import (
    CONFIG,
    EASY,
    TINY,
    after,
    everything,
    ignore,
    resumed,
    tiny_trainer,
)

WHOLE = replace(CONFIG, report_interval=4)


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> Trainer:
    """A training that nobody stopped, with a report every four iterations."""
    trainer = tiny_trainer(tmp_path_factory.mktemp("whole") / "run", WHOLE)
    trainer.train(ignore)
    return trainer


def test_a_resumed_training_ends_as_if_never_stopped(whole, tmp_path):
    """Stopped between reports; the same reports are made but for the one at the stop."""
    stop_at = 5
    tiny_trainer(tmp_path / "cut", WHOLE).train(ignore, after(stop_at))
    trainer = resumed(tmp_path / "cut")
    assert trainer.steps == stop_at * 128
    torch.manual_seed(99)  # what happens between stop and resume is of no account
    trainer.train(ignore)
    assert everything(trainer) == everything(whole)
    reports = [row["steps"] for row in whole.run.metrics()]
    assert reports == [512, 1024, 1536, 2048]
    assert [row["steps"] for row in trainer.run.metrics()] == sorted({*reports, stop_at * 128})
    for ours, theirs in zip(trainer.run.metrics(), whole.run.metrics(), strict=False):
        if ours["steps"] == theirs["steps"] > stop_at * 128:
            assert ours["success"] == theirs["success"]
            assert ours["train/loss"] == theirs["train/loss"]


def test_rows_after_the_checkpoint_are_taken_again(tmp_path):
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


def test_without_a_checkpoint_it_starts_over(whole, tmp_path):
    RunFolder(tmp_path / "cut").begin(WHOLE, "rans train")
    RunFolder(tmp_path / "cut").append_metrics({"steps": 128, "seconds": 0.1, "success": 0.0})
    trainer = resumed(tmp_path / "cut")
    trainer.train(ignore)
    assert everything(trainer) == everything(whole)
    assert [row["steps"] for row in trainer.run.metrics()] == [512, 1024, 1536, 2048]


@pytest.mark.slow
@pytest.mark.parametrize(
    "kind",
    [
        {"memory": MemorySettings(2), "privileged_critic": True},
        {"filters": FilterSettings((0.01, 1.0))},
    ],
    ids=["history and privileged", "filters"],
)
def test_what_remembers_resumes_bit_by_bit_too(tmp_path, kind):
    config = replace(CONFIG, ppo=replace(TINY, symmetric=False, **kind), total_timesteps=768)
    whole = tiny_trainer(tmp_path / "whole", config)
    whole.train(ignore)
    tiny_trainer(tmp_path / "cut", config).train(ignore, after(3))
    trainer = resumed(tmp_path / "cut")
    trainer.train(ignore)
    assert everything(trainer) == everything(whole)
    loaded = load_policy(tmp_path / "cut")
    agent = loaded.controller
    craft = loaded.craft
    task = loaded.task
    timing = loaded.timing
    starts = scenarios(task.for_evaluation(), craft, 1, 8)
    flights = [fly(craft, task, agent, starts, timing) for _ in range(2)]
    np.testing.assert_array_equal(flights[0].commands, flights[1].commands)  # it forgets in between


def test_a_finished_training_is_left_alone(tmp_path):
    config = replace(CONFIG, settings=EASY, solved_share=1.0, report_interval=1)
    trainer = tiny_trainer(tmp_path / "run", config)
    trainer.train(ignore)
    assert trainer.solved
    assert trainer.steps == 2 * 128
    again = resumed(tmp_path / "run")
    again.train(lambda _: pytest.fail("it trained on"))
    assert again.solved
    assert everything(again) == everything(trainer)


def test_an_agent_without_a_checkpoint_is_not_lost(tmp_path):
    """To resume would begin anew and write over it."""
    tiny_trainer(tmp_path / "run").train(ignore)
    (tmp_path / "run" / "checkpoint.safetensors").unlink()
    with pytest.raises(
        ConfigError, match=r"agent without a checkpoint .* anew from .*config\.json"
    ):
        resumed(tmp_path / "run")
    assert len(RunFolder(tmp_path / "run").metrics()) == 1
