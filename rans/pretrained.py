"""Agents that come with the package: run folders without the files that only training needs."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

from rans.errors import ConfigError, brief, meant
from rans.files import read_json

FOLDER = Path(__file__).parent / "data" / "pretrained"
"""Folder with one folder per agent: agent.safetensors, config.json, spacecraft.toml and card.json."""
RECIPE_FOLDER = FOLDER.parent / "recipes"
"""Folder with a recipe NAME.toml for each agent, with which it was trained (`rans.fast.learn.recipes`)."""

_FORMER_NAMES = {"go-to-pose-2d-knob": "go-to-pose-2d-trade-off"}
"""Former names of agents and recipes, which are accepted with a warning for one more version."""


def present_agent(name: str) -> str:
    """Present name of an agent or a recipe; a former name gives a `DeprecationWarning`."""
    if (new := _FORMER_NAMES.get(name)) is None:
        return name
    warnings.warn(
        f"the agent {name} is now called {new}; its former name will be removed in the next version.",
        DeprecationWarning,
        stacklevel=3,
    )
    return new


def pretrained_names() -> list[str]:
    """Names of the agents that come with the package, sorted.

    >>> "go-to-pose-2d" in rans.pretrained_names()
    True
    """
    return sorted(file.parent.name for file in FOLDER.glob("*/agent.safetensors"))


def pretrained_folder(name: str) -> Path:
    """Folder of the agent of this name.

    Raises:
        ConfigError: there is no such agent.
    """
    name = present_agent(name)
    if name not in pretrained_names():
        raise ConfigError(
            f"no agent named {brief(name)} comes with RANS{meant(name, pretrained_names())}; "
            "`rans list AGENTS` prints all."
        )
    return FOLDER / name


def pretrained_card(name: str) -> dict[str, Any]:
    """Card of an agent: its metrics and its training (`rans.deploy.export`).

    Raises:
        ConfigError: there is no such agent.
    """
    return read_json(pretrained_folder(name) / "card.json")
