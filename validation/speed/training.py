"""Speed of the trainer: steps flown and learned from per second."""

from __future__ import annotations

import torch

from rans.fast.engine import Engine
from rans.fast.learn.beginning import begin
from rans.fast.learn.config import PPOSettings
from rans.fast.threads import one_thread
from rans.model.spacecraft import Spacecraft
from rans.tasks import Task
from validation.speed.measurement import Clock, Measurement

LARGE = PPOSettings(n_envs=65_536, n_steps=16, batch_size=262_144, layers=(128, 128), matmul="bf16")
"""What keeps a large GPU busy; the presets, which need fewer steps, do not."""


def trainer_rate(craft: Spacecraft, task: Task, settings: PPOSettings, clock: Clock) -> Measurement:
    """Environment steps per second of PPO: flown, and learned from in every epoch."""
    torch.compiler.reset()  # what other measurements compiled counts towards the compiler's limit
    with one_thread():
        engine = Engine(craft, task, settings.n_envs, device=clock.device)
        learner = begin(engine, settings, 0)
        seconds, warm_up = clock.time(learner.learn)
    rollout = settings.n_envs * settings.n_steps
    layers = "x".join(map(str, settings.layers))
    matmul = settings.matmul if clock.on_gpu else "float32"
    name = f"PPO, {craft.name}, {settings.n_envs:,} x {settings.n_steps}"
    return Measurement(
        "training",
        name,
        rollout / seconds / 1e6,
        "M steps/s",
        warm_up,
        f"environments x steps; {layers}, {settings.n_epochs} epochs, {matmul}",
    )
