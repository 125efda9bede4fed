from __future__ import annotations

import itertools
import json
import tomllib
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rans import TASKS, ConfigError, GoToPose, Timing
from rans.fast.learn.config import (
    PPOSettings,
    TrainConfig,
    change_entry,
    from_table,
    preset,
    to_table,
)
from tests.support.training import CONFIG


def test_every_preset_is_consistent():
    for task, dimension, device in itertools.product(TASKS, (2, 3), ("cpu", "cuda")):
        found = preset(task, dimension, device)
        samples = found.n_envs * found.n_steps
        assert samples % found.batch_size == found.batch_size % found.n_steps == 0
        assert found.n_steps <= Timing().episode_steps


def changed(place: str, value: Any) -> dict[str, Any]:
    """The table of a good config with one entry set."""
    table = json.loads(json.dumps(to_table(CONFIG)))
    *parents, last = place.split(".")
    inner = table
    for parent in parents:
        inner = inner[parent]
    inner[last] = value
    return table


@pytest.mark.parametrize("kind", [float, np.int64, np.float64])
def test_whole_numbers_of_other_types(kind):
    """2e5 is one, as on the command line; a loop over a range of NumPy has its own, which JSON cannot write."""
    numbers = {"seed": 3, "total_timesteps": 200_000, "report_interval": 2}
    expected = replace(CONFIG, **numbers, ppo=replace(CONFIG.ppo, n_envs=64))
    table = to_table(replace(CONFIG, **{name: kind(x) for name, x in numbers.items()}))
    table["ppo"]["n_envs"] = kind(64)
    assert json.dumps(to_table(from_table(table))) == json.dumps(to_table(expected))


def test_missing_entries():
    shortest = from_table({"task": "go-to-pose", "spacecraft": "floating-platform"})
    assert shortest == TrainConfig("go-to-pose", GoToPose(), "floating-platform")


def test_whole_numbers_are_numbers():
    config = from_table(changed("ppo.gamma", 1))
    assert type(config.ppo.gamma) is float
    assert config == replace(CONFIG, ppo=replace(CONFIG.ppo, gamma=1.0))


def test_every_setting_of_ppo_is_set_by_somebody():
    """A recipe or agent of this repository has another value than the default; what nobody sets is a constant."""
    root = Path(__file__).parents[3]
    recipes = (root / folder for folder in ("rans/data/recipes", "examples", "campaigns"))
    tables = [
        part.get("ppo", {})
        for recipe in itertools.chain.from_iterable(folder.rglob("*.toml") for folder in recipes)
        for table in [tomllib.loads(recipe.read_text("utf-8"))]
        for part in (table, table.get("gpu", {}))
        if isinstance(part, dict)
    ]
    agents = [
        *root.glob("rans/data/pretrained/*/config.json"),
        *root.glob("agents/*/*/config.json"),
    ]
    tables += [json.loads(path.read_text("utf-8")).get("ppo", {}) for path in agents]
    assert len(agents) > 20

    def never_set(settings, found, place=""):
        for field in fields(settings):
            given = [table[field.name] for table in found if field.name in table]
            default = getattr(settings, field.name)
            if is_dataclass(default):
                yield from never_set(default, given, f"{place}{field.name}.")
            elif all(json.dumps(value) == json.dumps(default) for value in given):
                yield place + field.name

    # The recipe of a shared supply sets the backbone where it is made.
    assert [*never_set(PPOSettings(), tables)] == ["backbone"]


def test_another_learner_has_other_settings():
    table = to_table(CONFIG)
    change_entry(table, "algorithm", "value")
    change_entry(table, "learner.rounds", 2)
    assert from_table(table).learner["rounds"] == 2
    change_entry(table, "algorithm", "ppo")
    assert from_table(table) == CONFIG
    with pytest.raises(ConfigError, match="no learner named 'sac'"):
        from_table(table | {"algorithm": "sac"})
    with pytest.raises(ConfigError, match="learner: unknown key 'noise'"):
        from_table(table | {"algorithm": "ppo", "learner": {"noise": 0.1}})
    with pytest.raises(ConfigError, match="rounds"):
        from_table(table | {"algorithm": "value", "learner": {"rounds": 0}})


def test_a_kind_of_memory_without_its_size_is_refused():
    """Version 0.2 had a size of its own for it, and this one would train without a memory."""
    with pytest.raises(ConfigError, match="unknown key 'kind'"):
        from_table(to_table(CONFIG) | {"ppo": {"memory": {"kind": "history"}}})
