"""Every shipped agent flies as it did when its commands were recorded, and as well as its card says."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rans.base.pretrained import pretrained_card, pretrained_names
from rans.episode.flight import Flight, fly
from rans.episode.scenario import scenarios
from rans.evaluation.fly.contestants import contestant, judged_separately
from rans.evaluation.measure.metrics import solved
from tests.support.recorded import CUT, EPISODES, flown, recorded
from tests.support.shipped import shipped_agents

UNTIL = 12
"""Periods in which recorded duty cycles are the same on every processor."""

# Of 64 starts one or another is lost in spin, and the flight says that such motion is inaccurate.
pytestmark = pytest.mark.filterwarnings("ignore:.* spins .* accurate up to:UserWarning")


def flights(name: str, most: int | None) -> tuple[np.ndarray, Flight]:
    """An agent's recorded commands and its flights for as long as these are compared, at most so many periods.

    Flights with duty cycles amplify the last bits of another processor: they departed after 15 periods or later.
    """
    before = recorded(name)
    bits = np.isin(before, (0.0, 1.0)).all()
    before = before[: most or (CUT.get(name) if bits else UNTIL)]
    return before, flown(name, len(before))


@pytest.fixture(scope="module", params=shipped_agents())
def shipped(request) -> tuple[str, np.ndarray, Flight]:
    """An agent with its whole flights."""
    return request.param, *flights(request.param, None)


def compare(before: np.ndarray, flight: Flight) -> None:
    """Commands are the recorded ones."""
    count = before.shape[1]
    now = flight.commands[:, :count]
    assert now.shape == before.shape
    # Duty cycles were kept in single precision, and a count of pulsed valves is 1e-4.
    tolerance = 1e-3 if len(before) == UNTIL else 0.0
    departed = np.abs(now - before).max(axis=(0, 2)) > tolerance
    assert not departed.any(), departed


@pytest.mark.parametrize("name", pretrained_names())
def test_every_shipped_agent_begins_as_recorded(name):
    """Filters, memories, allocation and throttles are at work in the first periods."""
    compare(*flights(name, UNTIL))


def test_a_shipped_agent_gives_the_recorded_commands(shipped):
    compare(*shipped[1:])


@pytest.mark.slow
@pytest.mark.parametrize(
    "shipped", [name for name in pretrained_names() if name not in CUT], indirect=True
)
def test_an_agent_is_worth_what_its_card_says(shipped):
    """In a perfect world, also if it is for another, which takes minutes: it misses a goal rarely then."""
    name, before, flight = shipped
    if len(before) == UNTIL:
        flight = flown(name)
    spec = f"pretrained:{name}"
    card = pretrained_card(name)
    parts = judged_separately(spec)
    for one in parts:
        loaded = contestant(one)
        craft = loaded.craft
        task = loaded.task
        if len(parts) > 1:
            task = task.for_evaluation()
            starts = scenarios(task, craft, card["evaluation_seed"], EPISODES)
            flight = fly(craft, task, loaded.controller, starts, loaded.timing)
        own = (
            card["evaluation"]["own"][str(one).removeprefix(spec).removeprefix("#")]["solved"][0]
            / 100.0
        )
        said = own if loaded.conditions is None else 0.999
        # Four standard deviations of a share of 64, and one episode for shares of 0 and 1.
        spread = 4.0 * math.sqrt(said * (1.0 - said) / EPISODES) + 1.0 / EPISODES
        assert solved(flight).mean() == pytest.approx(said, abs=spread)
