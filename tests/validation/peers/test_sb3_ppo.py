"""The script that measures plain Stable-Baselines3, with stand-ins for what takes minutes."""

from __future__ import annotations

import importlib
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rans.fast.learn.recipes import preset
from validation.peers import runner

SETTINGS = replace(preset("go-to-pose", 2, "cpu"), n_envs=8, n_steps=4, batch_size=32)


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Imported as it runs: with its own folder on the path."""
    monkeypatch.syspath_prepend(str(Path(runner.__file__).parent))
    return importlib.import_module("sb3_ppo")


class Model:
    """Learns nothing, and takes so many seconds for it."""

    policy: Any = None

    def __init__(self, now: list[float], seconds: float) -> None:
        self.num_timesteps = 0
        self._now = now
        self._seconds = seconds

    def learn(self, steps: int, reset_num_timesteps: bool) -> None:
        assert not reset_num_timesteps
        self.num_timesteps += steps
        self._now[0] += self._seconds


def train(
    script: Any, monkeypatch: pytest.MonkeyPatch, successes: list[float], seconds: float
) -> Any:
    now = [0.0]
    found = iter(successes)
    selection = SimpleNamespace(judge=lambda: [{"success": next(found)}])
    monkeypatch.setattr(script, "_model", lambda *_: Model(now, seconds))
    monkeypatch.setattr(script, "network_of", lambda _: None)
    monkeypatch.setattr(script, "Selection", lambda *_: selection)
    monkeypatch.setattr(script.time, "perf_counter", lambda: now[0])
    return script._train(SETTINGS, "cpu")


def test_solved_is_two_good_reports_in_a_row(script: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """The first good one is followed by a bad one: four reports of 16 x 8 x 4 steps, 2.5 s each."""
    found = train(script, monkeypatch, [0.996, 0.994, 0.995, 1.0], 2.5)
    assert found == {"solved": True, "seconds_to_success": 10.0, "steps_to_success": 4 * 16 * 8 * 4}


def test_after_five_minutes_it_is_given_up(script: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    found = train(script, monkeypatch, [0.0, 0.9, 1.0], 100.0)
    assert found == {
        "solved": False,
        "seconds_to_success": 300.0,
        "steps_to_success": 3 * 16 * 8 * 4,
    }


def test_it_has_our_settings_and_our_rewards(script: Any) -> None:
    """Rewards times the factor that our trainer applies itself."""
    settings = replace(SETTINGS, reward_scale=0.25, gamma=0.91, learning_rate=2e-4)
    model = script._model(settings, "cpu")
    assert (model.n_envs, model.n_steps, model.batch_size, model.gamma) == (8, 4, 32, 0.91)
    assert model.learning_rate == 2e-4
    environment = model.get_env()
    environment.reset()
    environment.venv.step_async(np.zeros((8, 8)))
    plain = environment.venv.step_wait
    environment.venv.step_wait = lambda: (None, np.array([4.0, -8.0]), None, None)
    assert environment.step_wait()[1].tolist() == [1.0, -2.0]
    plain()
