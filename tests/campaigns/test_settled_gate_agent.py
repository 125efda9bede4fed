"""The agent of our settled-gate entry: its training's ranges, its symmetries, how it learns."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from campaigns import settled_gate_agent
from campaigns.settled_gate_agent import Agent, Axes, Memory, Training, astray, flown, trained


def test_training_meets_each_kind_in_its_range() -> None:
    axes = Axes.of_training(30_000)
    moment, gain, bias = (x.numpy() for x in axes)
    assert 0.8 * 6.0 <= moment.min() < 4.81
    assert 19.9 < moment.max() <= 2.0 * 10.0
    assert 0.5 <= np.abs(gain).min() < 0.501
    assert 1.499 < np.abs(gain).max() <= 1.5
    assert 0.199 < np.abs(bias).max() <= 0.2
    assert (gain < 0).mean() == pytest.approx(
        1 / 2, abs=0.01
    )  # three standard errors, here and below
    assert (np.abs(gain) == 1.0).mean() == pytest.approx(1 / 3, abs=0.01)
    assert (bias != 0.0).mean() == pytest.approx(1 / 3, abs=0.01)


def test_axes_should_come_from_afar_as_weak_torques_can_stop_them() -> None:
    """0.01 rad/s at 0.1 rad; then their squares rise by 2e-3 a radian: 11e-4 at 0.6, 41e-4 at 2.1."""
    angle = torch.tensor([0.0, 0.05, 0.1, 0.6, 2.1])
    wanted = torch.tensor([0.0, 0.005, 0.01, 11e-4**0.5, 41e-4**0.5])
    torch.testing.assert_close(astray(angle, -wanted), torch.zeros(5), rtol=0, atol=1e-8)
    torch.testing.assert_close(
        astray(-angle, wanted + 0.02), torch.full((5,), 0.02), rtol=0, atol=1e-8
    )


@pytest.mark.parametrize(
    ("first", "moment", "gain", "bias", "start", "command"),
    [
        (0.5, 1.0, 1.0, 0.5, 0.5, 0.5),  # everything smaller
        (1.0, 0.5, 1.0, 1.0, 2.0, 1.0),  # a body that turns more easily
        (1.0, 1.0, -1.0, -1.0, -1.0, 1.0),  # seen in a mirror
        (-1.0, 1.0, -1.0, 1.0, 1.0, -1.0),
    ],
)  # told the other way round
def test_the_same_motion_is_flown_the_same_by_any_network(
    monkeypatch: pytest.MonkeyPatch,
    first: float,
    moment: float,
    gain: float,
    bias: float,
    start: float,
    command: float,
) -> None:
    """Untrained, for eight seconds, with factors on what an axis is and does, where nothing is at a limit.

    Rows of a size that counts as zero do not scale: 1e-6 of some 1e-2.
    """
    monkeypatch.setattr(settled_gate_agent, "_MOST", 9.0)
    monkeypatch.setattr(settled_gate_agent, "_NEAR", 9.0)
    torch.manual_seed(3)
    agent = Agent().double()
    axes = Axes(*torch.tensor([[15.0, 9.0], [0.8, -0.6], [0.1, 0.0]]).double())
    angle, spin = torch.tensor([[0.1, -0.05], [0.01, 0.02]]).double()
    told = commands(agent, axes, angle, spin)
    assert told.abs().max() < 0.9
    monkeypatch.setattr(settled_gate_agent, "FIRST", first * settled_gate_agent.FIRST)
    other = Axes(axes.moment * moment, axes.gain * gain, axes.bias * bias)
    again = commands(agent, other, start * angle, start * spin)
    torch.testing.assert_close(again, command * told, rtol=0, atol=1e-4)


@torch.no_grad()
def commands(agent: Agent, axes: Axes, angle: torch.Tensor, spin: torch.Tensor) -> torch.Tensor:
    memory = Memory.begin(spin)
    told = []
    for _ in range(16):
        told.append(memory.command)
        angle, spin = axes.move(angle, spin, memory.command)
        memory = agent(memory, angle, spin)
    return torch.stack(told)


def test_a_command_stays_within_what_there_is_and_what_is_left_is_remembered() -> None:
    """0.2 and 0.5 are 0.7; 0.7 and 0.5 are 1, and 0.2 are left."""
    memory = Memory.begin(torch.zeros(1)).told(torch.tensor([0.5])).told(torch.tensor([0.5]))
    assert float(memory.command) == 1.0
    torch.testing.assert_close(
        memory.increments[0, -6:], torch.tensor([0.2, 0.0, 0.5, 0.0, 0.3, 0.2])
    )


def test_a_seed_trains_the_same_agent_again() -> None:
    one, other = (trained(8, 1, 8, 8) for _ in range(2))
    for mine, its in zip(one.parameters(), other.parameters(), strict=True):
        torch.testing.assert_close(mine, its, rtol=0, atol=0)


@pytest.mark.parametrize(
    ("learns", "expected"),
    [
        pytest.param(9.0, [*range(14)] * 2, id="all", marks=pytest.mark.slow),
        pytest.param(0.0, [0, 1] * 5 + [*range(2, 14)], id="none"),
    ],
)
def test_who_does_not_learn_is_left_for_another(
    monkeypatch: pytest.MonkeyPatch, learns: float, expected: list[int]
) -> None:
    """After 2 iterations of 14, up to five times: where all pass, two are trained, or none does."""
    monkeypatch.setattr(settled_gate_agent, "_LEARNS", learns)
    told: list[int] = []
    trained(14, 5, 8, 8, report=lambda done, _: told.append(done))
    assert told == expected


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "which"), [(1, 1), (7, 0)])
def test_the_better_of_two_is_taken(monkeypatch: pytest.MonkeyPatch, seed: int, which: int) -> None:
    """By the mean of their last twenty losses: once the second, once the first."""
    monkeypatch.setattr(settled_gate_agent, "_LEARNS", 9.0)
    agent = trained(24, seed, 8, 8)
    both = []
    for own in (seed, seed + 1000):
        torch.manual_seed(own)
        training = Training(24, 8, 8)
        training.go_on(24, lambda *_: None)
        both.append((sum(training.losses[4:]), training.agent))
    assert both[which][0] < both[1 - which][0]
    better = both[which][1]
    for mine, its in zip(agent.parameters(), better.parameters(), strict=True):
        torch.testing.assert_close(mine, its, rtol=0, atol=0)


@pytest.mark.slow
def test_training_finds_the_way() -> None:
    """The median angle of 256 axes after half a minute, flown by who has learnt nothing and who a little."""
    left = []
    for iterations in (0, 12):
        agent = trained(iterations, 1, 64, 64)
        torch.manual_seed(9)
        angles = flown(agent, Axes.of_training(256), torch.rand(256) - 0.5, torch.zeros(256))
        left.append(float(angles[60].abs().median()))
    assert left[1] < 0.3 * left[0]
