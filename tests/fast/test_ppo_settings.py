"""What `rans.fast.PPO` refuses, and that it can change its environment."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from rans.errors import ConfigError, NonFiniteState
from rans.fast.engine import Engine
from rans.fast.ppo import PPO
from rans.fast.sb3 import SB3VecEnv
from tests.fast.engines import NEAR, PLATFORM, SHORT
from tests.fast.training import weights


def environment(count: int = 16) -> SB3VecEnv:
    return SB3VecEnv(Engine(PLATFORM, NEAR, count, SHORT))


@pytest.mark.parametrize(("settings", "named"), [
    ({"clip_range": lambda left: 0.2 * left}, "a schedule of clip_range"),
    ({"learning_rate": lambda left: 1e-3 * left}, "a schedule of learning_rate with desired_kl"),
    ({"policy_kwargs": {"share_features_extractor": False}}, "share_features_extractor=False"),
    ({"target_kl": 0.1}, "target_kl"),
])
def test_what_it_does_not_do_is_refused(settings: dict[str, Any], named: str) -> None:
    with pytest.raises(ConfigError, match=named):
        PPO("MlpPolicy", environment(), n_steps=16, device="cpu", **settings)


def test_a_learning_rate_schedule_is_followed_without_a_desired_kl() -> None:
    model = PPO("MlpPolicy", environment(), n_steps=16, desired_kl=None, device="cpu",
                learning_rate=lambda left: 1e-3 * left)
    model.learn(2 * 16 * 16, log_interval=1000)
    # After the second and last rollout nothing is left.
    assert float(model.policy.optimizer.param_groups[0]["lr"]) == 0.0


def test_sizes_that_do_not_fit_are_refused_before_sb3_warns() -> None:
    with pytest.raises(ConfigError, match="batch_size must be a multiple of n_steps = 16"):
        PPO("MlpPolicy", environment(), n_steps=16, batch_size=100, device="cpu")
    assert PPO("MlpPolicy", environment(), n_steps=16, device="cpu").batch_size == 64


def test_an_agent_without_an_environment_gets_one(tmp_path: Path) -> None:
    PPO("MlpPolicy", environment(), n_steps=16, device="cpu").save(tmp_path / "policy.zip")
    model = PPO.load(tmp_path / "policy.zip", device="cpu")
    model.set_env(environment())
    before = weights(model.policy)
    model.learn(256, log_interval=1000)
    assert (weights(model.policy) != before).any()


def test_episodes_end_at_different_times_after_every_fresh_start() -> None:
    model = PPO("MlpPolicy", environment(), n_steps=16, device="cpu")
    for _ in range(2):
        model.learn(1, log_interval=1000)
        steps = model.env.engine.save_state()["buffers"][-2]  # type: ignore[union-attr]
        assert len(set(steps.tolist())) > 4


def test_an_infinite_gradient_is_noticed_in_the_same_update() -> None:
    model = PPO("MlpPolicy", environment(), n_steps=16, batch_size=256, n_epochs=1, device="cpu")
    model.policy.value_net.weight.register_hook(lambda gradient: gradient * float("inf"))
    with pytest.raises(NonFiniteState, match="not finite"):
        model.learn(1, log_interval=1000)
