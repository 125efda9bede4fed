"""Predictions as those of Stable-Baselines3."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch

from rans.policy.predict import predict
from tests.support.engines import both_crafts
from tests.support.training import make_network, sb3_policy, seen


@pytest.mark.parametrize("continuous", [False, True], ids=["on/off", "duty"])
@both_crafts
def test_it_says_what_sb3_says(craft: Any, continuous: bool) -> None:
    """SB3's own policy class with the same weights."""
    network = make_network(craft, continuous)
    observations = seen(craft, 64)
    policy = sb3_policy(network.architecture, network.member(0), own=True)
    generator = torch.Generator().manual_seed(1)
    actions = torch.randint(0, 2, (64, len(craft.thrusters)), generator=generator)
    said = network.evaluate(observations).policy
    output = network.evaluate(observations)
    value, log_prob, entropy = policy.evaluate_actions(observations, actions)
    # Sums of tens of float64 numbers of order one, and of a Gaussian's of order 100, in another order.
    close: dict[str, Any] = {"rtol": 1e-12, "atol": 1e-12}
    torch.testing.assert_close(output.value, value.squeeze(1), **close)
    torch.testing.assert_close(said.log_prob(actions), log_prob, **close)
    torch.testing.assert_close(said.entropy(), entropy, **close)
    predicted, _ = policy.predict(observations.numpy(), deterministic=True)
    rounding = 1e-6 if continuous else 0.0  # of duties to float32
    np.testing.assert_allclose(said.mode().detach().numpy(), predicted, rtol=0, atol=rounding)
    assert 0.2 < predicted.mean() < 0.8  # both choices are there
    again, _ = predict(network, observations.numpy())
    np.testing.assert_allclose(again, predicted, rtol=0, atol=rounding)
