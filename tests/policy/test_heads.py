"""Distributions of commands against those of torch and SciPy."""

from __future__ import annotations

import math

import pytest
import torch
from scipy import stats
from torch.distributions import Bernoulli, Independent, Normal

from rans.policy.heads import Duty, OnOff

GENERATOR = torch.Generator().manual_seed(6)
MEAN = torch.randn(20, 8, generator=GENERATOR, dtype=torch.float64)
SPREADS = [torch.linspace(-3.0, 1.0, 8, dtype=torch.float64), 0.3 * MEAN - 1.0]
"""Logarithms of standard deviations: of each thruster, and of each in each state."""


def test_on_off_is_torchs_bernoulli() -> None:
    ours = OnOff(3.0 * MEAN)
    theirs = Independent(Bernoulli(logits=3.0 * MEAN, validate_args=True), 1)
    action = (torch.rand(20, 8, generator=GENERATOR, dtype=torch.float64) < 0.5).double()
    torch.testing.assert_close(
        ours.log_prob(action), theirs.log_prob(action), rtol=1e-12, atol=1e-12
    )
    torch.testing.assert_close(ours.entropy(), theirs.entropy(), rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("log_std", SPREADS, ids=["of all", "of each"])
def test_duties_are_torchs_normal(log_std: torch.Tensor) -> None:
    ours = Duty(MEAN, log_std)
    theirs = Independent(Normal(MEAN, log_std.exp().expand_as(MEAN)), 1)
    action = torch.randn(20, 8, generator=GENERATOR, dtype=torch.float64)
    torch.testing.assert_close(
        ours.log_prob(action), theirs.log_prob(action), rtol=1e-12, atol=1e-12
    )
    torch.testing.assert_close(ours.entropy(), theirs.entropy(), rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_no_command_is_further_than_six_deviations(dtype: torch.dtype) -> None:
    """At either end of [0, 1], which a random number may round to, a command is infinitely far off else."""
    policy = Duty(
        torch.full((1, 2), 0.5, dtype=dtype), torch.full((2,), math.log(0.1), dtype=dtype)
    )
    sample = policy.sample(torch.tensor([[0.0, 1.0]], dtype=dtype))
    torch.testing.assert_close(sample, torch.tensor([[-0.1, 1.1]], dtype=dtype))


def test_six_deviations_cut_off_nothing_else() -> None:
    """0.9999997 is the quantile of 5 deviations: 2.9e-7 are beyond."""
    policy = Duty(torch.zeros(1, 2, dtype=torch.float64), torch.zeros(2, dtype=torch.float64))
    beyond = stats.norm.sf(5.0)
    sample = policy.sample(torch.tensor([[beyond, 1.0 - beyond]], dtype=torch.float64))
    torch.testing.assert_close(
        sample, torch.tensor([[-5.0, 5.0]], dtype=torch.float64), rtol=1e-8, atol=0
    )


def test_a_view_of_the_spacecraft_takes_each_thrusters_own() -> None:
    """Thruster 2 stands first in the view of the first state, thruster 1 in that of the second."""
    place = torch.tensor([[2, 0, 1], [1, 2, 0]])
    own = torch.tensor([[10.0, 11.0, 12.0], [20.0, 21.0, 22.0]])
    expected = [[12.0, 10.0, 11.0], [21.0, 22.0, 20.0]]
    assert OnOff(own).placed(place).logit.tolist() == expected
    duty = Duty(own, torch.tensor([0.0, 1.0, 2.0])).placed(place)
    assert duty.mean.tolist() == expected
    assert duty.log_std.tolist() == [[2.0, 0.0, 1.0], [1.0, 2.0, 0.0]]
