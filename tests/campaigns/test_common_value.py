"""The fit of the common value function: its craft can be steered, its motion is the package's, and it learns."""

from __future__ import annotations

from typing import Any

import pytest
import torch
from rans_value.common import CommonProblem, Craft
from safetensors.torch import load_file

from campaigns import common_value
from campaigns.common_value import Fit, Random, moved, random_craft
from rans import GoToPosePriced, Timing
from tests.support.draws import PLATFORM


def test_random_craft_have_as_many_thrusters_as_asked_and_can_be_steered():
    columns = random_craft(Random("cpu", 0), 256, 5, 12)
    number = (columns.abs().sum(dim=2) > 0.0).sum(dim=1)
    assert number.min() >= 4  # one may be missing
    assert number.max() == 12
    craft = Craft(columns)
    assert ((craft.acceleration > 0.011) & (craft.acceleration < 1.4)).all()
    assert ((craft.angular > 0.05) & (craft.angular < 10.1)).all()


def test_the_motion_of_the_fit_is_that_of_the_search():
    problem: Any = CommonProblem(PLATFORM, GoToPosePriced(), Timing())
    random = torch.Generator().manual_seed(1)
    state = 0.5 * torch.randn(7, 64, generator=random)
    command = (torch.rand(64, 8, generator=random) < 0.3).float()
    after = problem.after(problem.with_parameters(state), command)[0]
    columns = problem.design[:24].view(8, 3)
    there = moved(state[:6], (command @ columns).T, problem.period)
    off = after[:6] - there
    off[2] = (off[2] + torch.pi) % (2.0 * torch.pi) - torch.pi
    assert off.abs().max() < 1e-3  # at fast spins, by two nodes of the period and by four


@pytest.mark.slow
def test_a_fit_learns_and_goes_on(tmp_path, monkeypatch):
    monkeypatch.setattr(common_value, "_UPDATES", 4)
    fit = Fit("cpu", flights=32, batch=256, units=16, crafts=32)
    fit.begin(2)
    losses = [fit.round(0.0) for _ in range(6)]
    assert sum(losses[3:]) < sum(losses[:3])
    fit.save(tmp_path / "planar.safetensors")
    other = Fit("cpu", flights=32, batch=256, units=16, crafts=32, seed=8)
    other.load(tmp_path / "planar.safetensors")
    weights = load_file(tmp_path / "planar.safetensors")["last.weight"].float()
    assert torch.equal(other.average.last.weight, weights)
    assert other.round(0.5) == pytest.approx(losses[-1], abs=0.5)
