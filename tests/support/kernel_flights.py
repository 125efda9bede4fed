"""Policies and setups that tests of many flights share."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import torch

from rans import Conditions, GoToPose, Spacecraft, Timing
from rans.episode.step import Setup
from rans.policy.architecture import Architecture
from rans.policy.network import Network
from rans.policy.symmetry import symmetries
from rans.tasks.base import Task
from rans.tasks.derived import layout
from tests.support.training import scatter

BRIEF = Timing(episode_steps=12)
WIDE = GoToPose(
    spawn_distance=(0.3, 1.0),
    fail_distance=1.05,
    fail_spin=15.0,
    position_tolerance=0.8,
    attitude_tolerance=2.0,
)
"""In `BRIEF` episodes random policies fail at it in every way, and succeed."""


def setup(craft: Spacecraft, task: Task = WIDE, conditions: Conditions | None = None) -> Setup:
    """Brief flights."""
    return Setup(craft, task, replace(BRIEF, substeps=1), conditions)


def policy(
    craft: Spacecraft,
    task: Task = WIDE,
    layers: tuple[int, ...] = (16, 32),
    sided: bool = True,
    **settings: Any,
) -> Network:
    """A float32 network with random weights and statistics, which sees the craft from one of its sides."""
    views = symmetries(craft) if sided else None
    usual: dict[str, Any] = {"head": "gaussian" if craft.actuators.is_continuous else "on-off"}
    given = Architecture(
        layout(task, craft.dimension),
        len(craft.thrusters),
        layers,
        symmetries=views,
        **(usual | settings),
    )
    tensors, _ = given.initial(0, 0.3)
    return scatter(Network.copied(given, tensors, torch.device("cpu"), torch.float32))
