"""Rollout buffer on the device, at fixed addresses because a CUDA graph writes into it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor

from rans.fast.engine import Engine
from rans.fast.learn.batch import Batch
from rans.fast.stepping.step import Step
from rans.policy.network import Network


class Slot(NamedTuple):
    """Transitions of one step of N environments, each field (N, ...), or of T steps, (T, N, ...)."""

    observation: Tensor
    action: Tensor
    log_prob: Tensor
    value: Tensor
    memory: Tensor | None
    """Memory of the network before the step, (N, m)."""
    privileged: Tensor | None
    """Privileged observation of the critic, (N, p)."""
    reward: Tensor
    ended: Tensor
    truncated: Tensor


class Acted(NamedTuple):
    """Outputs of a network in one step, each field (N, ...)."""

    action: Tensor
    log_prob: Tensor
    value: Tensor
    command: Tensor
    """Commands to the engine, (N, thrusters)."""
    memory: Tensor | None
    """Memory of the network after the step, (N, m)."""


class Rollout:
    """T steps of the N environments of an engine, controlled by a network."""

    def __init__(self, engine: Engine, network: Network, n_steps: int) -> None:
        count = engine.num_envs
        width = engine.observation_width
        thrusters = engine.craft.command_count
        architecture = network.architecture
        new = lambda *shape: torch.zeros(shape, dtype=engine.dtype, device=engine.device)  # noqa: E731
        every = lambda *shape: new(n_steps, count, *shape)  # noqa: E731
        self.all = Slot(
            every(width),
            every(thrusters),
            every(),
            every(),
            every(architecture.memory) if architecture.memory else None,
            every(architecture.privileged) if architecture.privileged else None,
            every(),
            every(),
            every(),
        )
        """All steps, (T, N, ...)."""
        self.steps = [
            Slot._make(None if x is None else x[t] for x in self.all) for t in range(n_steps)
        ]
        self.memory = network.initial_state(count)
        """Current memory of the network, (N, m)."""
        self.cut = new(count, width)
        self.cut_memory = network.initial_state(count)
        """Last observation of a truncated episode, and the memory of the network then. Episodes are at least
        as long as a rollout, so there is at most one per rollout."""
        self._processes = engine.processes
        self.terms = new(len(engine.term_names), count)
        """Reward terms (terms, N), summed over the steps."""
        self.succeeded, self.failed = new(count), new(count)
        """Number of episodes of each environment that ended at the goal, and that the task ended as a failure."""
        self._engine = engine
        self._elapsed = new()

    def begin(self) -> None:
        """Reset the sums over the steps."""
        self.terms.zero_()
        self.succeeded.zero_()
        self.failed.zero_()
        self._elapsed.copy_(self._engine.elapsed().sum())

    def uniform(self, generator: torch.Generator) -> Tensor:
        """Random numbers (T, N, thrusters) in [0, 1), on a CPU from the generator."""
        action = self.all.action
        return self._processes.uniform_like(action, None if action.is_cuda else generator)

    def totals(self) -> Tensor:
        """Episode counts and mean rewards in this process, (4 + terms,).

        Columns: episodes that failed, that ended, and that succeeded; steps of those that ended, from their
        starts; then the mean reward per step of each term.
        """
        # Every step adds 1 to the time of a running episode, and an end takes its length away.
        steps = self.all.reward.numel()
        lengths = self._elapsed + steps - self._engine.elapsed().sum()
        counts = self.failed.sum(), self.all.ended.sum(), self.succeeded.sum(), lengths
        return torch.cat((torch.stack(counts), self.terms.mean(dim=1) / len(self.steps)))


def remember(
    observation: Tensor,
    acted: Acted,
    privileged: Tensor | None,
    step: Step,
    slot: Slot,
    rollout: Rollout,
) -> None:
    """Write one step into its slot of the rollout: observations, outputs of the network, rewards and ends.

    `memory`, `cut`, and the sums of the rollout are changed in place.
    """
    memory = rollout.memory
    cut = rollout.cut
    cut_memory = rollout.cut_memory
    ended = step.truncated | step.terminated
    values = Slot(
        observation,
        acted.action,
        acted.log_prob,
        acted.value,
        memory,
        privileged,
        step.reward,
        ended,
        step.truncated,
    )
    for buffer, value in zip(slot, values, strict=True):
        if buffer is not None and value is not None:
            buffer.copy_(value)
    # Last states of truncated episodes; memories begin anew in new ones.
    last = step.truncated[:, None]
    torch.where(last, step.final_observation, cut, out=cut)
    if memory is not None and cut_memory is not None and acted.memory is not None:
        cut_memory.copy_(torch.where(last, acted.memory, cut_memory))
        memory.copy_(torch.where(ended[:, None], 0.0, acted.memory))
    # Sums for the log.
    rollout.terms.add_(step.terms)
    rollout.succeeded.add_(step.at_goal)
    rollout.failed.add_(step.terminated & ~step.reached)


def gae(
    reward: Tensor,
    value: Tensor,
    ended: Tensor,
    last_value: Tensor,
    gamma: float,
    gae_lambda: float,
) -> Tensor:
    """Generalised advantage estimates (T, N) (Schulman et al., 2016).

    Rewards, values before each step and ``ended`` (1 where the episode ended with this step) are (T, N);
    ``last_value``, the values after the last step, is (N,).
    """
    going_on = 1.0 - ended
    following = torch.cat((value[1:], last_value[None]))
    delta = reward + gamma * going_on * following - value
    decay = (gamma * gae_lambda) * going_on
    result = torch.empty_like(delta)
    running = torch.zeros_like(last_value)
    for t in reversed(range(len(delta))):
        running = torch.add(delta[t], decay[t] * running, out=result[t])
    return result


def minibatches(batch: Batch, count: int) -> list[Batch]:
    """Cut (T, N, ...) into ``count`` minibatches of n whole environments, whose fields become (T n, ...).

    Environments are independent, so they need no shuffling.
    """
    none: list[Tensor | None] = [None] * count
    flat: list[Sequence[Tensor | None]] = [
        none if x is None else [part.flatten(0, 1) for part in x.chunk(count, dim=1)] for x in batch
    ]
    return [Batch._make(fields) for fields in zip(*flat, strict=True)]
