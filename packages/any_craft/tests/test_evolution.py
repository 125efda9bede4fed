"""Evolution of the weights of every frugality: what pairs of networks fly, and where their costs lead."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from rans_any_craft import evolution as evolution_module
from rans_any_craft.evolution import (
    NODES,
    Evolution,
    EvolutionSettings,
    TrainingFailed,
    evolve,
    parts_of_nodes,
)
from rans_any_craft.training import DemandNetwork, Pool, draw_pool, policy_layers

from rans.evaluation.fly.contestants import contestant
from rans.policy.network import Network

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


@pytest.mark.slow
def test_steps_lower_the_cost_where_it_is_thrust(pool: Pool) -> None:
    """At a huge price of thrust, demands that open thrusters cost: the last layer's weights shrink."""
    dear = replace(SETTINGS, prices=(1e6,) * 3, pairs=32, rate=0.05, sigma=0.3)
    own = weights(network())
    own["last"] = 3.0 * own["last"]
    evolution = Evolution(network(), [own] * 3, pool, dear)
    costs = [float(evolution.step(0.1).split()[4]) for _ in range(20)]
    # Craft differ from step to step.
    assert sum(costs[-4:]) < sum(costs[:4])


def shipped(value: float | None = None) -> DemandNetwork:
    """Network of the agent that comes with RANS, as it was trained or at one of its values."""
    own = contestant("any-craft-2d").network
    chosen = own if value is None else Network(own.architecture, own.at[value])
    return DemandNetwork.of_layers(policy_layers(chosen), 2)


def judged(pool: Pool, nodes: list[DemandNetwork], begun: DemandNetwork) -> torch.Tensor:
    """Weights that are chosen after an evolution that begins and ends with those of the nodes."""
    longer = replace(SETTINGS, steps=200)
    evolution = Evolution(shipped(), [weights(one) for one in nodes], pool, longer)
    own = torch.cat([x.flatten() for x in weights(begun).values()])
    return evolution.chosen(own, lambda line: None)


@pytest.mark.slow
def test_weights_that_lose_flights_are_not_chosen(
    pool: Pool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Demands the other way never arrive: the last node's weights stay nearer to those of the node before it."""
    monkeypatch.setattr(evolution_module, "_JUDGED", 12)
    fast, away = shipped(0.0), shipped(0.0)
    with torch.no_grad():
        away.last.neg_()
    rows = judged(pool, [fast, fast, away], shipped())
    assert torch.equal(rows[0], rows[1])
    lost = torch.cat([x.flatten() for x in weights(away).values()])
    assert float((rows[2] - rows[1]).norm()) <= 0.5 * float((lost - rows[1]).norm())


def test_a_training_that_is_no_quicker_has_failed(
    pool: Pool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The last weights are those of the first: they take as long."""
    monkeypatch.setattr(evolution_module, "_JUDGED", 4)
    with pytest.raises(TrainingFailed, match="try another seed"):
        evolve([shipped()], pool, replace(SETTINGS, sigma=1e-30))


@pytest.mark.slow
def test_a_network_of_dense_layers_is_the_one_that_has_them() -> None:
    for dimension in (2, 3):
        own = DemandNetwork(2, torch.Generator().manual_seed(5), dimension)
        with torch.no_grad():
            for bias in (own.first_bias, own.second_bias):
                bias.normal_(generator=torch.Generator().manual_seed(6))
        again = DemandNetwork.of_layers(own.layers(), dimension)
        for name, x in own.named_parameters():
            assert torch.equal(x, again.get_parameter(name))
