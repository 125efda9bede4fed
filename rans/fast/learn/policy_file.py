"""Reading and writing of a learner, so that its training can continue."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Any

import torch

from rans.errors import ConfigError
from rans.fast.agent_files.agent import SavedPolicy, read_policy, save_agent
from rans.fast.learn.adam import Adam
from rans.fast.learn.config import PPOSettings
from rans.fast.learn.learner import Learner
from rans.fast.learn.run_folder import RunFolder
from rans.policy.architecture import EXTRACTOR
from rans.policy.network import Network
from rans.pretrained import agent_path, missing_agents, pretrained_names

_SETTLED = 1e12
"""Number of observations assigned to loaded statistics, so that training does not change them."""


def write_learner(file: Path, learner: Learner, settings: PPOSettings, steps: int) -> None:
    """Write the agent of a learner and its Adam moments after ``steps`` environment steps.

    A file whose name ends in ``.zip`` is one that Stable-Baselines3 opens too (`rans.fast.policy.write_policy`,
    which needs that package); any other is an ``agent.safetensors`` (`save_agent`).
    """
    network = learner.network
    adam = learner.adam
    if file.suffix == ".zip":
        from rans.fast.policy import write_policy as write
    else:
        write = save_agent
    write(
        file,
        network.architecture,
        network.weights(),
        settings,
        steps,
        moments(adam),
        float(adam.rate),
    )


@torch.no_grad()
def adopt(learner: Learner, saved: SavedPolicy) -> None:
    """Load weights and Adam moments into a learner; RuntimeError or KeyError if the network is another one."""
    for name, tensor in learner.network.tensors.items():
        tensor.copy_(saved.network.tensors[name])
    load_moments(learner.adam, saved.adam, saved.rate)


def moments(adam: Adam) -> dict[Any, Any]:
    """Adam moments in the form of torch's Adam state."""
    steps = adam.steps.detach().cpu().float()
    first, second = ([x.detach().cpu().clone() for x in tensors] for tensors in adam.moments)
    return {
        index: {"step": steps.clone(), "exp_avg": a, "exp_avg_sq": b}
        for index, (a, b) in enumerate(zip(first, second, strict=True))
    }


def load_moments(adam: Adam, saved: dict[Any, Any], rate: float) -> None:
    """Load Adam moments from `moments`; without any, they stay zero."""
    adam.rate.fill_(rate)
    for parameter, moments_of in saved.items():
        for memory, name in zip(adam.moments, ("exp_avg", "exp_avg_sq"), strict=True):
            memory[parameter].copy_(moments_of[name])
        adam.steps.copy_(moments_of["step"])


@torch.no_grad()
def begin_from(network: Network, agent: str) -> None:
    """Set the weights to those of an agent, and keep its observation statistics constant.

    Args:
        network: network, changed in place.
        agent: run folder, or pretrained:NAME.

    Raises:
        ConfigError: there is no such agent, or its network is another one.
    """
    run = RunFolder(agent_path(agent))
    if not run.agent_file.exists():
        is_shipped = agent in (*pretrained_names(), *missing_agents())
        hint = f" (did you mean pretrained:{agent}?)" if is_shipped else ""
        raise ConfigError(
            f"begin_from is {agent!r}, which has no agent{hint}: name a run folder, or pretrained:NAME."
        )
    same = (
        f"`rans train {shlex.quote(str(run.path / 'config.json'))}` has the settings of the agent"
    )
    saved = read_policy(run.agent_file).network
    loaded = saved.architecture
    present = network.architecture
    if loaded.layout != present.layout or set(saved.tensors) != set(network.tensors):
        raise ConfigError(
            f"begin_from is {agent!r}, whose network observes or commands something else than this training's; the "
            f"usual cause is another task, spacecraft, head or memory, and {same}."
        )
    statistics = [EXTRACTOR + statistic for statistic in present.statistics()]
    for key, tensor in network.tensors.items():
        values = saved.tensors[key]
        if values.shape != tensor.shape:
            raise ConfigError(
                f"begin_from is {agent!r}, whose {key} has the shape {tuple(values.shape)} and not that of this "
                f"training; the usual cause is another ppo.backbone, ppo.layers or ppo.memory, and {same}."
            )
        tensor.copy_(values)
    network.tensors[statistics[-1]].fill_(_SETTLED)
