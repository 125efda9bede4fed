"""Shipped agents, their exports in every form, and the names of an exported file."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from rans.deploy.contract import recorded
from rans.deploy.export import Form, write_agent
from rans.episode import Setup
from rans.fast.agent_files.agent import SavedPolicy, read_policy
from rans.fast.learn.config import PPOSettings
from rans.fast.learn.run_folder import RunFolder
from rans.policy.network import Network
from rans.pretrained import pretrained_folder

FAST = ["export", "pretrained:go-to-pose-2d-fast", "--format"]


@cache
def shipped(name: str) -> tuple[Network, Setup]:
    """A shipped agent and what it was trained on, in a perfect world."""
    run = RunFolder(pretrained_folder(name))
    config = run.config()
    craft = run.spacecraft()
    return (
        read_policy(run.agent_file).network,
        Setup(craft, config.settings, config.timing),
    )


@cache
def remembering() -> tuple[Network, Setup, np.ndarray]:
    """An agent with a history, averages and symmetries, and what it observes on four flights."""
    network, setup = shipped("go-to-pose-2d-faults")
    flights, _ = recorded(network, setup, count=4)
    return network, setup, flights.observations


def written(folder: Path, network: Network, *forms: Form, title: str = "agent") -> Path:
    """The folder with the network in these forms."""
    for form in forms:
        write_agent(folder, form, SavedPolicy(network, {}, 0, {}, 0.0), PPOSettings(), title)
    return folder


def exported(folder: Path) -> dict[str, Any]:
    """The names of an exported file."""
    names: dict[str, Any] = {"__file__": str(folder / "agent.py"), "__name__": "agent"}
    exec(compile((folder / "agent.py").read_text("utf-8"), "agent.py", "exec"), names)
    return names
