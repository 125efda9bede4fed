"""The agents that come with RANS: small, complete, and what their cards say."""

from __future__ import annotations

import math
import re

import pytest

from rans.errors import ConfigError
from rans.evaluation.fly.contestants import contestant, judged_separately
from rans.evaluation.measure.metrics import solved
from rans.fast.saved import read_policy
from rans.flight import fly
from rans.pretrained import pretrained_card, pretrained_folder, pretrained_names
from rans.scenario import scenarios

every_agent = pytest.mark.parametrize("name", pretrained_names())
EPISODES = 64


@every_agent
def test_an_agent_is_small_and_complete(name: str) -> None:
    files = {file.name: file.stat().st_size for file in pretrained_folder(name).iterdir()}
    assert files.keys() == {"policy.zip", "config.json", "spacecraft.toml", "card.json"}
    card, found = pretrained_card(name), contestant(f"pretrained:{name}")
    # Its weights are there twice, for RANS and for SB3, and nothing else of their size.
    network = read_policy(pretrained_folder(name) / "policy.zip", found.craft, found.task).network
    weights = sum(x.numel() for x in network.tensors.values())
    assert sum(files.values()) < 2 * 4 * weights + 75_000
    assert (card["name"], card["spacecraft"]) == (name, found.craft.name)
    kinds = "(-fast|-quiet|-thrifty|-shared|-robust|-faults|-knob)?"
    assert re.fullmatch(rf"{card['task'].removesuffix('-priced')}-{found.craft.dimension}d{kinds}", name)


@every_agent
def test_an_agent_is_worth_what_its_card_says(name: str) -> None:
    """In a perfect world, also if it is for another, which takes minutes: it misses a goal rarely then."""
    spec, card = f"pretrained:{name}", pretrained_card(name)
    for one in judged_separately(spec):
        controller, craft, task, timing, conditions = contestant(one)
        task = task.for_evaluation()
        starts = scenarios(task, craft, card["evaluation_seed"], EPISODES)
        flight = fly(craft, task, controller, starts, timing)
        own = card["evaluation"]["own"][one.removeprefix(spec).removeprefix("#")]["solved"][0] / 100.0
        said = own if conditions is None else 0.999
        # Four standard deviations of a share of 64, and one episode for shares of 0 and 1.
        spread = 4.0 * math.sqrt(said * (1.0 - said) / EPISODES) + 1.0 / EPISODES
        assert solved(flight).mean() == pytest.approx(said, abs=spread)


def test_an_unknown_agent_is_one_sentence() -> None:
    with pytest.raises(ConfigError, match=r"no agent named 'nobody' comes with RANS; known are "):
        pretrained_folder("nobody")
