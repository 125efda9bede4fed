from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from stable_baselines3.common.callbacks import ConvertCallback

from rans import Engine
from rans.fast.learn.batch import Batch
from rans.fast.learn.config import MemorySettings
from rans.fast.learn.ppo import PPOLearner
from rans.fast.learn.rollout import Acted, Rollout, Slot, minibatches, remember
from rans.fast.stepping.step import Step
from tests.support.engines import FLYER, PLATFORM, both_crafts
from tests.support.training import TINY, sb3_twin, scatter, tiny_learner

SCALE = 0.5


WHOLE: dict[str, Any] = {"n_envs": 32, "n_steps": 20, "batch_size": 640, "reward_scale": SCALE}


def collected(craft: Any) -> tuple[PPOLearner, Batch]:
    """A whole episode's length of a frozen policy whose values differ much, and its advantages."""
    learner = tiny_learner(craft, **WHOLE)
    scatter(learner.network)
    learner.engine.stagger(torch.Generator().manual_seed(8))
    learner.collect()
    return learner, learner.batch()


@both_crafts
def test_a_rollout_is_that_of_sb3(craft):
    """SB3 itself flies the same actions from the same starts, and bootstraps where it does."""
    learner, batch = collected(craft)
    kept = learner.rollout.all
    twin = sb3_twin(learner, replace(TINY, **WHOLE))
    twin._setup_learn(1)
    twin.env.engine.stagger(torch.Generator().manual_seed(8))  # type: ignore[union-attr]
    remaining = iter(kept.action)

    def replay(observations):
        action = next(remaining)
        value, log_prob, _ = twin.policy.evaluate_actions(observations, action)
        return action, value, log_prob

    twin.policy.forward = replay  # type: ignore[method-assign]
    # Our rewards are scaled before values are added to them: SB3 is given scaled ones.
    wait = twin.env.step_wait  # type: ignore[union-attr]

    def scaled():
        observation, reward, done, infos = wait()
        return observation, reward * np.float32(SCALE), done, infos

    twin.env.step_wait = scaled  # type: ignore[union-attr, method-assign]
    buffer = twin.rollout_buffer
    callback = ConvertCallback(lambda *_: True)
    callback.init_callback(twin)
    assert twin.collect_rollouts(twin.env, callback, buffer, 20)  # type: ignore[arg-type]
    np.testing.assert_array_equal(buffer.actions, kept.action)
    np.testing.assert_array_equal(buffer.observations, kept.observation)
    # Values and log-probabilities up to tens, in float32.
    for ours, theirs in (
        (kept.value, buffer.values),
        (kept.log_prob, buffer.log_probs),
        (batch.advantage, buffer.advantages),
        (batch.target, buffer.returns),
    ):
        np.testing.assert_allclose(ours, theirs, rtol=1e-5, atol=5e-5)
    truncated = int(kept.truncated.sum())
    failed = int((kept.ended - kept.truncated).sum())
    assert truncated > 5 < failed  # the test saw both kinds


@pytest.mark.parametrize(
    ("craft", "kind"),
    [
        (PLATFORM, {"symmetric": True}),
        (FLYER, {"symmetric": True}),
        (PLATFORM, {"memory": MemorySettings(4)}),
    ],
    ids=["plane", "space", "history"],
)
def test_an_unchanged_policy_finds_its_own_probabilities(craft, kind):
    """Whatever side it saw the state from, through the ends of episodes, in minibatches, with what it remembers."""
    learner = tiny_learner(
        craft, dtype=torch.float64, n_steps=16, batch_size=64, privileged_critic=True, **kind
    )
    scatter(learner.network)
    for _ in range(2):
        learner.collect()
    kept = learner.rollout.all
    batch = learner.batch()
    assert kept.ended.sum() > 5
    if kept.memory is None:
        assert not torch.equal(batch.action, kept.action)
    else:
        assert kept.memory[0].abs().max() > 0.1
    for part in minibatches(batch, 4):
        with torch.no_grad():
            output = learner.network.evaluate_seen(part.columns, part.memory, part.privileged)
        # Sums of float64 in another order.
        torch.testing.assert_close(
            output.policy.log_prob(part.action), part.log_prob, rtol=0, atol=1e-10
        )


@pytest.mark.parametrize("count", [1, 2, 4])
def test_minibatches_divide_every_transition_of_whole_environments(count):
    number = torch.arange(3 * 16.0).reshape(3, 16)
    fields = Batch(number[..., None], number[..., None], number, number, number, None, None)
    parts = minibatches(fields, count)
    assert len(parts) == count
    for part in parts:
        assert part.columns.shape == (48 // count, 1)
        torch.testing.assert_close(part.columns[:, 0], part.advantage)
        assert len(set((part.log_prob % 16).tolist())) == 16 // count  # whole environments
    assert sorted(torch.cat([part.target for part in parts]).tolist()) == list(range(48))


def test_what_three_steps_leave_behind():
    """By hand, of four environments and a memory of one number, beside what SB3 collects too.

    Environment 0 is cut off by time in the second step, 1 fails in the second, 2 is cut off in the third and
    3 goes on; 0 and 1 are within the tolerances all along, 2 only in its last step.
    """
    learner = tiny_learner(n_envs=2, n_steps=3, batch_size=6)
    rollout = Rollout(Engine(PLATFORM, learner.engine.task, 4), learner.network, 3)
    rollout.memory = torch.zeros(4, 1)
    rollout.cut_memory = torch.full((4, 1), -1.0)
    rollout.cut = torch.full_like(rollout.cut, -1.0)
    rollout.all = rollout.all._replace(memory=torch.zeros(3, 4, 1))
    rollout.steps = [Slot._make(None if x is None else x[t] for x in rollout.all) for t in range(3)]
    rollout.terms = torch.zeros(2, 4)
    width = rollout.cut.shape[1]
    numbers = torch.arange(4.0)
    for t in range(3):
        truncated = torch.tensor([t == 1, False, t == 2, False])
        terminated = torch.tensor([False, t == 1, False, False])
        reached = torch.tensor([True, t != 1, t == 2, False])
        after = (10.0 * (t + 1) + numbers)[:, None]
        acted = Acted(torch.zeros(4, 8), numbers, numbers, torch.zeros(4, 8), after)
        last = (100.0 * (t + 1) + numbers)[:, None].expand(4, width)
        terms = torch.stack([numbers, numbers * t])
        step = Step(torch.zeros(4, width), numbers, terminated, truncated, last, reached, terms)
        remember(torch.zeros(4, width), acted, None, step, rollout.steps[t], rollout)
    # What it remembered before each step: nothing after an end, however it came about.
    assert rollout.all.memory is not None
    remembered = rollout.all.memory[:, :, 0]
    assert remembered.tolist() == [[0] * 4, [10, 11, 12, 13], [0, 0, 22, 23]]
    assert rollout.memory[:, 0].tolist() == [30, 31, 0, 33]
    # What was seen and remembered where time cut off, and only there.
    assert rollout.cut[:, 0].tolist() == [200, -1, 302, -1]
    assert rollout.cut_memory[:, 0].tolist() == [20, -1, 32, -1]
    # Means of the terms, summed; 0 and 2 were cut off at the goal.
    assert rollout.terms.mean(dim=1).tolist() == [4.5, 4.5]
    assert (rollout.succeeded.sum(), rollout.failed.sum()) == (2, 1)
