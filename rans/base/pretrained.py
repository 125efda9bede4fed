"""Agents that come with RANS: run folders without the files that only training needs.

Seven are in this package. The others are in the distribution ``rans-agents``, the folder ``agents``.
"""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

from rans.base.errors import ConfigError, MissingPackage, brief, is_installed, meant
from rans.base.files import read_json

FOLDER = Path(__file__).parents[1] / "data" / "pretrained"
"""Folder with one folder per agent: agent.safetensors, config.json, spacecraft.toml and card.json."""
ADAPTIVE = "adaptive"
"""Prefix of names: the agent for any craft after it estimates in flight what the craft's file does not state."""
FOR_ANY_CRAFT = {2: "any-craft-2d", 3: "any-craft-3d"}
"""Agents that fly any craft, by dimension."""
PACKAGE = "rans_agents"
"""Module of the distribution with more agents, in the same form; it is located and never imported."""
RECIPE_FOLDER = FOLDER.parent / "recipes"
"""Folder with a recipe NAME.toml for each agent, installed or not, by which it was trained."""
_OTHER_RECIPES = ("base-", "best-", "good-", "preset-")
"""Beginnings of the names of recipes that belong to no agent (`rans.fast.learn.config`)."""


def agent_recipes() -> list[str]:
    """Names of the recipes of agents, sorted: one for each agent of this package and of ``rans-agents``."""
    names = (file.stem for file in RECIPE_FOLDER.glob("*.toml"))
    return sorted(name for name in names if not name.startswith(_OTHER_RECIPES))


def pretrained_names() -> list[str]:
    """Names of the installed agents, sorted: those of this package and, if installed, of ``rans-agents``.

    >>> from rans.base.pretrained import pretrained_names
    >>> "go-to-pose-2d" in pretrained_names()
    True
    """
    return sorted(_folders())


def missing_agents() -> list[str]:
    """Names of the agents of ``rans-agents``, sorted, if that distribution is not installed; else none."""
    return [] if is_installed(PACKAGE) else sorted(set(agent_recipes()) - _folders().keys())


def agent_path(text: str) -> Path:
    """Folder that a run folder's path or pretrained:NAME names.

    Raises:
        ConfigError: there is no such agent.
    """
    kind, _, name = text.partition(":")
    return pretrained_folder(name) if kind == "pretrained" else Path(text)


def pretrained_folder(name: str) -> Path:
    """Folder of the agent of this name.

    Raises:
        MissingPackage: the agent is in ``rans-agents``, which is not installed.
        ConfigError: there is no such agent.
    """
    folders = _folders()
    if name in folders:
        return folders[name]
    missing = missing_agents()
    if name in missing:
        raise MissingPackage(PACKAGE, f"The agent {name}")
    raise ConfigError(
        f"no agent named {brief(name)} comes with RANS{meant(name, [*folders, *missing])}; "
        "`rans list AGENTS` prints all."
    )


def _folders() -> dict[str, Path]:
    """Folder of each installed agent, by its name; an agent of this package has precedence.

    Nothing is read of a folder before its agent is asked for.
    """
    spec = importlib.util.find_spec(PACKAGE) if is_installed(PACKAGE) else None
    others = (spec and spec.submodule_search_locations) or ()
    return {
        file.parent.name: file.parent
        for folder in (*map(Path, others), FOLDER)
        for file in folder.glob("*/agent.safetensors")
    }


def pretrained_card(name: str) -> dict[str, Any]:
    """Card of an agent: its metrics and its training (`rans.deploy.export`).

    Raises:
        ConfigError: there is no such agent.
    """
    return read_json(pretrained_folder(name) / "card.json")
