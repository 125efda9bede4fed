"""The agents that come with the package: what flies of a run folder, without what only training needs."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

from rans.errors import ConfigError, brief, meant
from rans.files import read_json

FOLDER = Path(__file__).parent / "data" / "pretrained"
"""One folder an agent: agent.safetensors, config.json, spacecraft.toml and card.json."""
RECIPE_FOLDER = FOLDER.parent / "recipes"
"""One TOML file NAME.toml an agent, by which it is trained (`rans.fast.learn.recipes`)."""

_FORMER_NAMES = {"go-to-pose-2d-knob": "go-to-pose-2d-trade-off"}
"""Names of agents and recipes in the version before, which work for one version more and warn."""


def present_agent(name: str) -> str:
    """Present name of an agent or a recipe; a former one warns with a `DeprecationWarning`."""
    if (new := _FORMER_NAMES.get(name)) is None:
        return name
    warnings.warn(
        f"the agent {name} is called {new} now; its former name goes with the next version.",
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
    """Where the agent of this name is.

    Raises:
        ConfigError: there is none.
    """
    name = present_agent(name)
    if name not in pretrained_names():
        raise ConfigError(
            f"no agent named {brief(name)} comes with RANS{meant(name, pretrained_names())}; "
            f"known are {', '.join(pretrained_names()) or 'none'}."
        )
    return FOLDER / name


def pretrained_card(name: str) -> dict[str, Any]:
    """What an agent is worth and how it came to be (`rans.deploy.export`); raises as `pretrained_folder`."""
    return read_json(pretrained_folder(name) / "card.json")
