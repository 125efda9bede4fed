"""Do exported agents command what agents here do? Each form of `rans export` against the agent itself.

``python -m campaigns.exports`` writes every shipped agent in every form, asks it 100,000 observations,
half of them seen on flights and half drawn within the ranges of its contract, prints the table and writes JSON.
Memories are those of the agent itself, so that every observation is a test of its own. The C form is compiled by
every compiler of `c_compilers` that is here, with all its warnings as errors.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor
from tyro.conf import Positional

from rans.deploy.contract import recorded
from rans.deploy.export import write_agent
from rans.episode import Setup
from rans.fast.agent_files.agent import SavedPolicy, read_policy
from rans.fast.learn.run_folder import RunFolder
from rans.policy.heads import OnOff
from rans.policy.network import Network
from rans.pretrained import pretrained_folder, pretrained_names
from rans.processes import Workers, nothing
from validation.speed.exported import Answer, answers

DUTY_TOLERANCE = 1e-4
MEMORY_TOLERANCE = 1e-4
"""A hundred times what float32 loses in other orders of sums, for numbers of the order of one."""
TIE = 1e-4
"""Log-odds in float64 below which rounding in float32 may choose either way."""
_DRAWN_SEED = 11


class Unequal(NamedTuple):
    """How an export's answers to N observations differ from the agent's."""

    commands: int
    """Observations with another command."""
    beyond: int
    """Those of them that no rounding explains: no choice was closer than `TIE`."""
    memory: float
    """Largest difference of what is remembered."""


@dataclass(frozen=True)
class Row:
    """One form of one agent."""

    agent: str
    form: str
    observations: int
    unequal: int
    beyond_rounding: int
    memory: float

    @property
    def passed(self) -> bool:
        """Whether it commands what the agent does."""
        return self.beyond_rounding == 0 and self.memory <= MEMORY_TOLERANCE


def asked(network: Network, setup: Setup, count: int) -> Iterator[np.ndarray]:
    """Batches of observations: those of flights, then as many drawn within their ranges.

    A batch is one step of all episodes, so that memories go on from one to the next.
    """
    steps = min(setup.timing.episode_steps, 125)
    flights, _ = recorded(network, setup, count=max(1, count // (2 * steps)))
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
        memory = network.next_state(columns, memory, command, output.core)
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


def rows(name: str, count: int) -> Iterator[Row]:
    """A shipped agent in every form."""
    run = RunFolder(pretrained_folder(name))
    config = run.config()
    craft = run.spacecraft()
    saved: SavedPolicy = read_policy(run.agent_file)
    batches = list(asked(saved.network, Setup(craft, config.settings, config.timing), count))
    own = own_answers(saved.network, batches)
    for called, (form, answer) in answers().items():
        with tempfile.TemporaryDirectory() as folder:
            write_agent(Path(folder), form, saved, config.ppo, name)
            differs = unequal(own, answer(Path(folder)))
        yield Row(name, called, sum(map(len, batches)), *differs)


def _tables(_: None, name: str, count: int) -> list[dict[str, Any]]:
    return [asdict(row) for row in rows(name, count)]


@dataclass(frozen=True)
class Exports:
    """Compare exported agents with the agents themselves; it fails where one commands otherwise."""

    only: Positional[tuple[str, ...]] = ()
    """Names of shipped agents; none: all of them. Rows of the others stay as they are in the evidence."""
    count: int = 100_000
    """Observations for each."""
    workers: int | None = None
    """Number of processes; by default one per processor."""

    def measured(self) -> Iterator[dict[str, Any]]:
        """A row of each agent and form."""
        torch.set_num_threads(1)
        jobs = [(name, self.count) for name in self.only or pretrained_names()]
        workers = Workers(nothing, count=self.workers, work="asked agents")
        for measured in workers.ordered(_tables, jobs):
            yield from measured

    def failed(self, evidence: Any) -> bool:
        """Whether an export commands something else than its agent does."""
        return not all(Row(**row).passed for row in evidence["rows"])
