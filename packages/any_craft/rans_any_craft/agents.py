"""Training of the agents for any craft: ``python -m rans_any_craft train --dimension 2 --seed 12 --device cuda``.

The agent is written where it comes with RANS, or into the folder of ``--output``. ``values`` in place of ``train``
trains only the weights of every value from fast to frugal, from those of an agent, which stay.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from shutil import copytree
from typing import Literal

import torch
from torch import Tensor

from rans.deploy.export import evaluated
from rans.evaluation.fly.protocols import fitting_protocols
from rans.extend import (
    EVALUATION_SEED,
    GoToPose,
    Network,
    Timing,
    TrainConfig,
    environment,
    load_spacecraft,
    read_json,
    to_toml,
    write_json,
    write_text,
)
from rans.fast.agent_files.agent import AGENT, actor_bytes, read_policy
from rans.fast.learn.config import to_table
from rans.policy.authority import DIMENSIONS
from rans.pretrained import FOLDER, FOR_ANY_CRAFT
from rans_any_craft.evolution import NODES, SETTINGS, evolve
from rans_any_craft.training import (
    DemandNetwork,
    DemandSettings,
    Stage,
    as_policy,
    draw_pool,
    policy_layers,
    train,
    with_weights,
)

_OWN = {2: ("floating-platform", Timing(0.2, 1, 125)), 3: ("free-flyer", Timing(0.2, 1, 125))}
"""Craft and timing of an agent without a craft's name."""
RECIPES = {
    2: DemandSettings(
        stages=(Stage(295.0, 2.4, 0.9, 1.1), Stage(75.0, 2.6, 0.9, 0.6)),
        last=0.3,
        crafts=2048,
        coarse=0.4,
        shared=0.4,
    ),
    3: DemandSettings(
        3,
        (
            Stage(60.0, 1.0, 1.0),
            Stage(70.0, 2.5, 2.5),
            Stage(100.0, 2.0, 2.0, angle=0.05, learning_rate=1e-3),
        ),
        last=0.85,
        layouts=1920,
        crafts=4096,
        channels=3,
    ),
}
"""Trainings of the agents, by dimension, on one H200."""
_LAYOUTS_OF_VALUES = 960
"""Layouts of a training of weights for every value."""


def write_agent(folder: Path, settings: DemandSettings) -> None:
    """Train an agent and write it as a run folder without a critic."""
    begun = time.perf_counter()
    network = train(settings, lambda text, _: print(text, flush=True))  # noqa: T201
    further = _evolved([network], settings.seed, settings.device)
    save(folder, network.state_dict(), settings, time.perf_counter() - begun, further)


def _evolved(begun: Sequence[DemandNetwork], seed: int, device: str) -> list[dict[str, Tensor]]:
    """Weights of every node, see `evolve`, with layouts of a seed that no training of networks has."""
    dimension = begun[0].dimension
    shared = RECIPES[dimension].shared
    pool = draw_pool(_LAYOUTS_OF_VALUES, 6000 + 2 * seed, dimension, None, shared)
    settings = replace(SETTINGS[dimension], seed=seed, device=device)
    return evolve(begun, pool, settings, lambda text: print(text, flush=True))  # noqa: T201


