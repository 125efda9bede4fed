"""A learner of one member as ``policy.zip``, from which Stable-Baselines3 and we go on."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch

from rans.fast.agent_files.agent import SavedPolicy
from rans.fast.learn.adam import Adam
from rans.fast.learn.config import PPOSettings
from rans.fast.learn.learner import Learner
from rans.fast.policy import write_policy


def write_learner(file: Path, learner: Learner, settings: PPOSettings, steps: int) -> None:
    """Write its agent and Adam's memory after so many environment steps, see `write_policy`."""
    network = learner.network
    adam = learner.adam
    write_policy(
        file,
        network.architecture,
        network.member(0),
        settings,
        steps,
        moments(adam, 0),
        float(adam.rate),
    )


@torch.no_grad()
def adopt(learner: Learner, saved: SavedPolicy) -> None:
    """Go on from a file; RuntimeError or KeyError where it is of another network."""
    for name, tensor in learner.network.tensors.items():
        tensor.copy_(saved.network.tensors[name])
    remember(learner.adam, saved.adam, saved.rate)


def moments(adam: Adam, number: int) -> dict[Any, Any]:
    """One member's memory as the state of torch's Adam."""
    lone = len(adam.rate) == 1
    steps = adam.steps.detach().cpu().float()
    first, second = (
        [(x if lone else x[number]).detach().cpu().clone() for x in tensors]
        for tensors in adam.moments
    )
    return {
        place: {"step": steps.clone(), "exp_avg": a, "exp_avg_sq": b}
        for place, (a, b) in enumerate(zip(first, second, strict=True))
    }


def remember(adam: Adam, saved: dict[Any, Any], rate: float) -> None:
    """Go on, with one member, from what `moments` gave; without anything, with empty memory."""
    adam.rate.fill_(rate)
    for place, kept in saved.items():
        for memory, name in zip(adam.moments, ("exp_avg", "exp_avg_sq"), strict=True):
            memory[place].copy_(kept[name])
        adam.steps.copy_(kept["step"])
