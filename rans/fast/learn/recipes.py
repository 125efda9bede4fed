"""Recipes and presets: trainings known to work, as TOML files in ``rans/data/recipes`` (decision 005).

A recipe is a training config in TOML, whose keys are those of `TrainConfig`. Besides, ``base`` names a recipe
whose values hold where the file has none of its own, ``conditions`` is a name (see `load_conditions`), and
``[gpu]`` has what differs on a GPU; its ``step_factor`` multiplies ``total_timesteps`` and the ``begin`` and
``duration`` of the curriculum, where ``[gpu]`` has no others.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import torch

from rans.errors import ConfigError, brief, meant
from rans.fast.learn.config import PPOSettings, TrainConfig, from_table
from rans.files import read_text
from rans.model.spacecraft_file import SPACECRAFT, USUAL, load_spacecraft
from rans.pretrained import RECIPE_FOLDER
from rans.randomization.conditions import Conditions
from rans.randomization.conditions_file import CONDITIONS, load_conditions
from rans.structure import LARGEST_TOML, merged, read_toml, structure
from rans.tasks import TASKS

RECIPES: tuple[str, ...] = tuple(
    sorted(
        file.stem
        for file in RECIPE_FOLDER.glob("*.toml")
        if not file.stem.startswith(("base-", "preset-"))
    )
)
"""Names of the recipes, which are those of the agents that come with RANS.

Other files are ``base-NAME.toml``, what several have in common, and ``preset-NAME.toml``.
"""


_GRADIENT: dict[str, Any] = {
    "n_envs": 256,
    "n_steps": 16,
    "batch_size": 1024,
    "n_epochs": 4,
    "learning_rate": 3e-3,
}
"""Of a learner through the motion, of any throttled craft (decision 026)."""
_GRADIENT_REPORTS = 24
"""Its iterations between reports, as many steps as between those of PPO."""


def recipe(name: str, device: str) -> TrainConfig:
    """The training of an agent that comes with RANS.

    On a GPU it is a larger network through many more steps, in less time than on a CPU core.

    Args:
        name: one of `RECIPES`.
        device: torch device to train on.
    """
    return _config(RECIPE_FOLDER / f"{name}.toml", device)


def training(task: str, spacecraft: str | None = None, device: str | None = None) -> TrainConfig:
    """The training of this name: a task with its defaults and known-good settings, or a recipe.

    Args:
        task: of `TASKS` or `RECIPES`, MODULE:NAME of a task, or your own recipe's file, which ends in .toml.
        spacecraft: name or TOML file; None: the task's own, or floating-platform. A recipe has its own.
        device: cpu or cuda; None: a GPU if there is one.

    Raises:
        ConfigError: there is no such task, recipe or spacecraft, or the recipe's file is wrong.
    """
    device = device or ("cuda" if torch.cuda.is_available() else "cpu")
    if task in RECIPES:
        return recipe(task, device)
    if task.endswith(".toml"):
        return _config(Path(task), device)
    if task not in TASKS and ":" not in task:
        raise ConfigError(
            f"there is no task and no recipe named {brief(task)}"
            f"{meant(task, [*TASKS, *RECIPES])}; tasks are {', '.join(TASKS)}; "
            f"recipes are {', '.join(RECIPES)}; your own recipe is a file whose name ends in .toml."
        )
    settings = TASKS[task]()
    spacecraft = spacecraft or settings.spacecraft or USUAL[2]
    craft = load_spacecraft(spacecraft)
    TASKS.vouch_for(task)  # typed or given as an object: what is trained with it can be opened here
    return TrainConfig(
        task,
        settings,
        spacecraft,
        preset(task, craft.dimension, device),
        timing=settings.timing,
        device=device,
    )


def preset(task: str, dimension: int, device: str) -> PPOSettings:
    """The hyper-parameters known to solve a task with its default settings.

    Args:
        task: name; your own task has those that are usual for its number of dimensions.
        dimension: 2 or 3.
        device: torch device; another kind than a CPU has those for a GPU.
    """
    place = "plane" if dimension == 2 else "space"
    own = RECIPE_FOLDER / f"preset-{task}-{place}.toml"
    file = own if ":" not in task and own.exists() else RECIPE_FOLDER / f"preset-{place}.toml"
    table = _on_device(_table(file), device)
    settings = structure(table.get("ppo", {}), PPOSettings, f"{file.stem}.ppo")
    return replace(settings, symmetric=TASKS[task].symmetric)


def _config(file: Path, device: str) -> TrainConfig:
    """The training that a recipe's file describes, on a device."""
    try:
        table = _on_device(_table(file), device)
        named = table.pop("conditions", None)
        for known, name in (
            (TASKS, table.get("task")),
            (SPACECRAFT, table.get("spacecraft")),
            (CONDITIONS, named),
        ):
            known.check_file(name, file)
        conditions = Conditions() if named is None else load_conditions(named)
        # A recipe is trained to its end; TOML has no null to say so.
        config = from_table({"solved_share": None} | table | {"device": device})
        return replace(config, conditions=conditions)
    except ConfigError as error:
        raise ConfigError(f"{file}: {error}") from error


def _table(file: Path) -> dict[str, Any]:
    """The table in a recipe's file over that of its ``base``."""
    table = read_toml(read_text(file, LARGEST_TOML))
    base = table.pop("base", None)
    if base is None:
        return table
    known = sorted(one.stem for one in RECIPE_FOLDER.glob("*.toml"))
    if base not in known:
        raise ConfigError(
            f"base must be the name of a recipe that comes with RANS, one of {', '.join(known)}, "
            f"got {brief(base)}."
        )
    return merged(_table(RECIPE_FOLDER / f"{base}.toml"), table)


def _on_device(table: dict[str, Any], device: str) -> dict[str, Any]:
    """A recipe's table as it is on a kind of device, without ``[gpu]``."""
    gpu = table.pop("gpu", {})
    if not isinstance(gpu, dict):
        raise ConfigError(f"gpu must be a table of what differs on a GPU, got {brief(gpu)}.")
    if device.startswith("cpu"):
        return table
    factor = gpu.pop("step_factor", 1)
    if type(factor) is not int or factor < 1:
        raise ConfigError(f"gpu.step_factor must be a whole number >= 1, got {brief(factor)}.")
    longer = dict(table)
    if "total_timesteps" in table:
        longer["total_timesteps"] = _multiplied(table["total_timesteps"], factor)
    if isinstance(table.get("curriculum"), list):
        longer["curriculum"] = [
            {
                key: _multiplied(value, factor) if key in ("begin", "duration") else value
                for key, value in ramp.items()
            }
            if isinstance(ramp, dict)
            else ramp
            for ramp in table["curriculum"]
        ]
    return merged(longer, gpu)


def _multiplied(steps: Any, factor: int) -> Any:
    """A number of steps times a factor; what is none stays, for `from_table` to refuse."""
    return steps * factor if type(steps) is int else steps


_GRADIENT: dict[str, Any] = {
    "n_envs": 256,
    "n_steps": 16,
    "batch_size": 1024,
    "n_epochs": 4,
    "learning_rate": 3e-3,
}
"""Hyper-parameters of the learner through the motion for any throttled craft (decision 026)."""
_GRADIENT_REPORTS = 24
"""Its iterations between reports: as many steps as between those of PPO."""


def by_gradient(config: TrainConfig) -> TrainConfig:
    """Training of the same agent by the gradient learner, with hyper-parameters that are known to work."""
    return replace(
        config,
        algorithm="gradient",
        ppo=replace(config.ppo, **_GRADIENT),
        report_interval=_GRADIENT_REPORTS,
    )
