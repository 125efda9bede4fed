"""Shipped agents, their exports in every form, and the names of an exported file."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from rans.base.pretrained import pretrained_folder
from rans.deploy.contract import recorded
from rans.deploy.export import write_agent
from rans.episode.step import Setup
from rans.evaluation.fly.agent import Agent
from rans.fast.agent_files.agent import SavedPolicy, read_policy
from rans.fast.learn.run_folder import RunFolder
from rans.policy.heads import OnOff
from rans.policy.network import Network
from validation.speed.exported import Answer

FAST = ["export", "pretrained:go-to-pose-2d", "--format"]


@cache
def shipped(name: str) -> tuple[Network, Setup]:
    """A shipped agent and what it was trained on, in a perfect world."""
    run = RunFolder(pretrained_folder(name))
    config = run.config()
    craft = run.spacecraft()
    return (
        read_policy(run.agent_file).network,
        Setup(craft, config.settings, config.timing),
    )


@cache
def remembering() -> tuple[Network, Setup, np.ndarray]:
    """An agent with a history, averages and symmetries, and what it observes on four flights."""
    network, setup = shipped("go-to-pose-2d-faults")
    flights, _ = recorded(Agent(network, "agent", setup.craft), setup, count=4)
    return network, setup, flights.observations


def written(folder: Path, network: Network, *forms: str, title: str = "agent") -> Path:
    """The folder with the network in these forms."""
    for form in forms:
        write_agent(folder, form, SavedPolicy(network, 0), title)
    return folder


def exported(folder: Path) -> dict[str, Any]:
    """The names of an exported file."""
    names: dict[str, Any] = {"__file__": str(folder / "agent.py"), "__name__": "agent"}
    exec(compile((folder / "agent.py").read_text("utf-8"), "agent.py", "exec"), names)
    return names


DUTY_TOLERANCE = 1e-4
"""A hundred times what float32 loses in other orders of sums, for numbers of the order of one."""
TIE = 1e-4
"""Log-odds in float64 below which rounding in float32 may choose either way."""
_DRAWN_SEED = 11


class Unequal(NamedTuple):
    """How an export's answers to N observations differ from the agent's."""

    commands: int
    """Observations with another command."""
    beyond: int
    """Observations with another command that no rounding explains: no choice was closer than `TIE`."""
    memory: float
    """Largest difference of what is remembered."""


def asked(network: Network, setup: Setup, count: int) -> Iterator[np.ndarray]:
    """Batches of observations: those of flights, then as many drawn within their ranges.

    A batch is one step of all episodes, so that memories go on from one to the next.
    """
    steps = min(setup.timing.episode_steps, 125)
    flights, _ = recorded(
        Agent(network, "agent", setup.craft), setup, count=max(1, count // (2 * steps))
    )
    seen = flights.observations
    yield from seen
    random = np.random.default_rng(_DRAWN_SEED)
    for _ in seen:
        yield random.uniform(seen.min(axis=(0, 1)), seen.max(axis=(0, 1)), seen.shape[1:]).astype(
            np.float32
        )


class Own(NamedTuple):
    """What an agent itself answers to batches of observations."""

    network: Network
    batches: list[np.ndarray]
    commands: list[np.ndarray]
    memories: list[np.ndarray]
    """Before every batch, and after the last; without a column where the agent has no memory."""


@torch.no_grad()
def own_answers(network: Network, batches: list[np.ndarray]) -> Own:
    """The agent's answers, batch after batch."""
    memory = network.initial_state(len(batches[0]))
    commands = []
    memories = [_columns(memory, batches[0])]
    for batch in batches:
        output, columns = network.forward(torch.from_numpy(batch), memory)
        command = output.policy.mode()
        memory = network.next_state(columns, memory, command)
        commands.append(command.numpy())
        memories.append(_columns(memory, batch))
    return Own(network, batches, commands, memories)


def _columns(memory: Tensor | None, batch: np.ndarray) -> np.ndarray:
    return np.zeros((len(batch), 0), np.float32) if memory is None else memory.numpy()


@torch.no_grad()
def unequal(own: Own, answer: Answer) -> Unequal:
    """An export's answers beside the agent's, batch after batch."""
    network = own.network
    exact = Network(network.architecture, {name: x.double() for name, x in network.tensors.items()})
    commands = 0
    beyond = 0
    furthest = 0.0
    slack = DUTY_TOLERANCE if network.architecture.continuous else 0.0
    for k, batch in enumerate(own.batches):
        memory = own.memories[k]
        told, after = answer(batch, memory)
        different = (np.abs(told - own.commands[k]) > slack).any(axis=1)
        if different.any():
            before = torch.from_numpy(memory).double() if memory.size else None
            closest = exact.forward(torch.from_numpy(batch), before)[0].policy
            near = (
                closest.logit.abs().amin(dim=1).numpy() < TIE
                if isinstance(closest, OnOff)
                else False
            )
            commands = commands + int(different.sum())
            beyond = beyond + int((different & ~near).sum())
        if memory.size:
            apart = np.abs(after - own.memories[k + 1])
            furthest = max(furthest, float(apart[~different].max(initial=0.0)))
    return Unequal(commands, beyond, furthest)
