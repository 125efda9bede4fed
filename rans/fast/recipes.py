"""How the agents that come with RANS are trained, one row of values each (docs/agents.md)."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

from rans.fast.config import PPOSettings, TrainConfig
from rans.fast.curriculum import Ramp
from rans.tasks import task_class


@dataclass(frozen=True)
class Recipe:
    """What differs from agent to agent; the rest is as in every training."""

    task: str
    spacecraft: str
    settings: dict[str, Any]
    """Of the task, where they are not its defaults."""
    ppo: PPOSettings = field(default_factory=PPOSettings)
    total_timesteps: int = 10_000_000
    curriculum: tuple[Ramp, ...] = ()


_PLANE = PPOSettings(n_envs=256, n_steps=64, batch_size=4096, gamma=0.99, max_learning_rate=3e-3, anneal=0.7)
"""Twice a preset's batch and a step size that falls to zero: minutes on one core, closer in the end."""
_SPACE = replace(_PLANE, layers=(128, 128))
_HOLD = {"fine_weight": 0.5, "rest_position": 0.007}
_POSE = {**_HOLD, "rest_attitude": 0.01}
_PLATFORM, _SHARED, _FLYER = "floating-platform", "floating-platform-shared", "free-flyer"
_VELOCITY = {"fine_scale": 0.01, "thrust_weight": 0.05}

RECIPES: dict[str, Recipe] = {
    "go-to-pose-2d": Recipe("go-to-pose", _PLATFORM, {**_POSE, "thrust_weight": 0.1}, _PLANE, 20_000_000),
    "go-to-pose-2d-shared": Recipe(
        "go-to-pose", _SHARED, {**_POSE, "thrust_weight": 0.15}, _PLANE, 20_000_000),
    "go-to-position-2d-shared": Recipe(
        "go-to-position", _SHARED, {**_HOLD, "rest_spin": 0.03, "thrust_weight": 0.1}, _PLANE),
    "track-velocity-2d": Recipe("track-velocity", _PLATFORM, _VELOCITY, _PLANE),
    "go-to-pose-3d": Recipe(
        "go-to-pose", _FLYER, {"fine_weight": 0.25, "fine_position_scale": 0.05, "fine_attitude_scale": 0.05,
                               "rest_position": 0.01, "rest_attitude": 0.02}, _SPACE),
    "go-to-position-3d": Recipe(
        "go-to-position", _FLYER,
        {**_HOLD, "rest_spin": 0.03, "thrust_weight": 0.05, "evaluation_distance": (1.0, 5.0),
         "spawn_distance": (0.5, 5.5)}, _SPACE),
    "track-velocity-3d": Recipe("track-velocity", _FLYER, _VELOCITY, _SPACE),
}
"""By the agent's name."""


def recipe(name: str, device: str) -> TrainConfig:
    """The training that the agent of this name, one of `RECIPES`, came from, for this device."""
    given = RECIPES[name]
    return TrainConfig(given.task, task_class(given.task)(**given.settings), given.spacecraft, given.ppo,
                       curriculum=given.curriculum, device=device, total_timesteps=given.total_timesteps,
                       report_interval=64, solved_share=None)
