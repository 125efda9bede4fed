"""Every shipped agent flies as it did when its commands were recorded, and as well as its card says."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rans.evaluation.fly.contestants import contestant, judged_separately
from rans.evaluation.measure.metrics import solved
from rans.flight import Flight, fly
from rans.pretrained import pretrained_card, pretrained_names
from rans.scenario import scenarios
from tests.support.recorded import EPISODES, flown, recorded


@pytest.fixture(scope="module", params=pretrained_names())
def shipped(request: pytest.FixtureRequest) -> tuple[str, Flight]:
    return request.param, flown(request.param)


def test_a_shipped_agent_gives_the_recorded_commands(shipped: tuple[str, Flight]) -> None:
    before = recorded(shipped[0])
    now = shipped[1].commands
    if shipped[1].craft.is_continuous:
        # Single precision adds up in another order on another processor, and the flight answers to it.
        np.testing.assert_allclose(now[:, : before.shape[1]], before, rtol=0, atol=0.02)
        return
    assert now.shape == before.shape
    departed = [k for k in range(EPISODES) if not np.array_equal(now[:, k], before[:, k])]
    assert departed == []


def test_an_agent_is_worth_what_its_card_says(shipped: tuple[str, Flight]) -> None:
    """In a perfect world, also if it is for another, which takes minutes: it misses a goal rarely then."""
    name, flight = shipped
    spec = f"pretrained:{name}"
    card = pretrained_card(name)
    parts = judged_separately(spec)
    for one in parts:
        controller, craft, task, timing, conditions = contestant(one)
        if len(parts) > 1:
            task = task.for_evaluation()
            starts = scenarios(task, craft, card["evaluation_seed"], EPISODES)
            flight = fly(craft, task, controller, starts, timing)
        own = (
            card["evaluation"]["own"][one.removeprefix(spec).removeprefix("#")]["solved"][0] / 100.0
        )
        said = own if conditions is None else 0.999
        # Four standard deviations of a share of 64, and one episode for shares of 0 and 1.
        spread = 4.0 * math.sqrt(said * (1.0 - said) / EPISODES) + 1.0 / EPISODES
        assert solved(flight).mean() == pytest.approx(said, abs=spread)
