"""Distributions of commands against those of torch and SciPy."""

from __future__ import annotations

import math

import pytest
import torch
from scipy import stats
from torch.distributions import Bernoulli, Categorical, Independent, Normal

from rans.policy.heads import HEADS, ClippedGaussian, GatedGaussian, OnOff, Patterns

GENERATOR = torch.Generator().manual_seed(6)
MEAN = torch.randn(20, 8, generator=GENERATOR, dtype=torch.float64)
SPREADS = [torch.linspace(-3.0, 1.0, 8, dtype=torch.float64), 0.3 * MEAN - 1.0]
"""Logarithms of standard deviations: of each thruster, and of each in each state."""


BITS = (torch.rand(20, 8, generator=GENERATOR, dtype=torch.float64) < 0.5).double()


@pytest.mark.parametrize(
    ("ours", "theirs", "action"),
    [
        (OnOff(3.0 * MEAN), Bernoulli(logits=3.0 * MEAN, validate_args=True), BITS),
        *(
            (ClippedGaussian(MEAN, x), Normal(MEAN, x.exp().expand_as(MEAN)), MEAN.flip(0))
            for x in SPREADS
        ),
    ],
    ids=["on/off", "duties, spread of all", "duties, spread of each"],
)
def test_distributions_are_torchs(ours, theirs, action):
    theirs = Independent(theirs, 1)
    torch.testing.assert_close(
        ours.log_prob(action), theirs.log_prob(action), rtol=1e-12, atol=1e-12
    )
    torch.testing.assert_close(ours.entropy(), theirs.entropy(), rtol=1e-12, atol=1e-12)


def test_certain_thrusters_give_finite_numbers():
    """A probability that rounds to 0 or 1 must not become infinity minus infinity."""
    output = OnOff(torch.tensor([[-500.0, 500.0]]))
    assert output.log_prob(torch.tensor([[0.0, 1.0]])).item() == 0.0
    assert output.log_prob(torch.tensor([[1.0, 1.0]])).item() == -500.0
    assert output.entropy().item() == 0.0


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_no_command_is_further_than_six_deviations(dtype):
    """At either end of [0, 1], which a random number may round to, a command is infinitely far off else."""
    policy = ClippedGaussian(
        torch.full((1, 2), 0.5, dtype=dtype), torch.tensor([0.1, 0.2], dtype=dtype).log()
    )
    sample = policy.sample(torch.tensor([[0.0, 1.0]], dtype=dtype))
    torch.testing.assert_close(sample, torch.tensor([[-0.1, 1.7]], dtype=dtype))


def test_six_deviations_cut_off_nothing_else():
    """0.9999997 is the quantile of 5 deviations: 2.9e-7 are beyond."""
    policy = ClippedGaussian(
        torch.zeros(1, 2, dtype=torch.float64), torch.zeros(2, dtype=torch.float64)
    )
    beyond = stats.norm.sf(5.0)
    sample = policy.sample(torch.tensor([[beyond, 1.0 - beyond]], dtype=torch.float64))
    torch.testing.assert_close(
        sample, torch.tensor([[-5.0, 5.0]], dtype=torch.float64), rtol=1e-8, atol=0
    )


def test_a_view_of_the_spacecraft_takes_each_thrusters_own():
    """Thruster 0 stands third in the view of the first state, and second in that of the second."""
    place = torch.tensor([[2, 0, 1], [1, 2, 0]])
    own = torch.tensor([[10.0, 11.0, 12.0], [20.0, 21.0, 22.0]])
    expected = [[12.0, 10.0, 11.0], [21.0, 22.0, 20.0]]
    assert OnOff(own).placed(place).logit.tolist() == expected
    duty = ClippedGaussian(own, torch.tensor([0.0, 1.0, 2.0])).placed(place)
    assert duty.mean.tolist() == expected
    assert duty.log_std.tolist() == [[2.0, 0.0, 1.0], [1.0, 2.0, 0.0]]


def patterns(demand: list[list[float]]) -> Patterns:
    """Nothing, one of two opposite thrusters of 1, or both, at a price of 0.2 for each that is open."""
    return Patterns(
        torch.tensor(demand, dtype=torch.float64),
        # Minus the square of the twist and the price.
        torch.tensor([0.0, -1.2, -1.2, -0.4], dtype=torch.float64),
        torch.tensor([[0.0, 2.0, -2.0, 0.0]], dtype=torch.float64),
        torch.tensor([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]], dtype=torch.float64),
    )


