from __future__ import annotations

import itertools
import json
import math
import tomllib
from collections.abc import Iterator
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import hypothesis
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rans.errors import ConfigError
from rans.fast.learn.config import (
    ExplorationSettings,
    FilterSettings,
    MemorySettings,
    PPOSettings,
    ScheduleSettings,
    TrainConfig,
    from_table,
    preset,
    to_table,
)
from rans.model.timing import Timing
from rans.tasks import TASKS, GoToPose
from tests.support.training import CONFIG

positive = st.floats(1e-6, 1e3)
settings = st.builds(
    PPOSettings,
    n_envs=st.integers(1, 9),
    n_steps=st.integers(1, 9),
    batch_size=st.integers(2, 9),
    learning_rate=positive,
    schedule=st.builds(ScheduleSettings, max_learning_rate=positive),
    gamma=st.floats(0.1, 1.0),
    layers=st.lists(st.integers(1, 9), min_size=1, max_size=4).map(tuple),
)
configs = st.builds(
    TrainConfig,
    task=st.just("go-to-pose"),
    spacecraft=st.text(max_size=9),
    ppo=settings,
    settings=st.builds(GoToPose, thrust_weight=positive, position_tolerance=positive),
    timing=st.builds(Timing, control_period=positive, substeps=st.none() | st.integers(1, 9)),
    seed=st.integers(0, 2**32 - 1),
    solved_share=st.none() | st.floats(0.01, 1.0),
)


@pytest.mark.slow
@hypothesis.settings(max_examples=30)
@given(configs)
def test_through_json_and_back(config: TrainConfig) -> None:
    table = json.loads(json.dumps(to_table(config)))
    assert from_table(table) == config


def test_every_preset_is_consistent() -> None:
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


@pytest.mark.parametrize(
    ("place", "value", "message"),
    [
        ("sed", 1, "config: unknown key 'sed'"),
        ("ppo.n_env", 64, r"config\.ppo: unknown key 'n_env'"),
        ("settings.spawn", [1, 2], "settings: unknown key 'spawn'"),
        ("ppo.n_envs", "64", r"config\.ppo\.n_envs must be a whole number, got '64'"),
        ("ppo.n_envs", True, "must be a whole number, got True"),
        ("ppo.n_envs", 64.5, r"must be a whole number, got 64\.5"),
        ("ppo.gamma", "0.9", r"config\.ppo\.gamma must be a number, got '0\.9'"),
        ("ppo.gamma", True, "must be a number, got True"),
        ("ppo.ent_coef", 0.01, r"config\.ppo: unknown key 'ent_coef'.*; keys are n_envs, n_steps"),
        (
            "ppo.matmul",
            "fp8",
            r"config\.ppo\.matmul must be 'float32' or 'tf32' or 'bf16', got 'fp8'",
        ),
        ("ppo.layers", 64, r"config\.ppo\.layers must be a"),
        ("ppo.layers", [64, "64"], r"config\.ppo\.layers\[1\] must be a whole number, got '64'"),
        ("ppo", 3, r"config\.ppo must be a"),
        ("settings", None, "settings must be a"),
        ("settings", "{", "settings must be a table, such as"),
        ("curriculum", ["spawn_distance"], r"config\.curriculum\[0\] must be a table, such as"),
        ("settings.spawn_distance", [1.0], r"settings\.spawn_distance must be a list of 2 values"),
        ("settings.fail_distance", 1.0, r"settings: fail_distance must exceed the farthest start"),
        (
            "timing.control_period",
            -0.2,
            r"config\.timing: control_period must be a finite number > 0",
        ),
        ("seed", 1.5, r"config\.seed must be a whole number"),
        ("seed", -1, r"seed must be a whole number >= 0 and < 2\^32, got -1"),
        ("seed", 2**32, r"seed must be a whole number .* < 2\^32"),
        ("device", None, r"config\.device must be a text in quotes, got None"),
        ("solved_share", "null", "must be a number"),
        ("solved_share", 1.1, r"solved_share must be in \(0, 1\], or null, got 1\.1"),
        ("total_timesteps", 0, r"total_timesteps must be a whole number >= 1 and < 2\^63, got 0"),
        ("report_interval", 0, r"report_interval must be a whole number >= 1 and < 2\^63, got 0"),
        ("task", "hover", "no task named 'hover'"),
        ("task", 3, "must name its task"),
    ],
)
def test_wrong_tables(place: str, value: Any, message: str) -> None:
    with pytest.raises(ConfigError, match=message) as caught:
        from_table(changed(place, value))
    assert str(caught.value).endswith(".")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("kind", [float, np.int64, np.float64])
def test_whole_numbers_of_other_types(kind: type) -> None:
    """2e5 is one, as on the command line; a loop over a range of NumPy has its own, which JSON cannot write."""
    numbers = {"seed": 3, "total_timesteps": 200_000, "report_interval": 2}
    expected = replace(CONFIG, **numbers, ppo=replace(CONFIG.ppo, n_envs=64))
    table = to_table(replace(CONFIG, **{name: kind(x) for name, x in numbers.items()}))
    table["ppo"]["n_envs"] = kind(64)
    assert json.dumps(to_table(from_table(table))) == json.dumps(to_table(expected))


