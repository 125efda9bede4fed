"""Hyper-parameters known to solve each task; how they were found is in docs/decisions/005-presets.md."""

from __future__ import annotations

from dataclasses import replace

from rans.fast.learn.config import PPOSettings
from rans.tasks import TASKS

_CPU = PPOSettings()
_CPU_SPACE = PPOSettings(n_envs=256, batch_size=4096, layers=(128, 128))
_GPU = PPOSettings(n_envs=256, n_steps=32, batch_size=2048, layers=(128, 128))
_GPU_SPACE = PPOSettings(n_envs=2048, n_steps=32, batch_size=16_384, layers=(256, 256))
_BY_BODY = {(2, "cpu"): _CPU, (3, "cpu"): _CPU_SPACE, (2, "cuda"): _GPU, (3, "cuda"): _GPU_SPACE}

_MANY = {("multi-task", 2, "cuda"): replace(_GPU, n_envs=512, n_steps=64, batch_size=8192)}
"""Many tasks at once need more flight in an update than one."""


def preset(task: str, dimension: int, device: str) -> PPOSettings:
    """The known-good settings; on another kind of device those for a GPU, for your own task the usual."""
    body = dimension, "cpu" if device.startswith("cpu") else "cuda"
    return replace(_MANY.get((task, *body), _BY_BODY[body]), symmetric=TASKS[task].symmetric)
