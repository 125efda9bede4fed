"""Pulses that hold a pose: what they are worth by hand, and where they are chosen."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch
from rans_any_craft.frugality import numbers_of
from rans_any_craft.holding import worth

from rans.evaluation.fly.contestants import contestant
from rans.policy.network import Network
from rans.policy.predict import predict
from tests.support.pose_observations import observations

REST = (0.0,) * 6


def pulse(push: float = 0.0, kick: float = 0.0, own: tuple[float, ...] = REST) -> float:
    """Worth of a pulse along x and about z of thrust 1, with tolerances of one unit."""
    return float(worth(own, (push, 0.0, kick), 1.0, 1.0, 1.0))


def test_worth_is_minus_the_thrust_for_each_period_inside():
    """From rest a push of 0.1 covers 0.05 in its period, and then 0.97 - 0.05 at 0.1 a period: 9.2 periods."""
    assert pulse(push=0.1) == pytest.approx(-1.0 / 8.2, rel=1e-4)
    assert pulse(push=-0.1) == pytest.approx(-1.0 / 8.2, rel=1e-4)
    # A spin likewise, either way; one more period is left until the next pulse acts.
    assert pulse(kick=0.1) == pytest.approx(-1.0 / 8.2, rel=2e-3)
    assert pulse(kick=-0.1) == pytest.approx(-1.0 / 8.2, rel=2e-3)
    # What is left first counts: 0.92 / 0.1 periods of the way, 0.87 / 0.2 of the turn.
    assert pulse(push=0.1, kick=0.2) == pytest.approx(-1.0 / 3.35, rel=1e-3)
    # The goal at 0.9 along x, approached: the craft crosses the whole circle, 0.85 + 0.97 of it.
    assert pulse(push=0.1, own=(0.9, 0, 0, 0, 0, 0)) == pytest.approx(-1.0 / 17.2, rel=1e-3)


def test_a_pulse_that_ends_outside_or_leaves_at_once_is_worth_least():
    assert pulse(push=2.0) == pulse(kick=2.0) == -1e6
    assert pulse(push=0.8) == -1e6  # 0.57 are left at 0.8 a period, less than a period
    assert pulse(kick=-0.8) == -1e6


def test_pulses_are_chosen_within_the_tolerances_alone():
    """Elsewhere the commands are those of the network, bit for bit."""
    own = contestant("any-craft-2d#1").network
    numbers = numbers_of(own.architecture)
    assert numbers.hold == 1.0
    plain = Network(
        replace(own.architecture, frugal=tuple(numbers._replace(hold=0.0))), own.tensors
    )
    seen = observations(6000)
    body = own.architecture.layout.in_body(seen.unbind(-1))
    near = torch.hypot(body[4], body[5]) < 0.05
    inside = (near & (torch.atan2(body[7], body[6]).abs() < math.radians(5.0))).numpy()
    held, demanded = (predict(one, seen.numpy())[0] for one in (own, plain))
    assert inside.sum() > 20
    differs = (held != demanded).any(axis=1)
    assert differs.sum() > 5
    assert not differs[~inside].any()
    assert held[differs].sum(axis=1).max() <= 3.0
