"""``policy.zip``: Stable-Baselines3 as a file format, which its own ``PPO.load`` opens."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3.common.save_util import load_from_zip_file, save_to_zip_file
from torch import Tensor

from rans.errors import ConfigError
from rans.fast.learn.architecture import Architecture
from rans.fast.learn.config import PPOSettings
from rans.fast.learn.network import Network
from rans.fast.policy import AgentPolicy, network_of, policy_kwargs
from rans.files import first_line, replace_file

_SHARED = ("n_envs", "n_steps", "batch_size", "n_epochs", "learning_rate", "gamma", "gae_lambda",
           "clip_range", "ent_coef", "vf_coef", "max_grad_norm")
"""Settings that SB3 knows by the same names."""
_SETTINGS = "rans_settings"
"""All of ours, for `rans.PPO`; SB3 keeps what it does not know."""


class SavedPolicy(NamedTuple):
    """What is in a ``policy.zip``."""

    network: Network
    """Of one member, on the CPU."""
    settings: dict[str, Any]
    """Of `PPOSettings`, as far as the file knows them."""
    steps: int
    """Environment steps learned from."""
    adam: dict[Any, Any]
    """State of torch's Adam, as `Adam.member` gives it."""
    rate: float
    """Its step size."""


def policy_spaces(architecture: Architecture) -> tuple[spaces.Box, spaces.Space[Any]]:
    """What an agent observes and commands, in Gymnasium's terms."""
    bounds = architecture.bounds or (math.inf,) * architecture.layout.width
    most, count = np.minimum(bounds, np.finfo(np.float32).max).astype(np.float32), architecture.thrusters
    seen = spaces.Box(-most, most, dtype=np.float32)
    return seen, (spaces.Box(0.0, 1.0, (count,), np.float32) if architecture.continuous
                  else spaces.MultiDiscrete([2] * count))


def write_policy(file: Path, architecture: Architecture, tensors: Mapping[str, Tensor], settings: PPOSettings,
                 steps: int, adam: dict[Any, Any] | None = None, rate: float | None = None) -> None:
    """Save one agent.

    Args:
        file: to write.
        architecture: of its network.
        tensors: its weights and statistics, as `Network.member` gives them.
        settings: of its training, which SB3 goes on with.
        steps: environment steps that it learned from.
        adam: what `Adam.member` gave; by default Adam begins anew.
        rate: Adam's step size.

    Raises:
        ConfigError: the disk refused.
    """
    seen, commanded = policy_spaces(architecture)
    kwargs, rate = policy_kwargs(architecture), rate or settings.learning_rate
    policy = AgentPolicy(seen, commanded, lambda _: rate, **kwargs)
    policy.to(next(iter(tensors.values())).dtype)
    names = dict((*policy.named_parameters(), *policy.named_buffers()))
    with torch.no_grad():
        for name, place in names.items():
            place.copy_(tensors[name])
    optimizer = policy.optimizer.state_dict()
    if adam:
        optimizer["state"] = adam
    data = {"policy_class": AgentPolicy, "policy_kwargs": kwargs, "observation_space": seen,
            "action_space": commanded, "verbose": 0, "num_timesteps": steps,
            **{name: getattr(settings, name) for name in _SHARED}, _SETTINGS: dataclasses.asdict(settings)}

    def write(draft: Path) -> None:
        with draft.open("wb") as stream:  # not a path: SB3 adds ".zip" to one that has another ending
            save_to_zip_file(stream, data, {"policy": policy.state_dict(), "policy.optimizer": optimizer})

    replace_file(file, write)


def read_policy(file: Path) -> SavedPolicy:
    """An agent that `rans train` or `rans.PPO` saved, of this version or an older one.

    Raises:
        ConfigError: the file is damaged, or none of theirs.
    """
    try:
        data, params, _ = load_from_zip_file(file, device="cpu")
        if data is None or params is None:
            raise ValueError("it holds no agent")
        policy = data["policy_class"](data["observation_space"], data["action_space"], lambda _: 1e-3,
                                      **data["policy_kwargs"])
        policy.load_state_dict(params["policy"])
        network = network_of(policy)
        optimizer: Any = params["policy.optimizer"]
    except ConfigError:
        raise
    except Exception as error:  # a damaged pickle raises anything
        raise ConfigError(f"{file} is damaged: {first_line(error)}.") from error
    known = {name: data[name] for name in _SHARED if name in data and not callable(data[name])}
    return SavedPolicy(network, known | data.get(_SETTINGS, {}), data.get("num_timesteps", 0),
                       optimizer["state"], float(optimizer["param_groups"][0]["lr"]))
