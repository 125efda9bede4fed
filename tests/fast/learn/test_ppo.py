from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import stable_baselines3
import torch
from stable_baselines3.common.callbacks import BaseCallback, CheckpointCallback
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.logger import Logger
from torch import Tensor

from rans.errors import ConfigError
from rans.fast.engine import Engine
from rans.fast.envs.sb3 import SB3VecEnv
from rans.fast.learn.loss import ppo_loss
from rans.fast.learn.ppo import PPO
from rans.fast.learn.rollout import minibatches
from tests.fast.engines import FLYER, NEAR, PLATFORM, SHORT, both_crafts
from tests.fast.test_policy import seen
from tests.fast.training import sb3_twin, scatter, tiny_ppo, weights

ONE_BATCH: dict[str, Any] = {"n_envs": 32, "n_steps": 8, "batch_size": 256, "n_epochs": 1, "desired_kl": None}


def silent(model: Any) -> Any:
    model.set_logger(Logger(None, []))
    return model


def filled(craft: Any = PLATFORM, **settings: Any) -> tuple[PPO, Any, Tensor]:
    """PPO in float64 with an invented rollout, and SB3's own PPO with the same in its buffer.

    The log-probabilities are of another policy, so that ratios are far from one and are clipped;
    observations are numbers that float32 holds exactly, because SB3 casts them to it.
    """
    model = silent(tiny_ppo(craft, dtype=torch.float64, **ONE_BATCH | settings))
    scatter(model.policy)
    rollout, generator = model._rollout, torch.Generator().manual_seed(5)
    steps, count = rollout.reward.shape
    rollout.observation.copy_(seen(craft, steps * count).reshape(steps, count, -1))
    rollout.action.copy_(torch.randint(0, 2, rollout.action.shape, generator=generator))
    for field in (rollout.value, rollout.reward):
        field.copy_(torch.randn(field.shape, generator=generator, dtype=torch.float64))
    kind = torch.rand(steps, count, generator=generator)
    rollout.ended.copy_(kind < 0.2)
    rollout.truncated.copy_((kind < 0.1) & ((kind < 0.1).cumsum(dim=0) == 1))
    rollout.cut.copy_(seen(craft, count, seed=2))
    last = seen(craft, count, seed=3)
    model.env.engine.observe = lambda: last.double()  # type: ignore[union-attr, method-assign]
    with torch.no_grad():
        flat = rollout.observation.flatten(0, 1), rollout.action.flatten(0, 1)
        log_prob = model.policy.evaluate_actions(*flat)[1].reshape(steps, count)
    rollout.log_prob.copy_(log_prob + 0.3 * torch.randn(log_prob.shape, generator=generator))
    twin = sb3_twin(model)
    _fill(twin, model, last)
    return model, twin, last


def _fill(twin: Any, model: PPO, last: Tensor) -> None:
    """What SB3's `collect_rollouts` would have put into its buffer."""
    rollout, buffer = model._rollout, twin.rollout_buffer
    reward = rollout.reward * model.reward_scale
    with torch.no_grad():
        reward += model.gamma * rollout.truncated * twin.policy.predict_values(rollout.cut)[:, 0]
        values = twin.policy.predict_values(last)
    begun = torch.cat((torch.ones_like(rollout.ended[:1]), rollout.ended[:-1]))
    for t in range(len(reward)):
        buffer.add(*(x[t].numpy() for x in (rollout.observation, rollout.action, reward, begun)),
                   rollout.value[t], rollout.log_prob[t])
    buffer.compute_returns_and_advantage(values, rollout.ended[-1].numpy())


@pytest.mark.parametrize("ent_coef", [0.0, 0.01])
@both_crafts
def test_losses_and_gradients_are_those_of_sb3(craft: Any, ent_coef: float) -> None:
    """One real `stable_baselines3.PPO.train` on the same transitions."""
    model, twin, _ = filled(craft, ent_coef=ent_coef, max_grad_norm=1e9)
    twin.train()
    batch = model._rollout.batch(model.env.engine, model.policy, model.gamma, model.gae_lambda,  # type: ignore[union-attr]
                                 model.reward_scale)
    losses = ppo_loss(model.policy, minibatches(batch, 1)[0], 0.2, ent_coef, model.vf_coef, True)
    losses.loss.backward()
    said = twin.logger.name_to_value
    for name, ours in losses._asdict().items():
        if name != "entropy_loss" or ent_coef:  # SB3 computes the entropy even where it does not use it
            # Means of 256 float64 numbers in another order; SB3 keeps some flags in float32.
            assert ours.item() == pytest.approx(said[f"train/{name}"], rel=1e-6), name
    assert 0.2 < losses.clip_fraction < 0.8
    for (name, ours), other in zip(model.policy.named_parameters(), twin.policy.parameters(), strict=True):
        assert ours.grad is not None, name
        torch.testing.assert_close(ours.grad, other.grad, rtol=0, atol=1e-12, msg=name)
        assert ours.grad.abs().max() > 1e-4, name


