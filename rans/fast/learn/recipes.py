"""Recipes and presets: training configs known to work, as TOML files in ``rans/data/recipes``.

docs/decisions/learners.md says how the values of the presets were chosen.

A recipe is a training config in TOML with the keys of `TrainConfig` and three more. ``base`` names a recipe
that supplies missing values; ``conditions`` is a name (see `load_conditions`); ``[gpu]`` overrides values on a
GPU. Its ``step_factor`` multiplies ``total_timesteps`` and the ``begin`` and ``duration`` of the curriculum
unless ``[gpu]`` sets them.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

from rans.choices import Quality
from rans.errors import ConfigError, brief, meant, meant_file, one_of
from rans.fast.device import torch_device
from rans.fast.learn.config import PPOSettings, TrainConfig, from_table
from rans.files import read_text
from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import USUAL, load_spacecraft
from rans.policy.prospects import Prospect
from rans.policy.timing import flies_to_a_pose, timing_of_file
from rans.pretrained import FOR_ANY_CRAFT, RECIPE_FOLDER, agent_recipes
from rans.randomization.conditions import Conditions
from rans.randomization.conditions_file import load_conditions
from rans.structure import LARGEST_TOML, merged, read_toml, refuse_other_file, structure
from rans.tasks import TASKS

RECIPES: tuple[str, ...] = tuple(agent_recipes())
"""Names of the recipes, one per agent that comes with RANS.

Other files of the folder: ``base-NAME.toml`` (shared values), ``preset-NAME.toml``, and
``good-TASK-PLACE.toml`` (trainings of minutes for any spacecraft).
"""


def recipe(name: str, device: str) -> TrainConfig:
    """Training config of an agent that comes with RANS.

    On a GPU the network is larger and trains for many more steps, in less time than on a CPU core.

    Args:
        name: one of `RECIPES`.
        device: torch device to train on.
    """
    return _config(RECIPE_FOLDER / f"{name}.toml", device)


def check_task(name: str) -> None:
    """Raise ConfigError if there is neither a task nor a recipe of this name."""
    if name.endswith(".toml") or ":" in name or name in TASKS or name in RECIPES:
        return
    own = f" (did you mean {Path(name).stem}:CLASS, a class in that file?)"
    is_module = name.endswith(".py") or Path(f"{name}.py").is_file()
    near = own if is_module else meant(name, [*TASKS, *RECIPES]) or meant_file(name)
    raise ConfigError(
        f"there is no task and no recipe named {brief(name)}{near}; tasks are {', '.join(TASKS)}; recipes have the "
        "names of agents (`rans list AGENTS`), and your own is a file whose name ends in .toml."
    )


def training(task: str, spacecraft: str | None = None, device: str | None = None) -> TrainConfig:
    """Training config by name: a task with its defaults and known-good settings, or a recipe.

    Args:
        task: name in `TASKS` or `RECIPES`, MODULE:NAME of a task, or your own recipe file ending in .toml.
        spacecraft: name or TOML file; None: that of the task, or floating-platform. Recipes name theirs.
        device: cpu or cuda; None: a GPU if there is one.

    Raises:
        ConfigError: there is no such task, recipe or spacecraft, or the recipe's file is wrong.
    """
    device = device or torch_device()
    if task in RECIPES:
        return recipe(task, device)
    if task.endswith(".toml"):
        return _config(Path(task), device)
    check_task(task)
    settings = TASKS[task]()
    named: str = settings.spacecraft or USUAL[2] if spacecraft is None else spacecraft
    craft = load_spacecraft(named)
    return TrainConfig(
        task,
        settings,
        named,
        replace(preset(task, craft.dimension, device), symmetric=settings.symmetric),
        timing=timing_of_file(craft, settings, named),
        device=device,
    )


def from_any_craft(config: TrainConfig, craft: Spacecraft) -> TrainConfig:
    """The config of a short training that begins from the agent for any craft, if that flies its task and craft.

    It imitates the agent, and ends as soon as it solves the task. By reinforcement learning alone the agent of
    the same seconds spends 1.8 to 2.5 times the thrust (docs/decisions/learners.md).
    In space, under conditions and for other tasks the config is as it was.
    """
    plain = config.conditions.or_none is None and not config.guard and not config.plain
    if craft.dimension != 2 or not plain or not flies_to_a_pose(config.settings, craft):
        return config
    try:
        if Prospect.of(craft, config.timing.control_period).reason:
            return config
    except ConfigError:
        return config
    ppo = replace(config.ppo, n_envs=_IMITATING_ENVS, n_steps=_IMITATING_STEPS)
    if craft.thrust_sharing == "split" and not craft.is_continuous:
        # Valves that are chosen one by one take each other's thrust.
        ppo = replace(ppo, backbone="allocated")
    return replace(config, ppo=ppo, begin_from=f"pretrained:{FOR_ANY_CRAFT[2]}#{_FRUGALITY:g}")


_FRUGALITY = 0.4
"""Frugality of the agent that a short training imitates: of 0, 0.2 and 0.4 the cheapest that is quick."""
_IMITATING_ENVS, _IMITATING_STEPS = 256, 32
"""Environments and steps of a rollout, as many transitions as the preset's in half of the processor time."""


