"""The network in SB3: its own policy class says the same with the same weights."""

from __future__ import annotations

from typing import Any

import pytest
import torch
from stable_baselines3.common.policies import ActorCriticPolicy

from rans.fast.policy import policy_kwargs
from rans.policy.architecture import Architecture
from rans.policy.predict import policy_spaces
from tests.support.engines import both_crafts
from tests.support.training import make_network, sb3_policy, scatter, seen, tiny_learner


@pytest.mark.parametrize("continuous", [False, True], ids=["on/off", "duty"])
@both_crafts
def test_it_begins_with_the_weights_of_sb3(craft: Any, continuous: bool) -> None:
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
def test_a_critic_that_is_told_nothing_goes_by_the_design(craft: Any) -> None:
    """It values states as if told the numbers of the nominal craft, not all of them one; in files too."""
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
    policy = sb3_policy(network.architecture, network.weights(), dtype=torch.float32)
    torch.testing.assert_close(policy.predict_values(observations)[:, 0], value, rtol=0, atol=0)
