"""The first moment of a training."""

from __future__ import annotations

from collections.abc import Sequence
from typing import get_args

import torch

from rans.errors import ConfigError
from rans.fast.engine import Engine
from rans.fast.learn.architecture import Architecture
from rans.fast.learn.config import PPOSettings, Precision
from rans.fast.learn.network import Network
from rans.fast.learn.ppo import Learner


def begin(engine: Engine, settings: Sequence[PPOSettings], seeds: Sequence[int]) -> Learner:
    """Members that have learnt nothing, on an engine whose episodes then began at random times.

    Args:
        engine: with the members' environments, in equal and contiguous parts.
        settings: one a member.
        seeds: of weights, actions and those times; one a member.

    Raises:
        ConfigError: the settings do not fit the engine.
    """
    for one in settings:
        check_sizes(engine, one, len(settings))
    given = Architecture.of(engine, settings[0])
    set_precision(settings[0].matmul, engine.device)
    drawn = [given.initial(seed, one.initial_duty) for seed, one in zip(seeds, settings, strict=True)]
    network = Network.stacked(given, [tensors for tensors, _ in drawn], engine.device, engine.dtype)
    generators = [generator for _, generator in drawn]
    engine.stagger(*generators)
    if engine.device.type == "cuda":
        torch.cuda.manual_seed(seeds[0])
    return Learner(engine, network, settings, generators)


def check_sizes(engine: Engine, settings: PPOSettings, members: int) -> None:
    """Whether rollouts and minibatches can be cut as the settings say.

    Raises:
        ConfigError: they cannot.
    """
    steps, batch, processes = settings.n_steps, settings.batch_size, engine.processes
    if steps > engine.timing.episode_steps:
        raise ConfigError(
            f"n_steps must not exceed the episode's {engine.timing.episode_steps} steps, got {steps}: an "
            "episode may be cut off once a rollout at most.")
    if engine.num_envs * processes.size != settings.n_envs * members:
        raise ConfigError(f"n_envs must be the engine's {engine.num_envs * processes.size // members} "
                          f"environments a member, got {settings.n_envs}.")
    samples = settings.n_envs * steps
    if batch % steps or samples % batch:
        raise ConfigError(
            f"batch_size must be a multiple of n_steps = {steps} that divides n_steps x environments = "
            f"{samples}, got {batch}.")
    processes.share("batch_size", batch // steps)


def set_precision(matmul: str, device: torch.device) -> None:
    """Let a GPU multiply matrices of float32 like this, see `rans.fast.learn.config.Precision`; process-wide.

    Raises:
        ConfigError: there is no such precision.
    """
    if matmul not in get_args(Precision):
        raise ConfigError(f"matmul must be one of {', '.join(get_args(Precision))}, got {matmul!r}.")
    if device.type == "cuda":
        torch.set_float32_matmul_precision("highest" if matmul == "float32" else "high")
