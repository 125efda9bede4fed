"""Trainings behind a safety filter: the agent flies and is judged with what the filter lets through."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch

from rans.errors import ConfigError
from rans.evaluation.fly.controllers import guard_of
from rans.fast.learn.run_folder import RunFolder
from rans.fast.learn.trainer import Trainer
from tests.support.engines import PLATFORM
from tests.support.training import CONFIG, newest, tiny_trainer

GUARDED = replace(CONFIG, guard=True)


class Shut:
    """Lets nothing through."""

    def admitted(self, world: Any, state: Any, goal: Any, command: Any) -> Any:
        """All thrusters shut."""
        return tuple(one * 0.0 for one in command), command[0] >= 0.0


def trained_behind(guard: Any, folder: Path) -> tuple[Trainer, list[dict[str, Any]]]:
    """A short training, and its rows of metrics."""
    run = RunFolder(folder)
    run.begin(GUARDED, "test")
    trainer = Trainer([GUARDED], PLATFORM, run, guard=guard)
    rows: list[dict[str, Any]] = []
    trainer.train(newest(rows))
    return trainer, rows


def test_nothing_moves_where_nothing_is_let_through(tmp_path: Path) -> None:
    """Episodes begin at rest, and there is no disturbance."""
    trainer, rows = trained_behind(Shut(), tmp_path / "shut")
    assert rows[-1]["success"] == 0.0
    engine = trainer.engine
    engine.reset()
    before = {name: error.clone() for name, error in engine.errors().items()}
    assert before["position"].min() > 0.0
    for _ in range(3):
        engine.step(torch.ones(engine.num_envs, len(PLATFORM.commands)))
    for name, error in engine.errors().items():
        assert torch.equal(error, before[name]), name


def test_what_cannot_be(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="needs a safety filter"):
        tiny_trainer(tmp_path / "none", GUARDED)
    with pytest.raises(ConfigError, match="has none"):
        guard_of(GUARDED, PLATFORM)
    assert guard_of(CONFIG, PLATFORM) is None