def write_values(source: Path, folder: Path, seed: int, device: str, is_continued: bool) -> None:
    """Train weights of every value from an agent's own weights, which stay, and write the agent with them.

    Args:
        source: run folder of the agent.
        folder: to be written.
        seed: of the training.
        device: of torch.
        is_continued: whether the training begins with the weights that the agent has for values.
    """
    begun = time.perf_counter()
    saved = read_policy(source / AGENT)
    network = saved.network
    architecture = network.architecture
    tensors = [network.member(0)]
    if is_continued:
        tensors += [dict(network.at[value]) for value in NODES]
    dimension = DIMENSIONS[len(architecture.authority) - 1]
    networks = [
        DemandNetwork.of_layers(policy_layers(Network(architecture, own)), dimension)
        for own in tensors
    ]
    further = _evolved(networks, seed, device)
    at: dict[float, dict[str, Tensor]] = {}
    for value, own in zip(NODES, further, strict=True):
        networks[0].load_state_dict(own, strict=False)
        at[value] = with_weights(network, networks[0])
    if folder != source:
        copytree(source, folder, dirs_exist_ok=True)
    (folder / AGENT).write_bytes(actor_bytes(architecture, tensors[0], saved.steps, at))
    card = read_json(folder / "card.json")
    card["training"]["values"] = {
        "nodes": NODES,
        "seed": seed,
        "device": device,
        "begun with those of values": is_continued,
        "seconds": round(time.perf_counter() - begun, 1),
        "settings": asdict(SETTINGS[dimension]),
        "environment": environment(),
    }
    write_json(folder / "card.json", card)


def save(
    folder: Path,
    weights: dict[str, Tensor],
    settings: DemandSettings,
    seconds: float,
    further: Sequence[dict[str, Tensor]] = (),
) -> None:
    """Write trained weights as the agent of one craft, which flies others by `for_spacecraft`.

    ``further`` are those of the frugalities of `NODES`.

    The card is written twice, as the evaluation loads the folder; its keys are those of every card.
    """
    network = DemandNetwork(settings.channels, torch.Generator(), settings.dimension)
    name, timing = _OWN[settings.dimension]
    craft = load_spacecraft(name)
    task = GoToPose()
    policies = []
    for own in (weights, *further):
        network.load_state_dict(own, strict=False)
        policies.append(as_policy(network, craft, task, timing.control_period))
    policy, *others = policies
    at = {value: one.member(0) for value, one in zip(NODES, others, strict=False)}
    folder.mkdir(parents=True, exist_ok=True)
    (folder / AGENT).write_bytes(actor_bytes(policy.architecture, policy.member(0), 0, at or None))
    config = TrainConfig("go-to-pose", task, craft.name, timing=timing, seed=settings.seed)
    write_json(folder / "config.json", to_table(config))
    write_text(folder / "spacecraft.toml", to_toml(craft))
    card = {
        "name": folder.name,
        "task": "go-to-pose",
        "spacecraft": craft.name,
        "training": {
            "seed": settings.seed,
            "steps": 0,
            "seconds": round(seconds, 1),
            "device": settings.device,
            "settings": asdict(settings),
            "environment": environment(),
        },
    }
    write_json(folder / "card.json", card)
    episodes = 1024
    card |= evaluated(str(folder), fitting_protocols(craft), episodes, EVALUATION_SEED)
    write_json(folder / "card.json", card)


def train_agent(
    dimension: Literal[2, 3] = 2, seed: int = 0, device: str = "cpu", output: Path | None = None
) -> None:
    """Train an agent for any craft; minutes on a GPU.

    Args:
        dimension: 2 in the plane, 3 in space.
        seed: of the training.
        device: of torch.
        output: folder of the agent; by default that of the one that comes with RANS.
    """
    settings = replace(RECIPES[dimension], seed=seed, device=device)
    write_agent(output or FOLDER / FOR_ANY_CRAFT[dimension], settings)


def train_values(
    dimension: Literal[2, 3] = 2,
    seed: int = 0,
    device: str = "cpu",
    output: Path | None = None,
    agent: Path | None = None,
    continued: bool = False,
) -> None:
    """Train the weights of every value of an agent, whose own weights stay.

    Args:
        dimension: 2 in the plane, 3 in space, of the agent that comes with RANS.
        seed: of the training.
        device: of torch.
        output: folder that is written; by default that of the agent that comes with RANS.
        agent: run folder of the agent; by default the one that comes with RANS.
        continued: whether the training begins with the weights that the agent has for values.
    """
    shipped = FOLDER / FOR_ANY_CRAFT[dimension]
    write_values(agent or shipped, output or shipped, seed, device, continued)
