"""Recipes are complete trainings of the agents that come with RANS."""

from __future__ import annotations

from dataclasses import replace

import pytest

from rans.fast.learn.config import from_table, to_table
from rans.fast.learn.recipes import RECIPES, recipe
from rans.fast.learn.troubles import TROUBLES
from rans.model.conditions import Conditions
from rans.model.conditions_file import load_conditions
from rans.model.spacecraft_file import load_spacecraft
from rans.pretrained import pretrained_folder, pretrained_names


@pytest.mark.parametrize("name", RECIPES)
def test_a_recipe_trains_what_its_name_says(name: str) -> None:
    config = recipe(name, "cpu")
    dimension = load_spacecraft(config.spacecraft).dimension
    assert name.startswith(f"{config.task.removesuffix('-priced')}-{dimension}d")
    assert name.endswith("-shared") == config.spacecraft.endswith("-shared")
    assert config.solved_share is None
    assert config.ppo.anneal > 0
    assert from_table(to_table(config)) == config


@pytest.mark.parametrize("name", [name for name in RECIPES if name.endswith("-robust")])
def test_robust_agents_meet_the_laboratory_and_every_trouble(name: str) -> None:
    config = recipe(name, "cuda")
    conditions = config.conditions
    assert replace(conditions, others=(), weight=1.0) == load_conditions("lab")
    assert set(TROUBLES.values()) <= {replace(other, weight=1.0) for other in conditions.others}
    assert Conditions() in conditions.others
    lab_missed = load_conditions("lab-dropouts")
    laboratory = [
        conditions.weight,
        *(other.weight for other in conditions.others if replace(other, weight=1.0) == lab_missed),
    ]
    share = sum(laboratory) / (conditions.weight + sum(other.weight for other in conditions.others))
    assert (
        0.33 < share < 0.41
    )  # poses give some of it to what they learn last: valves that stay open, noise
    assert config.ppo.memory in ("history", "commands")
    assert config.curriculum[-1].begin + config.curriculum[-1].duration < config.total_timesteps


_UNGATED = {"track-velocity-3d-robust", "track-velocity-heading-3d-robust"}
"""Agents trained before filters had a gate."""


def test_every_agent_that_comes_with_rans_has_its_recipe() -> None:
    """The very config, but for seed and device."""
    from rans.fast.learn.run_folder import read_config

    for name in pretrained_names():
        config = to_table(read_config(pretrained_folder(name) / "config.json"))
        again = to_table(recipe(name, config["device"])) | {"seed": config["seed"]}
        if config["timing"]["substeps"] == 1:  # what is chosen for all of them, and was the default
            again["timing"]["substeps"] = 1
        if name in _UNGATED:
            again["ppo"]["filtered_gate"] = 0.0
        assert config == again, name
