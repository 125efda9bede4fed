"""Actions and their probabilities, and the frame in which a network sees."""

from __future__ import annotations

import math

import torch

from rans.policy.heads import ClippedGaussian, OnOff
from rans.tasks import GoToPose
from rans.tasks.derived import layout


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


def test_duties_are_clipped_where_they_act() -> None:
    policy = ClippedGaussian(torch.tensor([[-0.5, 0.25, 1.5]]), torch.full((3,), -1.0))
    assert policy.mode().tolist() == [[0.0, 0.25, 1.0]]
    # One and no standard deviations of exp(-1): the quantile of 0.8413 is one.
    uniform = torch.tensor([[0.8413447, 0.5, 0.5]])
    torch.testing.assert_close(
        policy.sample(uniform), torch.tensor([[-0.5 + math.exp(-1), 0.25, 1.5]]), rtol=0, atol=1e-5
    )
    assert policy.sample(torch.tensor([[0.0, 0.0, 1.0]])).isfinite().all()
