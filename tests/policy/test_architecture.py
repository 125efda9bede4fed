"""Actions and their probabilities, and the frame in which a network sees."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
import torch
from scipy.stats import norm

from rans.fast.learn.config import ExplorationSettings
from rans.policy.heads import ClippedGaussian, OnOff
from rans.tasks import GoToPose
from rans.tasks.derived import layout
from tests.support.training import tiny_learner


def test_probabilities_of_all_actions_add_up_to_one() -> None:
    output = OnOff(torch.tensor([[-3.0, 0.2, 1.5, 7.0]], dtype=torch.float64))
    every = torch.tensor(list(itertools.product((0.0, 1.0), repeat=4)), dtype=torch.float64)
    probability = OnOff(output.logit.expand(16, 4)).log_prob(every).exp()
    assert float(probability.sum()) == pytest.approx(1.0, abs=1e-15)
    entropy = -(probability * probability.log()).sum()
    assert float(output.entropy()) == pytest.approx(float(entropy), abs=1e-14)
    assert every[probability.argmax()].tolist() == output.mode()[0].tolist() == [0, 1, 1, 1]


def test_certain_thrusters_give_finite_numbers() -> None:
    """A probability that rounds to 0 or 1 must not become infinity minus infinity."""
    output = OnOff(torch.tensor([[-500.0, 500.0]]))
    assert output.log_prob(torch.tensor([[0.0, 1.0]])).item() == 0.0
    assert output.log_prob(torch.tensor([[1.0, 1.0]])).item() == -500.0
    assert output.entropy().item() == 0.0


def test_samples_have_their_probabilities() -> None:
    torch.manual_seed(1)
    probability = torch.tensor([0.01, 0.3, 0.5, 0.95])
    samples = OnOff(probability.logit().expand(20_000, 4)).sample(torch.rand(20_000, 4))
    assert samples.unique().tolist() == [0.0, 1.0]
    # Five standard deviations of a mean over 20,000 throws.
    bound = 5 * (probability * (1 - probability) / 20_000).sqrt()
    assert ((samples.mean(dim=0) - probability).abs() < bound).all()
    assert (samples.T.corrcoef() - torch.eye(4)).abs().max() < 5 / math.sqrt(20_000)


def test_duties_are_drawn_from_a_gaussian() -> None:
    """Far out too; but zero, which float32 gives once in 3e7 numbers, is six standard deviations away."""
    uniform = torch.tensor([[1e-8, 1e-4, 0.02, 0.5, 0.84, 1 - 1e-6, 0.0]], dtype=torch.float64)
    mean = torch.linspace(-1, 2, 7, dtype=torch.float64)[None]
    log_std = torch.linspace(-2, 1, 7).double()
    far = np.array([*norm.ppf(uniform[0, :6].numpy()), -6.0])
    expected = mean.numpy() + np.exp(log_std.numpy()) * far
    # Rounding of 1 - 2e-8 to float64, in the tail: 1e-16 over a density of 1e-8.
    np.testing.assert_allclose(
        ClippedGaussian(mean, log_std).sample(uniform), expected, rtol=0, atol=1e-7
    )


def test_body_frame_in_the_plane() -> None:
    """Facing world y, what moves along world x moves to the body's right, its negative y."""
    row = [0.0, 1.0, 3.0, 0.0, 0.7, 1.0, 0.0, 2.0, 0.6, 0.8]
    expected = [0.0, -3.0, 0.7, 1.0, 2.0, 0.0, 0.6, 0.8]
    torch.testing.assert_close(
        torch.tensor(layout(GoToPose(), 2).in_body(row)), torch.tensor(expected)
    )


def test_body_frame_in_space() -> None:
    """Turned by 90 degrees about world z: body x is world y, body y is minus world x."""
    # R_WB = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]: its first two rows are observed.
    rest = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]
    row = [
        0.0,
        -1.0,
        0.0,
        1.0,
        0.0,
        0.0,
        3.0,
        4.0,
        5.0,
        7.0,
        8.0,
        9.0,
        1.0,
        10.0,
        11.0,
        12.0,
        *rest,
    ]
    expected = [4.0, -3.0, 5.0, 7.0, 8.0, 9.0, 1.0, 11.0, -10.0, 12.0, *rest]
    torch.testing.assert_close(
        torch.tensor(layout(GoToPose(), 3).in_body(row)), torch.tensor(expected)
    )


@pytest.mark.parametrize("continuous", [False, True], ids=["on/off", "duty"])
def test_untrained_agents_open_thrusters_as_often_as_asked(continuous: bool) -> None:
    learner = tiny_learner(exploration=ExplorationSettings(0.1), continuous=continuous)
    policy = learner.network.evaluate(learner.engine.observe()).policy
    share = policy.mean if isinstance(policy, ClippedGaussian) else torch.sigmoid(policy.logit)  # type: ignore
    # An untrained head has a gain of 0.01 on features of order one: its logits are within 0.1 or so.
    torch.testing.assert_close(share.detach(), torch.full_like(share, 0.1), rtol=0, atol=0.02)


def test_duties_are_clipped_where_they_act() -> None:
    policy = ClippedGaussian(torch.tensor([[-0.5, 0.25, 1.5]]), torch.full((3,), -1.0))
    assert policy.mode().tolist() == [[0.0, 0.25, 1.0]]
    # One and no standard deviations of exp(-1): the quantile of 0.8413 is one.
    uniform = torch.tensor([[0.8413447, 0.5, 0.5]])
    torch.testing.assert_close(
        policy.sample(uniform), torch.tensor([[-0.5 + math.exp(-1), 0.25, 1.5]]), rtol=0, atol=1e-5
    )
    assert policy.sample(torch.tensor([[0.0, 0.0, 1.0]])).isfinite().all()
