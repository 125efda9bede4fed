from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace

import pytest

from rans import GoToPose, PPOSettings
from tests.support.engines import PLATFORM
from validation.speed import training
from validation.speed.measurement import Clock
from validation.speed.training import trainer_rate

SETTINGS = PPOSettings(n_envs=8, n_steps=4, batch_size=16, layers=(6, 5), n_epochs=3)


class Timed(Clock):
    """Calls a function once and finds that it took half a second, after three to warm up."""

    def time(self, function: Callable[[], object]) -> tuple[float, float]:
        function()
        return 0.5, 3.0


def test_trained_steps_are_those_of_the_whole_rollout(monkeypatch):
    """8 environments x 4 steps in half a second, flown and learned from; epochs do not count twice."""
    done = []
    learner = SimpleNamespace(learn=lambda: done.append("learn"))
    monkeypatch.setattr(training, "begin", lambda *_: learner)
    found = trainer_rate(PLATFORM, GoToPose(), SETTINGS, Timed("cpu"))
    assert done == ["learn"]
    assert (found.value, found.unit, found.warm_up) == (
        pytest.approx(8 * 4 / 0.5 / 1e6),
        "M steps/s",
        3.0,
    )
    assert found.name == "PPO, floating-platform, 8 x 4"
    assert found.note == "environments x steps; 6x5, 3 epochs, float32"
