"""The training of the agents for any craft: its layouts, its stages, and the laws that fly beside it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from rans_any_craft import training as demands
from rans_any_craft.agents import RECIPES
from rans_any_craft.layouts import canonical
from rans_any_craft.training import (
    DemandNetwork,
    DemandSettings,
    Stage,
    draw_batch,
    draw_pool,
    fly,
    train,
    unit_rows,
)

from rans.policy.authority import Authority
from tests.support.layouts import columns_of

FEW = DemandSettings(crafts=16, steps=40)


def test_a_layout_of_the_pool_does_not_depend_on_the_others() -> None:
    """Nor on the processes that draw them."""
    long = draw_pool(20, 6)
    short = draw_pool(5, 6)
    for many, few in zip(long, short, strict=True):
        assert torch.equal(many[: len(few)], few)


def test_the_law_made_by_hand_brakes_in_time() -> None:
    """It counts on 0.7 of the authority, and lets small errors vanish in three periods of 0.2 s.

    0.42 m/s then go 0.6 s * 0.42 m/s + (0.42 m/s)^2 / (2 * 0.7 m/s^2) = 0.378 m, and 0.16 rad/s of 2 rad/s^2 go
    0.096 rad + 0.16^2 / 2.8 rad. A unit is 0.2 m/s, or 0.4 rad/s. What is far away is asked for 2.5 units.
    """
    numbers = [torch.tensor([x, x]) for x in (0.2, 1.0, 2.0)]
    period, linear, angular = numbers
    craft = Authority(period, [linear] * 4, [angular] * 2, linear, angular)
    angle = torch.tensor([0.096 + 0.16**2 / 2.8, -2.0])
    error = [torch.tensor([0.378, -90.0]), torch.tensor([0.0, 0.0])]
    velocity = [torch.tensor([0.22, 0.0]), torch.tensor([-0.1, 0.3])]
    spin = [torch.tensor([-0.24, 0.0])]
    demand = demands.stopping_law(error, (angle.cos(), [angle.sin()]), velocity, spin, craft)
    torch.testing.assert_close(
        demand, torch.tensor([[1.0, 0.5, 1.0], [-2.5, -1.5, -2.5]]), atol=1e-3, rtol=0.0
    )  # the rotation vector is within 0.2 %


def test_prices_of_a_stage_are_paid_for_thrust() -> None:
    """Twice the price costs twice as much, at rest more, and thrust without a price nothing."""
    pool = draw_pool(8, 4)
    layers = DemandNetwork(1, torch.Generator().manual_seed(0)).layers()

    def cost(*prices: float) -> torch.Tensor:
        generator = torch.Generator().manual_seed(2)
        batch = draw_batch(pool, FEW, generator, continuous=True)
        with torch.no_grad():
            return fly(layers, batch, FEW, generator, Stage(0.0, *prices))

    free = cost(0.0, 0.0)
    once = cost(0.5, 0.0)
    twice = cost(1.0, 0.0)
    rest = cost(0.5, 3.0)
    # A network drawn at random may leave all thrusters of a craft shut.
    assert (once >= free).all()
    assert (once > free).float().mean() > 0.8
    assert torch.allclose(twice - free, 2.0 * (once - free), rtol=1e-3)  # sums in float32
    assert (rest >= once).all()
    assert (rest > once).any()


def test_stages_follow_one_another(monkeypatch: pytest.MonkeyPatch) -> None:
    """Both agents' recipes are one training: a stage goes on with the network of the one before."""
    begun: list[tuple[int, Stage]] = []

    def stage(network: Any, _: Any, __: Any, of: Stage, *___: Any) -> None:
        begun.append((id(network), of))

    monkeypatch.setattr(demands, "_train_stage", stage)
    monkeypatch.setattr(demands, "_IMITATIONS", 0)
    recipe = RECIPES[3]
    assert len(recipe.stages) > 1
    network = train(replace(recipe, dimension=2, crafts=2), pool=draw_pool(2, 4))
    assert begun == [(id(network), one) for one in recipe.stages]


PLANAR = (
    "astrobee-granite",
    "atmos",
    "floating-platform",
    "floating-platform-air-tank",
    "floating-platform-shared",
    "freeflyer2",
    "pingu",
    "roboran-platform",
)


SPACE = ("apollo-csm", "astrobee-iss", "atmos-orbit-12", "atmos-orbit-16", "spheres", "free-flyer")


@pytest.mark.slow
def test_no_shipped_craft_is_drawn_in_the_training_in_space() -> None:
    shipped = [canonical(columns_of(name), digits=2) for name in SPACE]
    pool = draw_pool(60, 1000, 3)
    for row in pool.columns.double().numpy():
        drawn = canonical(row[np.abs(row[:, :3]).max(axis=1) > 0.0], digits=2)
        assert not any(drawn & tables for tables in shipped)


def test_no_shipped_craft_is_drawn_in_the_training() -> None:
    shipped = [canonical(columns_of(name), digits=2) for name in PLANAR]
    pool = draw_pool(60, 0)
    for row in pool.columns.double().numpy():
        drawn = canonical(row[np.abs(row).max(axis=1) > 0.0], digits=2)
        assert not any(drawn & tables for tables in shipped)
    # Without being held out some are drawn, and the test would notice.
    random = np.random.default_rng(0)
    planted = random.permutation(columns_of("pingu")) * [1.0, -1.0, -1.0] * [2.0, 2.0, 7.0]
    assert any(canonical(planted, digits=2) & tables for tables in shipped)


def test_a_direction_of_no_length_points_along_the_first_axis() -> None:
    """In the plane one number is drawn for the axis of a turn, and a float32 normal number may be 0."""
    drawn = torch.tensor([[0.0, 0.0, 0.0], [0.0, 0.0, -2.0], [3.0, 4.0, 0.0]])
    turns = unit_rows(drawn, torch.tensor([0.0, 0.0, 1.0]))
    assert torch.equal(turns[:2], torch.tensor([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]))
    ways = unit_rows(drawn, torch.tensor([1.0, 1.0, 0.0]))
    assert torch.equal(ways[0], torch.tensor([1.0, 0.0, 0.0]))
    torch.testing.assert_close(ways[2], torch.tensor([0.6, 0.8, 0.0]))