def test_a_pattern_is_the_more_likely_the_less_it_leaves_of_a_demand():
    """A demand of 0.7 is missed by 0.49, 0.09 and 0.2, 2.89 and 0.2, or 0.49 and 0.4."""
    policy = patterns([[0.7], [0.5]])
    costs = torch.tensor([[0.49, 0.29, 3.09, 0.89], [0.25, 0.45, 2.45, 0.65]], dtype=torch.float64)
    expected = Categorical(logits=-10.0 * costs, validate_args=True)
    for number, row in enumerate(policy.opened):
        action = row.expand(2, -1)
        torch.testing.assert_close(
            policy.log_prob(action), expected.log_prob(torch.full((2,), number)), rtol=1e-12, atol=0
        )
    torch.testing.assert_close(policy.entropy(), expected.entropy(), rtol=1e-12, atol=0)
    assert policy.mode().tolist() == [[1.0, 0.0], [0.0, 0.0]]
    assert (policy.logit > 0.0).tolist() == [[True, False], [False, False]]
    torch.testing.assert_close(
        policy.margin(), torch.tensor([[0.2, 0.2], [0.2, 0.2]], dtype=torch.float64)
    )
    few = policy._replace(
        offset=policy.offset[:3], slope=policy.slope[:, :3], opened=policy.opened[:3]
    )
    assert few.log_prob(torch.ones(2, 2, dtype=torch.float64)).tolist() == [-math.inf, -math.inf]


def test_patterns_are_drawn_as_often_as_they_are_likely():
    count = 10_000
    even = (torch.arange(count, dtype=torch.float64)[:, None] + 0.5) / count
    policy = patterns([[0.7]] * count)
    drawn = policy.sample(even.expand(-1, 2))
    for row in policy.opened:
        share = (drawn == row).all(dim=1).double().mean()
        assert abs(share - policy.log_prob(row.expand(count, -1))[0].exp()) < 2e-4
    # What rounds to 1 chooses the last one.
    assert policy.sample(torch.ones(count, 2))[0].tolist() == [1.0, 1.0]


def gated(logit: float, level: float, log_std: float, count: int = 1) -> GatedGaussian:
    def whole(x: float) -> torch.Tensor:
        return torch.full((count, 1), x, dtype=torch.float64)

    return GatedGaussian(whole(logit), whole(level), torch.tensor([log_std], dtype=torch.float64))


COUNT = 200_000
EVEN = (torch.arange(COUNT, dtype=torch.float64)[:, None] + 0.5) / COUNT


def test_a_gate_fires_as_often_as_its_probability_and_the_throttle_is_gaussian():
    """Of 200,000 even numbers: a share within 1e-5, and a Kolmogorov-Smirnov distance of the same order."""
    probability = 0.3
    policy = gated(math.log(probability / (1 - probability)), 0.6, math.log(0.1), COUNT)
    action = policy.sample(EVEN)
    fires = action != 0
    assert abs(fires.double().mean() - probability) < 1e-5
    assert stats.kstest(action[fires].numpy(), stats.norm(0.6, 0.1).cdf).statistic < 1e-4


def test_the_probabilities_of_a_gated_throttle_sum_to_one():
    policy = gated(0.4, 0.6, math.log(0.3), 20_001)
    levels = torch.linspace(-4.0, 5.0, 20_001, dtype=torch.float64)[:, None]
    density = policy.log_prob(levels).exp()
    shut = gated(0.4, 0.6, math.log(0.3)).log_prob(torch.zeros(1, 1)).exp()
    assert abs(torch.trapezoid(density, levels[:, 0]) + shut - 1.0) < 1e-6


def test_the_entropy_of_a_gated_throttle_is_its_mean_surprise():
    policy = gated(0.4, 0.6, math.log(0.3), COUNT)
    surprise = -policy.log_prob(policy.sample(EVEN)).mean()
    assert abs(surprise - policy.entropy()[0]) < 1e-4


def test_a_gate_that_rather_stays_shut_commands_exactly_zero():
    policy = GatedGaussian(
        torch.tensor([[-0.1, 0.1, 0.1, 0.1]]), torch.tensor([[0.5, 0.5, -0.2, 1.7]]), torch.zeros(4)
    )
    assert policy.mode().tolist() == [[0.0, 0.5, 0.0, 1.0]]


@pytest.mark.parametrize("name", HEADS)
@pytest.mark.parametrize("duty", [0.1, 0.5, 0.8])
def test_untrained_commands_have_the_duty_in_the_mean(name, duty):
    head = HEADS[name]
    bias = torch.zeros(head.weights * 3, dtype=torch.float64)
    head.expect(bias, duty)
    _, outputs = head.folded(torch.zeros(len(bias), 1), bias)
    count = 4000
    policy = head.distribution(outputs.expand(count, -1), torch.full((3,), -9.0).double())
    uniform = (torch.arange(count, dtype=torch.float64)[:, None] + 0.5) / count
    command = policy.command(policy.sample(uniform.expand(count, 3)))
    assert abs(command.mean() - duty) < 1e-3  # four deviations of noise of e^-9 are 5e-4


@pytest.mark.parametrize("name", HEADS)
def test_the_deterministic_command_on_fields_is_the_distributions_mode(name):
    head = HEADS[name]
    outputs = torch.randn(50, head.outputs * 3, generator=GENERATOR, dtype=torch.float64)
    policy = head.distribution(outputs, torch.zeros(3, dtype=torch.float64))
    commands = [head.command(*outputs[:, i::3].unbind(dim=1)) for i in range(3)]
    assert torch.equal(torch.stack(commands, dim=1), policy.mode())
