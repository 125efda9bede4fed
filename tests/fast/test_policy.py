"""The network beside that of Stable-Baselines3, with the same weights."""

import numpy as np
import pytest
import torch
from stable_baselines3.common.policies import ActorCriticPolicy

from rans.fast.learn.config import MemorySettings
from rans.policy.architecture import Architecture
from rans.policy.predict import predict
from tests.support.engines import PLATFORM, both_crafts
from tests.support.training import (
    make_network,
    policy_kwargs,
    policy_spaces,
    scatter,
    seen,
    tiny_learner,
)


@pytest.mark.parametrize("continuous", [False, True], ids=["on/off", "duty"])
@both_crafts
def test_it_begins_with_the_weights_of_sb3(craft, continuous):
    """Of the same seed, which then gives the same random numbers."""
    given = Architecture(
        make_network(craft).architecture.layout,
        len(craft.thrusters),
        (32, 16),
        head="gaussian" if continuous else "on-off",
    )
    tensors, generator = given.initial(11, 0.5)
    torch.manual_seed(11)
    policy = ActorCriticPolicy(*policy_spaces(given), lambda _: 1e-3, **policy_kwargs(given))
    for name, weight in policy.named_parameters():
        if not (continuous and name == "action_net.bias"):  # that is where duties begin
            assert torch.equal(tensors[name], weight.detach()), name
    assert torch.equal(torch.rand(5), torch.rand(5, generator=generator))


@both_crafts
def test_a_critic_that_is_told_nothing_goes_by_the_design(craft):
    """It values states as if told the numbers of the nominal craft, not all of them one."""
    learner = tiny_learner(craft, privileged_critic=True)
    network = scatter(learner.network)
    told = learner.engine.privileged()[:8]
    observations = seen(craft, 8)
    value = network.evaluate(observations).value
    assert {0.0, 1.0} <= set(told[0].tolist())
    torch.testing.assert_close(
        network.evaluate(observations, None, told).value, value, rtol=0, atol=0
    )
    assert (network.evaluate(observations, None, torch.ones_like(told)).value != value).all()


def test_where_an_episode_begins_nothing_is_remembered():
    """And elsewhere what was: row by row as if each spacecraft had flown alone."""
    learner = tiny_learner(memory=MemorySettings(4))
    network = scatter(learner.network)
    begins = np.arange(60) % 3 == 0
    before, now = (seen(PLATFORM, 60, seed).numpy() for seed in (1, 2))
    _, state = predict(network, before)
    said, after = predict(network, now, state, begins)
    blank = predict(network, now)
    old = predict(network, now, state)
    assert state is not None
    assert after is not None
    assert (blank[0] != old[0]).any(axis=1).sum() > 20
    for rows, (command, memory) in ((begins, blank), (~begins, old)):
        assert memory is not None
        np.testing.assert_array_equal(said[rows], command[rows])
        np.testing.assert_array_equal(after[0][rows], memory[0][rows])
