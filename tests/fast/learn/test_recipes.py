"""Recipes are complete trainings of the agents that come with RANS."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from rans import TASKS, GoToPose
from rans.base.pretrained import FOR_ANY_CRAFT, pretrained_folder, pretrained_names
from rans.fast.learn.config import (
    RECIPES,
    MemorySettings,
    from_table,
    recipe,
    to_table,
    training,
    training_of_quality,
)
from rans.fast.learn.curriculum import Ramp
from rans.model.spacecraft_file import load_spacecraft
from rans.randomization.conditions_file import load_conditions


@pytest.mark.parametrize("name", RECIPES)
def test_a_recipe_trains_what_its_name_says(name):
    config = recipe(name, "cpu")
    dimension = load_spacecraft(config.spacecraft).dimension
    assert name.startswith(f"{config.task.removesuffix('-priced')}-{dimension}d")
    assert name.endswith("-shared") == config.spacecraft.endswith("-shared")
    assert config.solved_share is None
    assert config.ppo.schedule.anneal > 0
    assert from_table(to_table(config)) == config


_EXAMPLES = Path(__file__).parents[3] / "examples"
_CONTINUED = {"land-3d": str(_EXAMPLES / "landing/glide-slope.toml")}
"""Agents whose last training went on from another's weights, and the recipe of that training."""


def _without_descriptions(value: object) -> object:
    """A table without the sentences that tell a reader what its conditions are."""
    if isinstance(value, dict):
        return {
            key: _without_descriptions(item) for key, item in value.items() if key != "description"
        }
    if isinstance(value, list | tuple):
        return [_without_descriptions(item) for item in value]
    return value


def test_every_agent_that_comes_with_rans_has_its_recipe():
    """The very config, but for seed, device and descriptions."""
    from rans.fast.learn.run_folder import read_config

    for name in pretrained_names():
        if name in FOR_ANY_CRAFT.values():  # whose programs have left
            continue
        config = to_table(read_config(pretrained_folder(name) / "config.json"))
        again = to_table(training(_CONTINUED.get(name, name), device=config["device"]))
        again["seed"] = config["seed"]
        if config["timing"]["substeps"] == 1:  # what is chosen for all of them, and was the default
            again["timing"]["substeps"] = 1
        assert _without_descriptions(config) == _without_descriptions(again), name


OWN = """
base = "go-to-pose-2d"
conditions = "lab"

[ppo.memory]
history = 4

[settings]
thrust_weight = 0.2

[gpu]
step_factor = 3

[gpu.ppo]
n_envs = 8192
"""


def test_a_recipe_of_ones_own_is_its_base_with_what_it_changes(tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text(OWN, "utf-8")
    found = training(str(file), device="cpu")
    base = recipe("go-to-pose-2d", "cpu")
    assert isinstance(base.settings, GoToPose)
    assert found == replace(
        base,
        settings=replace(base.settings, thrust_weight=0.2),
        ppo=replace(base.ppo, memory=MemorySettings(4)),
        conditions=load_conditions("lab"),
    )
    large = training(str(file), device="cuda")
    assert large.total_timesteps == 75_000_000
    assert large.curriculum == (Ramp("thrust_weight", 0.05, 45_000_000, shape="geometric"),)
    # Of the base's [gpu] what the file does not say, of its own [ppo] what no [gpu] says.
    assert (large.ppo.n_envs, large.ppo.layers) == (8192, (256, 256))
    assert large.ppo.memory.history == 4


@pytest.mark.parametrize("task", [name for name in TASKS if ":" not in name])
def test_every_task_has_each_quality(task):
    """A longer one trains to its end; the spacecraft and the length of episodes are the task's own."""
    quick = training_of_quality(task, None, "quick", "cpu")
    assert quick.solved_share is not None
    for quality in ("good", "best"):
        config = training_of_quality(task, None, quality, "cpu")
        assert config.solved_share is None
        assert config.task == task
        assert config.spacecraft == quick.spacecraft
        assert config.timing == quick.timing


def test_ones_own_spacecraft_and_conditions():
    config = training_of_quality("go-to-pose", "atmos", "good", "cpu", randomized=True)
    assert config.spacecraft == "atmos"
    assert (config.ppo.memory.history, config.ppo.privileged_critic) == (8, True)
    assert config.conditions.or_none is None
    assert not training_of_quality("go-to-pose", "atmos", "good", "cpu").ppo.memory.remembers
