from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
from stable_baselines3.common.callbacks import ConvertCallback
from torch import Tensor

from rans.fast.engine import Engine
from rans.fast.learn.ppo import PPO
from rans.fast.learn.rollout import Batch, Rollout, gae, minibatches
from rans.fast.policy import evaluate_seen
from tests.fast.engines import PLATFORM, both_crafts
from tests.fast.training import Buffer64, sb3_twin, scatter, tiny_ppo

SCALE = 0.5


def column(*values: float) -> Tensor:
    return torch.tensor(values, dtype=torch.float64)[:, None]


def test_advantages_by_hand() -> None:
    """Backwards, with discount and trade-off of one half each, so that errors fade by a quarter."""
    reward, value, last = column(1, 2, 3), column(10, 20, 30), torch.tensor([40.0]).double()
    advantage = gae(reward, value, column(0, 0, 0), last, 0.5, 0.5)
    # delta = (1 + 10 - 10, 2 + 15 - 20, 3 + 20 - 30) = (1, -3, -7); -3 - 7/4 = -4.75; 1 - 4.75/4.
    assert advantage[:, 0].tolist() == [-0.1875, -4.75, -7.0]
    # Where an episode ended, nothing comes back across: delta = 2 - 20, and 1 - 18/4.
    advantage = gae(reward, value, column(0, 1, 0), last, 0.5, 0.5)
    assert advantage[:, 0].tolist() == [-3.5, -18.0, -7.0]


def test_advantages_are_those_of_sb3() -> None:
    generator = torch.Generator().manual_seed(4)
    reward, value = torch.randn(2, 30, 7, generator=generator, dtype=torch.float64)
    ended = (torch.rand(30, 7, generator=generator) < 0.2).double()
    last = torch.randn(7, generator=generator, dtype=torch.float64)
    model = tiny_ppo()
    buffer = Buffer64(30, model.observation_space, model.action_space, gamma=0.97, gae_lambda=0.9,
                      n_envs=7)
    buffer.rewards[:], buffer.values[:] = reward.numpy(), value.numpy()
    buffer.episode_starts[1:] = ended[:-1].numpy()
    buffer.compute_returns_and_advantage(last, ended[-1].numpy())
    ours = gae(reward, value, ended, last, 0.97, 0.9).numpy()
    # The same float64 sums; SB3 casts only the flags to float32.
    np.testing.assert_allclose(ours, buffer.advantages, rtol=0, atol=1e-13)
    assert ended[-1].sum() > 0 < ended[:-1].sum()


def collected(craft: Any) -> tuple[PPO, Rollout, Batch]:
    """A whole episode's length of a frozen policy whose values differ much, and its advantages."""
    model = tiny_ppo(craft, n_envs=32, n_steps=20, batch_size=640)
    scatter(model.policy)
    engine: Engine = model.env.engine  # type: ignore[union-attr]
    engine.stagger(torch.Generator().manual_seed(8))
    rollout = model._rollout
    rollout.collect(engine, model.policy)
    return model, rollout, rollout.batch(engine, model.policy, model.gamma, model.gae_lambda, SCALE)


