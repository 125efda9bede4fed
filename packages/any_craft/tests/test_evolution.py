"""Evolution of the weights of every frugality: what pairs of networks fly, and where their costs lead."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from rans_any_craft.evolution import NODES, Evolution, EvolutionSettings, evolve, parts_of_nodes
from rans_any_craft.training import DemandNetwork, Pool, draw_pool

SETTINGS = EvolutionSettings(seconds=0.0, pairs=8, crafts=2, steps=6)


@pytest.fixture(scope="module")
def pool() -> Pool:
    return draw_pool(6, 0)


def network(seed: int = 0) -> DemandNetwork:
    return DemandNetwork(2, torch.Generator().manual_seed(seed))


def weights(of: DemandNetwork) -> dict[str, torch.Tensor]:
    return {name: x.detach().clone() for name, x in of.named_parameters()}


@given(st.floats(0.0, 1.0))
def test_parts_of_nodes_mean_the_value(value: float) -> None:
    """They sum to 1, none is negative, and their mean of the nodes is the value."""
    (parts,) = parts_of_nodes(torch.tensor([value], dtype=torch.float64))
    assert float(parts.sum()) == pytest.approx(1.0)
    assert float(parts.min()) >= 0.0
    assert float(parts @ torch.tensor(NODES, dtype=torch.float64)) == pytest.approx(value)


def test_layers_of_several_networks_are_those_of_each(pool: Pool) -> None:
    several = [network(seed) for seed in range(3)]
    evolution = Evolution(network(), [weights(one) for one in several], pool, SETTINGS)
    stacked = evolution.layers(evolution.theta)
    for number, one in enumerate(several):
        for (weight, bias), (own, own_bias) in zip(stacked, one.layers(), strict=True):
            assert torch.allclose(weight[number], own, atol=1e-6)
            assert torch.allclose(bias[number], own_bias, atol=1e-6)


def test_equal_networks_cost_the_same_and_move_nothing(pool: Pool) -> None:
    """Both of a pair fly the same craft with the same noise: without perturbations no weight has a gradient."""
    own = weights(network())
    still = replace(SETTINGS, sigma=1e-30)
    evolution = Evolution(network(), [own] * 3, pool, still)
    before = evolution.theta.clone()
    evolution.step(0.5)
    assert torch.equal(evolution.theta, before)


def test_steps_lower_the_cost_where_it_is_thrust(pool: Pool) -> None:
    """At a huge price of thrust, demands that open thrusters cost: the last layer's weights shrink."""
    dear = replace(SETTINGS, prices=(1e6,) * 3, pairs=32, rate=0.05, sigma=0.3)
    own = weights(network())
    own["last"] = 3.0 * own["last"]
    evolution = Evolution(network(), [own] * 3, pool, dear)
    costs = [float(evolution.step(0.1).split()[4]) for _ in range(20)]
    # Craft differ from step to step.
    assert sum(costs[-4:]) < sum(costs[:4])


def test_a_result_has_the_weights_of_every_node(pool: Pool) -> None:
    nodes = evolve(network(), pool, SETTINGS)
    assert [node.keys() for node in nodes] == [weights(network()).keys()] * len(NODES)
    assert all(bool(x.isfinite().all()) for node in nodes for x in node.values())
