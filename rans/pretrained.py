"""The agents that come with the package: what flies of a run folder, without what only training needs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rans.errors import ConfigError, brief, meant
from rans.files import read_json

FOLDER = Path(__file__).parent / "data" / "pretrained"
"""One folder an agent: agent.safetensors, config.json, spacecraft.toml and card.json."""
RECIPE_FOLDER = FOLDER.parent / "recipes"
"""One TOML file NAME.toml an agent, by which it is trained (`rans.fast.learn.recipes`)."""


def pretrained_names() -> list[str]:
    """Names of the agents that come with the package, sorted.

    >>> "go-to-pose-2d" in rans.pretrained_names()
    True
    """
    return sorted(file.parent.name for file in FOLDER.glob("*/agent.safetensors"))


def pretrained_folder(name: str) -> Path:
    """Where the agent of this name is.

    Raises:
        ConfigError: there is none.
    """
    if name not in pretrained_names():
        raise ConfigError(
            f"no agent named {brief(name)} comes with RANS{meant(name, pretrained_names())}; "
            f"known are {', '.join(pretrained_names()) or 'none'}."
        )
    return FOLDER / name


def pretrained_card(name: str) -> dict[str, Any]:
    """What an agent is worth and how it came to be (`rans.deploy.export`); raises as `pretrained_folder`."""
    return read_json(pretrained_folder(name) / "card.json")
