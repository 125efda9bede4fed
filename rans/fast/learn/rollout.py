"""Experience on the device: a rollout, in memory that never moves (a CUDA graph writes into it)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor

from rans.fast.engine import Engine
from rans.fast.stepping.step import Step
from rans.policy.network import Network


class Slot(NamedTuple):
    """Memory of one step of N environments, each field (N, ...), or with an axis more of T steps."""

    observation: Tensor
    action: Tensor
    log_prob: Tensor
    value: Tensor
    memory: Tensor | None
    """What the network remembered before the step, (N, m)."""
    privileged: Tensor | None
    """What only the critic was told, (N, p)."""
    reward: Tensor
    ended: Tensor
    truncated: Tensor


class Acted(NamedTuple):
    """What a network did in one step, each field (N, ...)."""

    action: Tensor
    log_prob: Tensor
    value: Tensor
    command: Tensor
    """What the engine is given."""
    memory: Tensor | None
    """What the network remembers after the step, (N, m)."""


class Batch(NamedTuple):
    """Transitions to learn from; K members' parts of environments beside each other."""

    columns: Tensor
    """Preprocessed observations, see `Network.look`."""
    action: Tensor
    """Of the thrusters in the order of that view."""
    log_prob: Tensor
    advantage: Tensor
    target: Tensor
    """What the value should have been: the advantage plus the value at collection."""
    memory: Tensor | None
    privileged: Tensor | None
    going_on: Tensor | None
    """Zero where an episode began with this step; only for recurrent networks."""


class Rollout:
    """T steps of an engine's N environments, flown by a network's K members."""

    def __init__(self, engine: Engine, network: Network, n_steps: int) -> None:
        count = engine.num_envs
        width = engine.observation_width
        thrusters = len(engine.craft.commands)
        architecture = network.architecture
        members = network.members
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
        """Every step's, (T, N, ...)."""
        self.steps = [
            Slot._make(None if x is None else x[t] for x in self.all) for t in range(n_steps)
        ]
        self.memory = network.initial_state(count)
        """What the network remembers now, (N, m)."""
        self.cut = new(count, width)
        self.cut_memory = network.initial_state(count)
        """Last observation of an episode that time cut off, and what the network remembered then. An episode
        is no shorter than a rollout, so there is one a rollout at most."""
        self._processes = engine.processes
        self._members = members
        self.terms = new(members, len(engine.term_names))
        """Mean over a member's environments of each reward term, summed over the steps."""
        self.succeeded = new(members)
        """Number of a member's episodes that ended as a success."""
        self.failed = new(members)
        """Number of a member's episodes that the task ended as a failure."""

    def begin(self) -> None:
        """Forget how the last steps went."""
        self.terms.zero_()
        self.succeeded.zero_()
        self.failed.zero_()

    def uniform(self, generators: Sequence[torch.Generator]) -> Tensor:
        """Random numbers (T, N, thrusters) in [0, 1), on a CPU from one generator a member."""
        action = self.all.action
        if action.is_cuda:
            return self._processes.uniform_like(action)
        parts = zip(action.chunk(self._members, dim=1), generators, strict=True)
        drawn = [self._processes.uniform_like(part, generator) for part, generator in parts]
        return torch.cat(drawn, dim=1) if len(drawn) > 1 else drawn[0]

    def spread(self, values: Tensor) -> Tensor:
        """Numbers (K,) of the members for each of their environments: (N,), or (1,) of one member."""
        if self._members == 1:
            return values
        return values.repeat_interleave(self.all.reward.shape[1] // self._members)

    def beside(self, first: Tensor, second: Tensor) -> Tensor:
        """Each member's rows of both, (2 N, ...), so that one evaluation serves both."""
        pair = [x.unflatten(0, (self._members, -1)) for x in (first, second)]
        return torch.cat(pair, dim=1).flatten(0, 1)

    def totals(self) -> Tensor:
        """Counts of episodes and mean rewards of the steps, (K, 3 + terms), of this process.

        Episodes that failed, all that ended, and those that ended as a success; mean reward of a step by
        term.
        """
        ended = self.all.ended.unflatten(1, (self._members, -1)).sum(dim=(0, 2))
        counts = torch.stack([self.failed, ended, self.succeeded], dim=1)
        return torch.cat((counts, self.terms / len(self.steps)), dim=1)


def remember(
    observation: Tensor,
    acted: Acted,
    privileged: Tensor | None,
    step: Step,
    slot: Slot,
    rollout: Rollout,
) -> None:
    """Write into its slot of the rollout what was seen in one step, done, told the critic, and what followed.

    The rollout's `memory`, `cut`, and sums are changed in place.
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
    for place, value in zip(slot, values, strict=True):
        if place is not None and value is not None:
            place.copy_(value)
    last = step.truncated[:, None]
    cut.copy_(torch.where(last, step.final_observation, cut))
    if memory is not None and cut_memory is not None and acted.memory is not None:
        cut_memory.copy_(torch.where(last, acted.memory, cut_memory))
        memory.copy_(torch.where(ended[:, None], 0.0, acted.memory))
    members = (len(rollout.succeeded), -1)
    rollout.terms.add_(step.terms.unflatten(1, members).mean(dim=2).T)
    rollout.succeeded.add_(step.success.unflatten(0, members).sum(dim=1))
    lost = step.terminated & ~step.reached
    rollout.failed.add_(lost.unflatten(0, members).sum(dim=1))


def gae(
    reward: Tensor,
    value: Tensor,
    ended: Tensor,
    last_value: Tensor,
    gamma: Tensor | float,
    gae_lambda: Tensor | float,
) -> Tensor:
    """Generalised advantage estimates (T, N) (Schulman et al., 2016).

    Rewards and values of the states acted in are (T, N), as is ``ended``, 1 where the episode ended with this
    step; ``last_value`` is (N,), of the states after the last one. Discount and trade-off of bias against
    variance are numbers or (N,).
    """
    going_on = 1.0 - ended
    following = torch.cat((value[1:], last_value[None]))
    delta = reward + gamma * going_on * following - value
    decay = (gamma * gae_lambda) * going_on
    result = torch.empty_like(delta)
    running = torch.zeros_like(last_value)
    for t in reversed(range(len(delta))):
        running = delta[t] + decay[t] * running
        result[t] = running
    return result


def minibatches(batch: Batch, members: int, count: int) -> list[Batch]:
    """Cut (T, N, ...) into ``count`` minibatches of whole environments, the same for a member as alone.

    Environments are independent, so nothing is gained by shuffling them. Fields become (K T n, ...), n
    environments of each member; `Batch.going_on`, (T, K n).
    """

    def chunks(field: Tensor) -> Sequence[Tensor]:
        return field.unflatten(1, (members, -1)).chunk(count, dim=2)

    none: list[Tensor | None] = [None] * count
    flat = [
        none if x is None else [part.transpose(0, 1).flatten(0, 2) for part in chunks(x)]
        for x in batch._replace(going_on=None)
    ]
    if batch.going_on is not None:
        flat[-1] = [part.flatten(1) for part in chunks(batch.going_on)]
    return [Batch._make(fields) for fields in zip(*flat, strict=True)]
