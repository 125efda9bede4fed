"""What one step of an engine gives, and how torch makes it."""

from __future__ import annotations

from typing import Any, NamedTuple

import torch
from torch import Tensor

from rans.fast.episode import Episodes, Outcome, Simulation


class Step(NamedTuple):
    """What one step gave to N environments; tensors on the engine's device."""

    observation: Tensor
    """(N, width): first of the new episode where the old one ended."""
    reward: Tensor
    """(N,)."""
    terminated: Tensor
    """(N,) bool: the task failed."""
    truncated: Tensor
    """(N,) bool: time is up without failure."""
    final_observation: Tensor
    """(N, width) of the state arrived in, where an episode ended; what the other rows hold is undefined."""
    reached: Tensor
    """(N,) bool: within the task's tolerances on arrival."""
    terms: Tensor
    """(terms, N): reward by term, in the order of `Engine.term_names`."""


def step_tensors(simulation: Simulation, episodes: Episodes, action: Tensor,
                 seed: tuple[Tensor, Tensor], numbers: tuple[Tensor, int]) -> Step:
    """One step on tensors, writing the episodes' buffers in place; this is what is compiled."""
    command = tuple(action[:, i].to(simulation.dtype) for i in range(action.shape[1]))
    after, outcome = simulation.step(episodes, command, seed, numbers)
    for buffer, value in zip(episodes.memory(), after.memory(), strict=True):
        buffer.copy_(value)
    return results(outcome, torch.stack, lambda x: x)


def results(outcome: Outcome, stack: Any, wrap: Any) -> Step:
    """An outcome as tensors: ``stack`` makes one of several fields, ``wrap`` of one."""
    return Step(
        observation=stack(outcome.observation).T,
        reward=wrap(outcome.reward),
        terminated=wrap(outcome.terminated),
        truncated=wrap(outcome.truncated),
        final_observation=stack(outcome.final_observation).T,
        reached=wrap(outcome.reached),
        terms=stack(tuple(outcome.terms.values())),
    )
