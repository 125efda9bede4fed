"""Speed of the trainer: steps flown and learned from per second, and seconds until a task is solved."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import NamedTuple

import torch

from rans.fast.engine import Engine
from rans.fast.learn.config import PPOSettings, TrainConfig
from rans.fast.learn.member import begin
from rans.fast.learn.run_folder import RunFolder
from rans.fast.learn.trainer import Trainer
from rans.fast.threads import one_thread
from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import load_spacecraft
from rans.tasks import GoToPose, Task
from validation.speed.measurement import Clock, Measurement

LARGE = PPOSettings(n_envs=65_536, n_steps=16, batch_size=262_144, layers=(128, 128), matmul="bf16")
"""What keeps a large GPU busy; the presets, which need fewer steps, do not."""


class Success(NamedTuple):
    """A training until its task was solved, or its steps spent."""

    solved: bool
    seconds: float
    """Of training, without warm-up."""
    warm_up: float
    """Seconds."""
    steps: int


def trainer_rate(craft: Spacecraft, task: Task, settings: PPOSettings, clock: Clock) -> Measurement:
    """Environment steps per second of PPO: flown, and learned from in every epoch."""
    torch.compiler.reset()  # what other measurements compiled counts towards the compiler's limit
    with one_thread():
        engine = Engine(craft, task, settings.n_envs, device=clock.device)
        learner = begin(engine, [settings], [0])

        def iteration() -> None:
            learner.collect()
            learner.update()

        seconds, warm_up = clock.time(iteration)
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


def train_until_solved(
    settings: PPOSettings,
    device: str,
    spacecraft: str = "floating-platform",
    seed: int = 0,
    report_interval: int = TrainConfig.report_interval,
) -> Success:
    """One training of go-to-pose as ``rans train`` does it."""
    with tempfile.TemporaryDirectory() as folder, one_thread():
        config = TrainConfig(
            "go-to-pose",
            GoToPose(),
            spacecraft,
            settings,
            seed=seed,
            device=device,
            report_interval=report_interval,
            compiled=True,
        )
        run = RunFolder(Path(folder) / "run")
        run.begin(config, "rans benchmark")
        trainer = Trainer([config], load_spacecraft(spacecraft), run)
        trainer.train(lambda _: None)
    return Success(trainer.solved, trainer.seconds, trainer.warm_up, trainer.steps)