@pytest.mark.parametrize("n_epochs", [1, 4])
@both_crafts
def test_an_iteration_is_that_of_sb3(craft: Any, n_epochs: int) -> None:
    """Advantages, loss, clipped gradients and optimiser together: the same weights come out."""
    model, twin, _ = filled(craft, n_epochs=n_epochs, max_grad_norm=0.1, ent_coef=0.01,
                           learning_rate=2.0**-10)  # exact in float32, in which ours is kept
    before = weights(model.policy)
    model.train()
    twin.train()
    for (name, ours), theirs in zip(model.policy.named_parameters(), twin.policy.parameters(), strict=True):
        # Adam divides by the gradient's size plus 1e-5, so rounding of 1e-16 grows to 1e-14 at most.
        torch.testing.assert_close(ours, theirs, rtol=0, atol=1e-12, msg=name)
    assert (weights(model.policy) - before).abs().max() > 5e-4 * n_epochs
    assert model._n_updates == twin._n_updates == n_epochs
    # Only then does the normaliser learn from what was seen.
    assert model.policy.features_extractor.count == 256  # type: ignore[union-attr]
    assert twin.policy.features_extractor.count == 0


def trained(seed: int = 0, steps: int = 1024, **settings: Any) -> PPO:
    model = silent(tiny_ppo(seed=seed, **settings))
    model.learn(steps, log_interval=None)  # type: ignore[arg-type]
    return model


def test_same_seed_same_bits() -> None:
    first, again, other = weights(trained(4).policy), weights(trained(4).policy), weights(trained(5).policy)
    assert torch.equal(first, again)
    assert (first != other).float().mean() > 0.5


def test_learning_in_pieces_changes_nothing() -> None:
    model = silent(tiny_ppo())
    for piece in (128, 256, 640):
        model.learn(piece, reset_num_timesteps=False, log_interval=None)  # type: ignore[arg-type]
    assert model.num_timesteps == 1024
    assert torch.equal(weights(model.policy), weights(trained().policy))


@pytest.mark.parametrize("craft", [PLATFORM, FLYER], ids=lambda craft: craft.name)
def test_saved_agents_open_in_sb3(craft: Any, tmp_path: Path) -> None:
    model = silent(tiny_ppo(craft))
    model.learn(1024, log_interval=None)  # type: ignore[arg-type]
    model.save(tmp_path / "policy.zip")
    observations = seen(craft, 200).numpy()
    expected = model.predict(observations, deterministic=True)[0]
    assert 0.1 < expected.mean() < 0.9
    for loaded in (stable_baselines3.PPO.load(tmp_path / "policy.zip", device="cpu"),
                   PPO.load(tmp_path / "policy.zip", device="cpu")):
        assert loaded.num_timesteps == 1024
        np.testing.assert_array_equal(loaded.predict(observations, deterministic=True)[0], expected)
        one, _ = loaded.predict(observations[0], deterministic=True)
        assert one.shape == (len(craft.thrusters),)
        np.testing.assert_array_equal(one, expected[0])


def test_a_loaded_agent_learns_on(tmp_path: Path) -> None:
    trained(3).save(tmp_path / "policy.zip")
    env = SB3VecEnv(Engine(PLATFORM, NEAR, 16, SHORT))
    model = silent(PPO.load(tmp_path / "policy.zip", env=env, device="cpu"))
    rate = float(model.policy.optimizer.param_groups[0]["lr"])
    assert (model.desired_kl, model.reward_scale, rate) == (0.016, 0.1, pytest.approx(rate))
    before = weights(model.policy)
    model.learn(256, reset_num_timesteps=False, log_interval=None)
    assert model.num_timesteps == 1280
    assert (weights(model.policy) != before).any()


def test_sb3_itself_learns_on_from_it(tmp_path: Path) -> None:
    trained(3).save(tmp_path / "policy.zip")
    env = SB3VecEnv(Engine(PLATFORM, NEAR, 16, SHORT))
    model = stable_baselines3.PPO.load(tmp_path / "policy.zip", env=env, device="cpu")
    before = weights(model.policy)
    silent(model).learn(256, reset_num_timesteps=False)
    assert model.num_timesteps == 1280
    assert (weights(model.policy) != before).any()


