"""How long a training is worth: any task and spacecraft, with what the longer ones need."""

from __future__ import annotations

import pytest

from rans.errors import ConfigError
from rans.fast.learn.recipes import training_of_quality
from rans.tasks import TASKS


@pytest.mark.parametrize("task", [name for name in TASKS if ":" not in name])
def test_every_task_has_each_quality(task: str) -> None:
    """A longer one trains to its end; the spacecraft and the length of episodes are the task's own."""
    quick = training_of_quality(task, None, "quick", "cpu")
    assert quick.solved_share is not None
    for quality in ("good", "best"):
        config = training_of_quality(task, None, quality, "cpu")
        assert config.solved_share is None
        assert config.task == task
        assert config.spacecraft == quick.spacecraft
        assert config.timing == quick.timing


def test_ones_own_spacecraft_and_conditions() -> None:
    config = training_of_quality("go-to-pose", "atmos", "good", "cpu", randomized=True)
    assert config.spacecraft == "atmos"
    assert (config.ppo.memory.kind, config.ppo.privileged_critic) == ("history", True)
    assert config.conditions.or_none is None
    assert training_of_quality("go-to-pose", "atmos", "good", "cpu").ppo.memory.kind == "none"


@pytest.mark.parametrize(
    ("task", "quality", "said"),
    [
        ("go-to-pose-2d", "good", "is a recipe, which has its own length"),
        ("mine.toml", "best", "is a recipe, which has its own length"),
        ("go-to-pose", "god", r"quality must be one of .*\(did you mean good\?\)"),
        ("go-to-poze", "good", r"\(did you mean go-to-pose\?\)"),
    ],
)
def test_qualities_that_are_none(task: str, quality: str, said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        training_of_quality(task, None, quality, "cpu")  # type: ignore[arg-type]