def training_of_quality(
    task: str,
    spacecraft: str | None,
    quality: Quality,
    device: str | None = None,
    randomized: bool = False,
) -> TrainConfig:
    """Training config of a task with any spacecraft, with a length set by its quality.

    "quick" ends as soon as the task is solved. "good" and "best" train to the end of a recipe: the one for
    this task and dimension, otherwise the task's default settings with the hyper-parameters of long trainings.

    Args:
        task: name in `TASKS`, or MODULE:NAME of a task.
        spacecraft: name or TOML file; None: that of the task, or floating-platform.
        quality: training effort, see `Quality`.
        device: cpu or cuda; None: a GPU if there is one.
        randomized: whether conditions are used; agents then have a memory of their episode.

    Raises:
        ConfigError: there is no such task or spacecraft, or the name is a recipe, which sets its own length.
    """
    one_of("quality", quality, get_args(Quality))
    if task in RECIPES or task.endswith(".toml"):
        raise ConfigError(
            f"{brief(task)} is a recipe, which has its own length: leave out the quality, or name the task."
        )
    quick = training(task, spacecraft, device)
    if quality == "quick":
        return quick
    dimension = craft_of(quick).dimension
    file = _recipe_file(task, dimension, quality, randomized)
    if file is None:
        result = _to_the_end(quick)
    else:
        result = replace(_config(file, quick.device), spacecraft=quick.spacecraft)
        if quick.timing != quick.settings.timing:
            result = replace(result, timing=quick.timing)
    # Under conditions a network needs a memory, as base-adaptive has it.
    ppo = result.ppo
    if randomized and ppo.memory.kind == "none":  # the spacecraft varies between episodes
        table = _table(RECIPE_FOLDER / "base-adaptive.toml")["ppo"]
        adaptive = structure(table, PPOSettings, "base-adaptive.ppo")
        ppo = replace(ppo, memory=adaptive.memory, privileged_critic=adaptive.privileged_critic)
    return replace(result, ppo=ppo, conditions=Conditions())


def craft_of(config: TrainConfig) -> Spacecraft:
    """Spacecraft that a training config names; a module (MODULE:NAME) only if the user has typed or trusts it.

    Raises:
        ConfigError: there is no such spacecraft.
    """
    return load_spacecraft(config.spacecraft)


def _to_the_end(quick: TrainConfig) -> TrainConfig:
    """Config of the same task with the length and hyper-parameters of long trainings.

    The result is what `best` trains where no recipe of the task is in the folder.
    """
    table = _on_device(_table(RECIPE_FOLDER / "base-precise.toml"), quick.device)
    ppo = structure(table["ppo"], PPOSettings, "base-precise.ppo")
    return replace(
        quick,
        ppo=replace(ppo, symmetric=quick.ppo.symmetric),
        total_timesteps=table["total_timesteps"],
        report_interval=table["report_interval"],
        solved_share=None,
    )


def _recipe_file(task: str, dimension: int, quality: Quality, randomized: bool) -> Path | None:
    """Recipe file of a quality, by the names that recipes have; None: this task has none.

    The first that exists counts, from the most special one on. Names are part of the interface: pages and tests
    have them.
    """
    space = "plane" if dimension == 2 else "space"
    own = RECIPE_FOLDER / f"{quality}-{task}-{space}.toml"
    if not (quality == "best" and randomized) and ":" not in task and own.exists():
        return own
    endings = ["", "-shared"]
    if quality == "best" and randomized:
        endings = ["-robust", *endings]
    names = [f"{task}-{dimension}d{ending}" for ending in endings]
    return next((RECIPE_FOLDER / f"{name}.toml" for name in names if name in RECIPES), None)


def preset(task: str, dimension: int, device: str) -> PPOSettings:
    """Hyper-parameters known to solve a task with its default settings.

    Args:
        task: name; user-defined tasks use the preset of their dimension.
        dimension: 2 or 3.
        device: torch device; any device but a CPU uses the GPU values.
    """
    space = "plane" if dimension == 2 else "space"
    own = RECIPE_FOLDER / f"preset-{task}-{space}.toml"
    file = own if ":" not in task and own.exists() else RECIPE_FOLDER / f"preset-{space}.toml"
    table = _on_device(_table(file), device)
    return structure(table.get("ppo", {}), PPOSettings, f"{file.stem}.ppo")


def _config(file: Path, device: str) -> TrainConfig:
    """Training config of a recipe file on a device; errors name the file."""
    try:
        table = _on_device(_table(file), device)
        named = table.pop("conditions", None)
        conditions = Conditions() if named is None else load_conditions(named)
        # Recipes train for all their steps; TOML has no null to express this.
        config = from_table({"solved_share": None} | table | {"device": device})
        return replace(config, conditions=conditions)
    except ConfigError as error:
        raise ConfigError(f"{file}: {error}") from error


def _table(file: Path) -> dict[str, Any]:
    """Table of a recipe file merged over that of its ``base``, and of the base's own.

    Bases may not be files of a user, which ends every chain of them.
    """
    table = read_toml(read_text(file, LARGEST_TOML))
    refuse_other_file(table, "recipe")
    base = table.pop("base", None)
    if base is None:
        return table
    recipe_names = sorted(path.stem for path in RECIPE_FOLDER.glob("*.toml"))
    if base not in recipe_names:
        raise ConfigError(
            f"base must be the name of a recipe that comes with RANS, one of {', '.join(recipe_names)}, "
            f"got {brief(base)}."
        )
    below = _table(RECIPE_FOLDER / f"{base}.toml")
    return merged(below, table)


def _on_device(table: dict[str, Any], device: str) -> dict[str, Any]:
    """Table of a recipe for a device, with ``[gpu]`` applied or removed.

    A table of ``[gpu]`` counts more than its ``step_factor``. The argument loses its entry ``gpu``.
    """
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
    """Number of steps times a factor; any other value is kept, and `from_table` rejects it."""
    return steps * factor if type(steps) is int else steps