@both_crafts
def test_a_rollout_is_that_of_sb3(craft: Any) -> None:
    """SB3 itself flies the same actions from the same starts, and bootstraps where it does."""
    model, rollout, batch = collected(craft)
    twin = sb3_twin(model)
    twin._setup_learn(1)
    twin.env.engine.stagger(torch.Generator().manual_seed(8))  # type: ignore[union-attr]
    remaining = iter(rollout.action)

    def replay(observations: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        action = next(remaining)
        value, log_prob, _ = twin.policy.evaluate_actions(observations, action)
        return action, value, log_prob

    twin.policy.forward = replay  # type: ignore[method-assign]
    # Our rewards are scaled before values are added to them: SB3 is given scaled ones.
    wait = twin.env.step_wait  # type: ignore[union-attr]

    def scaled() -> Any:
        observation, reward, done, infos = wait()
        return observation, reward * np.float32(SCALE), done, infos

    twin.env.step_wait = scaled  # type: ignore[union-attr, method-assign]
    buffer: Any = twin.rollout_buffer
    callback = ConvertCallback(lambda *_: True)
    callback.init_callback(twin)
    assert twin.collect_rollouts(twin.env, callback, buffer, 20)  # type: ignore[arg-type]
    np.testing.assert_array_equal(buffer.actions, rollout.action)
    np.testing.assert_array_equal(buffer.observations, rollout.observation)
    # Values and log-probabilities up to tens, in float32.
    for ours, theirs in ((rollout.value, buffer.values), (rollout.log_prob, buffer.log_probs),
                         (batch.advantage, buffer.advantages), (batch.target, buffer.returns)):
        np.testing.assert_allclose(ours, theirs, rtol=1e-5, atol=5e-5)
    truncated, failed = int(rollout.truncated.sum()), int((rollout.ended - rollout.truncated).sum())
    assert truncated > 5 < failed  # the test saw both kinds


def test_only_time_is_bootstrapped() -> None:
    """One more unit of value adds gamma where time or the rollout cuts off, and nothing on failure."""
    model, rollout, _ = collected(PLATFORM)
    advantages = []
    for extra in (0.0, 1.0):
        with torch.no_grad():
            model.policy.value_net.bias.add_(extra)
        # With lambda = 0 every advantage is its own step's error alone.
        batch = rollout.batch(model.env.engine, model.policy, model.gamma,  # type: ignore[union-attr]
                              0.0, SCALE)
        advantages.append(batch.advantage)
    expected = rollout.truncated.clone()
    expected[-1] += 1.0 - rollout.ended[-1]
    # Differences of float32 numbers of order ten.
    torch.testing.assert_close(advantages[1] - advantages[0], model.gamma * expected, rtol=0, atol=1e-5)


def test_what_a_rollout_remembers() -> None:
    """Log-probability, value, success and mean reward terms are those of the flight."""
    model, rollout, batch = collected(PLATFORM)
    engine = Engine(PLATFORM, model.env.engine.task, 32, model.env.engine.timing)  # type: ignore[union-attr]
    engine.stagger(torch.Generator().manual_seed(8))
    reached, terms = 0, torch.zeros_like(rollout.terms)
    for t, action in enumerate(rollout.action):
        torch.testing.assert_close(rollout.observation[t], engine.observe(), rtol=0, atol=0)
        step = engine.step(action)
        torch.testing.assert_close(rollout.reward[t], step.reward, rtol=0, atol=0)
        terms += step.terms.mean(dim=1)
        reached += int((step.reached & step.truncated).sum())
        cut = step.truncated.nonzero()[:, 0]
        torch.testing.assert_close(rollout.cut[cut], step.final_observation[cut], rtol=0, atol=0)
    torch.testing.assert_close(rollout.terms, terms, rtol=0, atol=0)
    assert rollout.reached == reached > 0
    torch.testing.assert_close(batch.target, batch.advantage + rollout.value)


@both_crafts
def test_an_unchanged_policy_finds_its_own_probabilities(craft: Any) -> None:
    """Whatever side it saw the state from: those of the actions flown, and of their thrusters in the view."""
    model = tiny_ppo(craft, symmetric=True, dtype=torch.float64)
    scatter(model.policy)
    model.collect()
    batch = model._rollout.batch(model.env.engine, model.policy, 0.98, 0.95, 0.1)  # type: ignore[union-attr]
    with torch.no_grad():
        output = evaluate_seen(model.policy, batch.seen.flatten(0, 1))
    log_prob = output.log_prob(batch.action.flatten(0, 1))
    # Sums of float64 in another order.
    torch.testing.assert_close(log_prob, batch.log_prob.flatten(), rtol=0, atol=1e-10)
    assert not torch.equal(batch.action, model._rollout.action)


@pytest.mark.parametrize("count", [1, 2, 4])
def test_minibatches_share_out_every_transition(count: int) -> None:
    number = torch.arange(3 * 8.0).reshape(3, 8)
    fields = Batch(number[..., None], number[..., None], number, number, number)
    parts = minibatches(fields, count)
    assert len(parts) == count
    for part in parts:
        assert part.seen.shape == (24 // count, 1)
        torch.testing.assert_close(part.seen[:, 0], part.advantage)
        assert len(set((part.log_prob % 8).tolist())) == 8 // count  # whole environments
    assert sorted(torch.cat([part.target for part in parts]).tolist()) == list(range(24))
