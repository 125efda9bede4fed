"""Training of the agents for any craft: ``python -m rans_any_craft train --device cuda --output runs/any``.

The agent has the weights of one training alone. Those of the values that come with RANS were found from them by
evolution strategies, whose program left.
"""

from __future__ import annotations

import time
from dataclasses import asdict, replace
from pathlib import Path
from typing import Literal

import torch
from torch import Tensor

from rans.extend import (
    EVALUATION_SEED,
    GoToPose,
    Timing,
    TrainConfig,
    environment,
    evaluated,
    fitting_protocols,
    load_spacecraft,
    to_table,
    to_toml,
    write_json,
    write_text,
)
from rans.fast.agent_files.agent import AGENT, actor_bytes
from rans_any_craft.training import (
    DemandNetwork,
    DemandSettings,
    Stage,
    as_policy,
    train,
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


def write_agent(folder: Path, settings: DemandSettings) -> None:
    """Train an agent and write it as a run folder without a critic."""
    begun = time.perf_counter()
    network = train(settings, lambda text, _: print(text, flush=True))  # noqa: T201
    save(folder, network.state_dict(), settings, time.perf_counter() - begun)


def save(
    folder: Path,
    weights: dict[str, Tensor],
    settings: DemandSettings,
    seconds: float,
) -> None:
    """Write trained weights as the agent of one craft, which flies others by `for_spacecraft`.

    The card is written twice, as the evaluation loads the folder; its keys are those of every card.
    """
    network = DemandNetwork(settings.channels, torch.Generator(), settings.dimension)
    name, timing = _OWN[settings.dimension]
    craft = load_spacecraft(name)
    task = GoToPose()
    network.load_state_dict(weights, strict=False)
    policy = as_policy(network, craft, task, timing.control_period)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / AGENT).write_bytes(actor_bytes(policy.architecture, policy.weights(), 0))
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
    output: Path, dimension: Literal[2, 3] = 2, seed: int = 0, device: str = "cpu"
) -> None:
    """Train an agent for any craft; minutes on a GPU.

    Args:
        output: folder of the agent.
        dimension: 2 in the plane, 3 in space.
        seed: of the training.
        device: of torch.
    """
    settings = replace(RECIPES[dimension], seed=seed, device=device)
    write_agent(output, settings)
