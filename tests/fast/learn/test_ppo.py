from __future__ import annotations

from typing import Any

import pytest
import torch
from torch import Tensor

from rans.base.errors import NonFiniteState
from rans.fast.learn.batch import Losses
from rans.fast.learn.beginning import statistics
from rans.fast.learn.config import ScheduleSettings
from rans.fast.learn.ppo import PPOLearner
from tests.support.engines import PLATFORM, both_crafts
from tests.support.training import (
    TINY,
    sb3_policy,
    sb3_twin,
    scatter,
    seen,
    settings_with,
    tiny_learner,
    weights,
)

ONE_BATCH: dict[str, Any] = {
    "n_envs": 32,
    "n_steps": 8,
    "batch_size": 256,
    "n_epochs": 1,
}
HEADS = pytest.mark.parametrize("continuous", [False, True], ids=["on/off", "duty"])


def filled(
    craft: Any = PLATFORM, continuous: bool = False, **settings: Any
) -> tuple[PPOLearner, Any]:
    """A learner in float64 with an invented rollout, and SB3's own PPO with the same in its buffer.

    The log-probabilities are of another policy, so that ratios are far from one and are clipped;
    observations are numbers that float32 holds exactly, because SB3 casts them to it.
    """
    given = ONE_BATCH | settings
    learner = tiny_learner(craft, dtype=torch.float64, continuous=continuous, **given)
    network = scatter(learner.network)
    kept = learner.rollout.all
    generator = torch.Generator().manual_seed(5)
    steps, count = kept.reward.shape
    kept.observation.copy_(seen(craft, steps * count).reshape(steps, count, -1))
    kept.action.copy_(
        torch.randn(kept.action.shape, generator=generator)
        if continuous
        else torch.randint(0, 2, kept.action.shape, generator=generator)
    )
    for field in (kept.value, kept.reward):
        field.copy_(torch.randn(field.shape, generator=generator, dtype=torch.float64))
    kind = torch.rand(steps, count, generator=generator)
    kept.ended.copy_(kind < 0.2)
    kept.truncated.copy_((kind < 0.1) & ((kind < 0.1).cumsum(dim=0) == 1))
    learner.rollout.cut.copy_(seen(craft, count, seed=2))
    last = seen(craft, count, seed=3)
    learner.engine.observe = lambda: last.double()  # type: ignore[method-assign]
    policy = sb3_policy(network.architecture, network.weights())
    with torch.no_grad():
        log_prob = policy.evaluate_actions(
            kept.observation.flatten(0, 1), kept.action.flatten(0, 1)
        )[1]
    kept.log_prob.copy_(
        log_prob.reshape(steps, count) + 0.3 * torch.randn(steps, count, generator=generator)
    )
    twin = sb3_twin(learner, settings_with(TINY, **given))
    _fill(twin, learner, last)
    return learner, twin


def _fill(twin: Any, learner: PPOLearner, last: Tensor) -> None:
    """What SB3's `collect_rollouts` would have put into its buffer."""
    kept = learner.rollout.all
    buffer = twin.rollout_buffer
    reward = kept.reward * 0.1
    with torch.no_grad():
        reward += (
            twin.gamma * kept.truncated * twin.policy.predict_values(learner.rollout.cut)[:, 0]
        )
        values = twin.policy.predict_values(last)
    begun = torch.cat((torch.ones_like(kept.ended[:1]), kept.ended[:-1]))
    for t in range(len(reward)):
        buffer.add(
            *(x[t].numpy() for x in (kept.observation, kept.action, reward, begun)),
            kept.value[t],
            kept.log_prob[t],
        )
    buffer.actions = buffer.actions.astype("float64")
    buffer.actions[:] = kept.action.numpy()
    buffer.compute_returns_and_advantage(values, kept.ended[-1].numpy())


@pytest.mark.parametrize("n_epochs", [1, 4])
@HEADS
@both_crafts
def test_an_iteration_is_that_of_sb3(craft, continuous, n_epochs):
    """One real `stable_baselines3.PPO.train` on the same transitions: losses and weights are the same."""
    learner, twin = filled(
        craft,
        continuous,
        n_epochs=n_epochs,
        max_grad_norm=0.1 if n_epochs > 1 else 1e9,
        learning_rate=2.0**-10,
    )
    before = weights(learner.network)
    row = learner.update().tolist()
    twin.train()
    if n_epochs == 1:
        for name, ours in zip(learner.statistics, row, strict=False):
            if name in Losses._fields:
                # Means of 256 float64 numbers in another order; SB3 keeps some flags in float32.
                assert ours == pytest.approx(
                    twin.logger.name_to_value[f"train/{name}"], rel=1e-6
                ), name
    for name, theirs in twin.policy.named_parameters():
        # Adam divides by the gradient's size plus 1e-5, so rounding of 1e-16 grows to 1e-14 at most, of the
        # order of 100 with a Gaussian.
        torch.testing.assert_close(
            learner.network.tensors[name], theirs.data, rtol=0, atol=1e-11, msg=name
        )
    assert (weights(learner.network) - before).abs().max() > 5e-4 * n_epochs
    # Only then does the normaliser learn from what was seen.
    assert learner.network.tensors["features_extractor.count"] == 256


def trained(seed: int = 0, iterations: int = 8, **settings: Any) -> PPOLearner:
    learner = tiny_learner(seed=seed, **settings)
    for _ in range(iterations):
        learner.collect()
        learner.update()
    return learner


def test_training_leaves_torchs_own_random_numbers_alone():
    torch.manual_seed(7)
    expected = torch.rand(3)
    torch.manual_seed(7)
    trained(iterations=1)
    assert torch.equal(torch.rand(3), expected)


def test_an_infinite_gradient_is_noticed_in_the_same_update():
    learner = tiny_learner()
    learner.backend = None  # autograd's hooks see gradients
    learner.network.tensors["value_net.weight"].register_hook(
        lambda gradient: gradient * float("inf")
    )
    learner.collect()
    with pytest.raises(NonFiniteState, match="not finite after 128 steps"):
        statistics(learner.update().tolist(), learner, 128)


def rate_after(learner: PPOLearner, divergence: float, times: int = 1) -> float:
    for _ in range(times):
        learner._adapt(torch.tensor(divergence))
    return float(learner.adam.rate)


def test_step_size_follows_the_divergence():
    learner = tiny_learner(learning_rate=1e-3)
    # Twice 0.016, and half of it.
    expected = {0.033: 1e-3 / 1.5, 0.0079: 1e-3, 0.0081: 1e-3, 0.031: 1e-3, 1e9: 1e-3 / 1.5}
    for divergence, wanted in expected.items():
        assert rate_after(learner, divergence) == pytest.approx(wanted, rel=1e-6)
    for divergence, bound in ((1.0, 1e-5), (0.0, 1e-2)):
        assert rate_after(learner, divergence, 30) == pytest.approx(bound, rel=1e-6)


def test_the_step_size_falls_to_zero_over_the_last_share():
    """Bounded by 4e-3 until half of the steps remain, then in proportion to what remains."""
    learner = tiny_learner(schedule=ScheduleSettings(4e-3, 0.5), learning_rate=1e-3)
    for remaining, bound in ((1.0, 4e-3), (0.5, 4e-3), (0.25, 2e-3), (0.0, 0.0)):
        learner.slow_down(remaining)
        assert rate_after(learner, 0.0, 30) == pytest.approx(bound, rel=1e-6)


def test_episodes_end_at_different_times():
    engine = tiny_learner().engine
    steps = engine.timing.step(engine.save_state()["buffers"][-1])
    assert len(set(steps.tolist())) > 4
