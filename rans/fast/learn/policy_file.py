"""The weights of an agent as the beginning of another training."""

from __future__ import annotations

import shlex

import torch

from rans.base.errors import ConfigError
from rans.base.pretrained import agent_path, missing_agents, pretrained_names
from rans.fast.agent_files.agent import read_policy
from rans.fast.engine import Engine
from rans.fast.learn.run_folder import RunFolder
from rans.policy.architecture import EXTRACTOR, Architecture
from rans.policy.backbones import any_craft
from rans.policy.network import Network

_SETTLED = 1e12
"""Number of observations assigned to loaded statistics, so that training does not change them."""


def teacher(agent: str, engine: Engine, architecture: Architecture) -> Network | None:
    """The network of an agent for any craft, for the engine's craft; None: the agent is one of a single craft.

    Args:
        agent: run folder, or pretrained:NAME; #VALUE at its end makes it save thrust.
        engine: of the training.
        architecture: of the network that is to imitate it.

    Raises:
        ConfigError: it cannot fly the craft, or the network cannot imitate it.
    """
    path, _, value = agent.partition("#")
    file = RunFolder(agent_path(path)).agent_file
    if not file.exists():
        return None
    network = read_policy(file).network
    if network.architecture.authority:
        return any_craft().teacher(network, agent, engine, architecture)
    if value:
        raise ConfigError(
            f"begin_from is {agent!r}: only agents for any craft have a frugality after #."
        )
    return None


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
