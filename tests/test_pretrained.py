"""The agents that come with RANS are small and complete; how they fly is in test_recorded.py."""

from __future__ import annotations

import re

import pytest

from rans.errors import ConfigError
from rans.evaluation.fly.contestants import contestant
from rans.fast.agent_files.agent import read_policy
from rans.pretrained import pretrained_card, pretrained_folder, pretrained_names
from tests.support.crafts import REAL_CRAFT

every_agent = pytest.mark.parametrize("name", pretrained_names())


@every_agent
def test_an_agent_is_small_and_complete(name: str) -> None:
    files = {file.name: file.stat().st_size for file in pretrained_folder(name).iterdir()}
    assert files.keys() == {"agent.safetensors", "config.json", "spacecraft.toml", "card.json"}
    card = pretrained_card(name)
    found = contestant(f"pretrained:{name}")
    # Its actor's weights are there once, and nothing else of their size.
    saved = read_policy(pretrained_folder(name) / "agent.safetensors")
    weights = sum(x.numel() for x in saved.network.tensors.values())
    assert not saved.has_critic
    # Besides, a config.json that lists every world of the training.
    assert sum(files.values()) < 4 * weights + 60_000
    assert (card["name"], card["spacecraft"]) == (name, found.craft.name)
    crafts = "|".join(f"-{craft}" for craft in REAL_CRAFT)
    kinds = f"(-fast|-steady|-thrifty|-shared|-faults-shared|-robust|-faults|-trade-off|-atmos|{crafts})?"
    assert re.fullmatch(
        rf"{card['task'].removesuffix('-priced')}-{found.craft.dimension}d{kinds}", name
    )


def test_an_unknown_agent_is_one_sentence() -> None:
    with pytest.raises(ConfigError, match=r"no agent named 'nobody' comes with RANS; .*AGENTS"):
        pretrained_folder("nobody")