def test_prediction_needs_no_environment_and_no_compiler(tmp_path: Path) -> None:
    model = trained()
    model.save(tmp_path / "policy.zip")
    observation = seen(PLATFORM, 1).numpy()
    np.save(tmp_path / "observation.npy", observation)
    script = ("import numpy, stable_baselines3, sys; "
              "model = stable_baselines3.PPO.load('policy.zip', device='cpu'); "
              "print(*model.predict(numpy.load('observation.npy'), deterministic=True)[0][0])")
    root = str(Path(__file__).parents[2])
    done = subprocess.run([sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True,
                          env=os.environ | {"PATH": "", "PYTHONPATH": root}, check=True)
    expected = model.predict(observation, deterministic=True)[0][0]
    assert done.stdout.split() == [str(int(x)) for x in expected]


class Counter(BaseCallback):
    """Counts calls, and stops the training at one of them."""

    def __init__(self, stop_at: int) -> None:
        super().__init__()
        self.stop_at, self.steps, self.rollouts, self.seen = stop_at, 0, [0, 0], []

    def _on_rollout_start(self) -> None:
        self.rollouts[0] += 1

    def _on_step(self) -> bool:
        self.steps += 1
        self.seen.append(self.num_timesteps)
        return self.steps < self.stop_at

    def _on_rollout_end(self) -> None:
        self.rollouts[1] += 1


def test_callbacks_count_steps() -> None:
    model, counter = silent(tiny_ppo()), Counter(10**9)
    model.learn(3 * 128, callback=counter)
    assert counter.steps == counter.n_calls == 3 * 8
    assert counter.seen == list(range(16, 3 * 128 + 1, 16))
    assert counter.rollouts == [3, 3]


def test_callbacks_stop_a_training() -> None:
    model, counter = silent(tiny_ppo()), Counter(8 + 3)
    model.learn(10_000, callback=counter)
    assert counter.steps == 11
    assert counter.rollouts == [2, 1]
    assert model._n_updates == 2  # one iteration of two epochs


def test_checkpoints_of_sb3s_callback(tmp_path: Path) -> None:
    model = silent(tiny_ppo())
    model.learn(512, callback=CheckpointCallback(save_freq=16, save_path=str(tmp_path), name_prefix="x"))
    files = sorted(tmp_path.iterdir(), key=lambda file: int(file.stem.split("_")[1]))
    assert [file.name for file in files] == ["x_256_steps.zip", "x_512_steps.zip"]
    assert PPO.load(files[0], device="cpu").num_timesteps == 256


def test_the_logger_is_told() -> None:
    model = trained()
    told = model.logger.name_to_value
    terms = model.env.engine.term_names  # type: ignore[union-attr]
    for name in (*(f"return/{term}" for term in terms), "train/loss", "train/approx_kl",
                 "train/clip_fraction", "train/learning_rate", "train/grad_norm", "rollout/success_rate",
                 "rollout/failure_rate"):
        assert np.isfinite(told[name]), name
    rollout = model._rollout
    # Mean reward of a step, as an episode of twenty steps would give it.
    for name, mean in zip(terms, rollout.terms / model.n_steps, strict=True):
        assert told[f"return/{name}"] == pytest.approx(20 * float(mean), rel=1e-5)
    ended = float(rollout.ended.sum())
    assert told["rollout/success_rate"] == pytest.approx(float(rollout.reached.sum()) / ended)
    assert told["rollout/failure_rate"] == pytest.approx(1 - float(rollout.truncated.sum()) / ended)


@pytest.mark.filterwarnings("ignore:You have specified a mini-batch size")  # SB3 says so before us
@pytest.mark.parametrize(("settings", "message"), [
    ({"n_steps": 21, "batch_size": 21 * 16}, "n_steps must not exceed the episode's 20 steps, got 21"),
    ({"batch_size": 60}, "batch_size must be a multiple of n_steps = 8 .* got 60"),
    ({"batch_size": 96}, "batch_size must be a multiple of n_steps = 8 .* = 128, got 96"),
    ({"batch_size": 256}, "divides n_steps x environments = 128, got 256"),
    ({"clip_range_vf": 0.2}, "clip_range_vf is not supported"),
    ({"target_kl": 0.01}, "target_kl is not supported"),
])
def test_what_it_cannot_do(settings: dict[str, Any], message: str) -> None:
    env = SB3VecEnv(Engine(PLATFORM, NEAR, 16, SHORT))
    given: dict[str, Any] = {"n_steps": 8, "batch_size": 64, "device": "cpu"} | settings
    with pytest.raises(ConfigError, match=message):
        PPO("MlpPolicy", env, **given)


def test_other_environments_are_refused() -> None:
    env = make_vec_env("rans/GoToPose2D-v0", 4)
    with pytest.raises(ConfigError, match=r"trains on a rans\.fast\.SB3VecEnv, got DummyVecEnv"):
        PPO("MlpPolicy", env, n_steps=8, batch_size=16, device="cpu")
