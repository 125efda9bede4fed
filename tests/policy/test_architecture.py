"""Actions and their probabilities, and the frame in which a network sees."""

from __future__ import annotations

import torch

from rans.policy.heads import OnOff
from rans.tasks import GoToPose
from rans.tasks.derived import layout


def test_certain_thrusters_give_finite_numbers() -> None:
    """A probability that rounds to 0 or 1 must not become infinity minus infinity."""
    output = OnOff(torch.tensor([[-500.0, 500.0]]))
    assert output.log_prob(torch.tensor([[0.0, 1.0]])).item() == 0.0
    assert output.log_prob(torch.tensor([[1.0, 1.0]])).item() == -500.0
    assert output.entropy().item() == 0.0


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
