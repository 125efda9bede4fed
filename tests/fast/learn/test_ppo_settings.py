"""What `rans.fast.PPO` refuses, how its step size moves, and that it can change its environment."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import torch
from stable_baselines3.common.logger import Logger

from rans.errors import ConfigError, NonFiniteState
from rans.fast.engine import Engine
from rans.fast.envs.sb3 import SB3VecEnv
from rans.fast.learn.ppo import PPO
from tests.fast.engines import NEAR, PLATFORM, SHORT
from tests.fast.training import tiny_ppo, weights


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
    env = environment()
    engine, model = env.engine, PPO("MlpPolicy", env, n_steps=16, device="cpu")
    for _ in range(2):
        model.learn(1, log_interval=1000)
        steps = engine.save_state()["buffers"][-1] & engine._world.step_mask
        assert len(set(steps.tolist())) > 4


def test_an_infinite_gradient_is_noticed_in_the_same_update() -> None:
    model = PPO("MlpPolicy", environment(), n_steps=16, batch_size=256, n_epochs=1, device="cpu")
    model.policy.value_net.weight.register_hook(lambda gradient: gradient * float("inf"))
    with pytest.raises(NonFiniteState, match="not finite"):
        model.learn(1, log_interval=1000)


def test_step_size_follows_the_divergence() -> None:
    model = tiny_ppo(desired_kl=0.01, learning_rate=1e-3)
    rate = model.policy.optimizer.param_groups[0]["lr"]
    expected = {0.021: 1e-3 / 1.5, 0.0049: 1e-3, 0.0051: 1e-3, 0.019: 1e-3, 1e9: 1e-3 / 1.5}
    for kl, wanted in expected.items():
        model._adapt(torch.tensor(kl))
        assert float(rate) == pytest.approx(wanted, rel=1e-6)
    for kl, bound in ((1.0, 1e-5), (0.0, 1e-2)):
        for _ in range(30):
            model._adapt(torch.tensor(kl))
        assert float(rate) == pytest.approx(bound, rel=1e-6)


def test_the_step_size_falls_to_zero_over_the_last_share() -> None:
    """Bounded by 4e-3 until half of the steps remain, then in proportion to what remains."""
    model = tiny_ppo(desired_kl=0.01, learning_rate=1e-3, max_learning_rate=4e-3, anneal=0.5)
    rate = model.policy.optimizer.param_groups[0]["lr"]
    for remaining, bound in ((1.0, 4e-3), (0.5, 4e-3), (0.25, 2e-3), (0.0, 0.0)):
        model.slow_down(remaining)
        for _ in range(30):
            model._adapt(torch.tensor(0.0))
        assert float(rate) == pytest.approx(bound, rel=1e-6)


def test_constant_step_size() -> None:
    model = tiny_ppo(desired_kl=None, learning_rate=2e-3)
    model.set_logger(Logger(None, []))
    model.learn(512, log_interval=None)  # type: ignore[arg-type]
    assert float(model.policy.optimizer.param_groups[0]["lr"]) == pytest.approx(2e-3, rel=1e-6)