def test_every_mistake_is_named() -> None:
    table = changed("ppo.n_envs", "64")
    table["seed"] = 0.5
    with pytest.raises(ConfigError) as caught:
        from_table(table)
    assert "config.ppo.n_envs must be a whole number" in str(caught.value)
    assert "config.seed must be a whole number" in str(caught.value)


@pytest.mark.parametrize("table", [None, 3, [], "go-to-pose", {}])
def test_what_is_no_table(table: Any) -> None:
    with pytest.raises(ConfigError, match="must name its task"):
        from_table(table)


def test_missing_entries() -> None:
    with pytest.raises(ConfigError, match="the key 'spacecraft' is missing"):
        from_table({"task": "go-to-pose"})
    shortest = from_table({"task": "go-to-pose", "spacecraft": "floating-platform"})
    assert shortest == TrainConfig("go-to-pose", GoToPose(), "floating-platform")


def test_whole_numbers_are_numbers() -> None:
    config = from_table(changed("ppo.gamma", 1))
    assert type(config.ppo.gamma) is float
    assert config == replace(CONFIG, ppo=replace(CONFIG.ppo, gamma=1.0))


NOT_NUMBERS = (
    "layers",
    "symmetric",
    "matmul",
    "memory",
    "filters",
    "schedule",
    "exploration",
    "privileged_critic",
)
NUMBERS = [f.name for f in fields(PPOSettings) if f.name not in NOT_NUMBERS]


@pytest.mark.parametrize("name", NUMBERS)
@pytest.mark.parametrize("value", [-1, math.nan, math.inf])
def test_numbers_out_of_range(name: str, value: float) -> None:
    whole = type(getattr(PPOSettings(), name)) is int
    with pytest.raises(ConfigError, match=f"{name} must be .*, got {-1 if whole else value}"):
        PPOSettings(**{name: -1 if whole else value})  # type: ignore[arg-type]


LAYERS = "layers must be 1 to 32 numbers >= 1 and <= 65,536"


@pytest.mark.parametrize(
    ("kind", "values", "message"),
    [
        (
            ScheduleSettings,
            {"max_learning_rate": math.inf},
            "max_learning_rate must be .*, got inf",
        ),
        (ScheduleSettings, {"anneal": 1.5}, "anneal must be .*, got 1.5"),
        (ExplorationSettings, {"initial_duty": 1.0}, "initial_duty must be .*, got 1.0"),
        (ExplorationSettings, {"log_std_init": 2.5}, "log_std_init must be .*, got 2.5"),
        (PPOSettings, {"layers": ()}, LAYERS),
        (PPOSettings, {"layers": (0,)}, LAYERS),
        (PPOSettings, {"layers": (64, -1)}, LAYERS),
        (PPOSettings, {"layers": "x"}, LAYERS),
        (PPOSettings, {"matmul": "fp8"}, "matmul must be one of float32, tf32, bf16, got 'fp8'"),
        (PPOSettings, {"gamma": "x"}, r"gamma must be in \(0, 1\], got 'x'"),
        # One transition has no spread to normalise.
        (PPOSettings, {"batch_size": 1}, r"batch_size must be >= 2 and < 2\^31, got 1"),
        (
            MemorySettings,
            {"kind": "histori"},
            "kind must be one of none, history, commands, got",
        ),
        (MemorySettings, {"history": -1}, "history must be >= 0 and <= 65,536, got -1"),
        (MemorySettings, {"averages": (0.5,)}, "so that memory.kind must be 'history'"),
        *(
            (MemorySettings, {"kind": "history", "averages": wrong}, "numbers between 0 and 1, got")
            for wrong in (0.5, (0.0,), (0.5, 1.0), (math.nan,))
        ),
        (MemorySettings, {"kind": "commands", "history": 0}, "and no averages stores nothing"),
        (FilterSettings, {"drift": (0.0,)}, r"drift must be numbers >= 1e-6 .*, got \[0.0\]"),
        (FilterSettings, {"drift": 0.5}, "drift must be numbers >= 1e-6 and <= 1e6, got 0.5"),
        (FilterSettings, {"steady": (1.0,)}, "steady has 1 numbers for 0 filters: give one for"),
        (FilterSettings, {"drift": (1.0,), "steady": (-1.0,)}, "steady must be numbers >= 1e-6"),
        (FilterSettings, {"response": (1.0,)}, "response has 1 numbers for 0 filters: give one"),
        (
            FilterSettings,
            {"drift": (1.0,), "response": (-1.0,)},
            "response must be numbers >= 1e-6",
        ),
    ],
)
def test_wrong_settings(kind: type, values: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        kind(**values)


def test_every_setting_of_ppo_is_set_by_somebody() -> None:
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

    def never_set(settings: Any, found: list[dict[str, Any]], place: str = "") -> Iterator[str]:
        for field in fields(settings):
            given = [table[field.name] for table in found if field.name in table]
            default = getattr(settings, field.name)
            if is_dataclass(default):
                yield from never_set(default, given, f"{place}{field.name}.")
            elif all(json.dumps(value) == json.dumps(default) for value in given):
                yield place + field.name

    # The recipe of a shared supply sets the backbone where it is made.
    assert [*never_set(PPOSettings(), tables)] == ["backbone"]
