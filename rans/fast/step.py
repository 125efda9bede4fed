"""One step of an engine: the episode's, with the next episode begun where one ended."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from rans.episode import Command, Episode, Outcome, World, restart, step
from rans.fast.memory import write
from rans.model.fields import Field
from rans.model.random import Draws


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


class Seen(NamedTuple):
    """One step of fields, in whatever library."""

    after: Episode
    """The episode to act in next."""
    outcome: Outcome
    """Of the one that acted."""
    observation: tuple[Field, ...]
    """Of the episode to act in next."""
    final_observation: tuple[Field, ...]
    """Of the state arrived in."""


def step_and_restart(world: World, episode: Episode, command: Command, draws: Draws) -> Seen:
    """`rans.episode.step` and, where an episode ended, `rans.episode.restart`."""
    remembers = episode.case is not None
    outcome = step(world, world.recalled(episode, draws), command, draws)
    after = restart(world, outcome, draws)
    seen, final = world.observe(after, draws), world.observe(outcome.episode, draws)
    return Seen(after if remembers else replace(after, case=None), outcome, seen, final)


def step_tensors(world: World, episode: Episode, action: Tensor, draws: Draws) -> Step:
    """One step on tensors, writing the episode's buffers in place; this is what is compiled."""
    command = tuple(action[:, i].to(draws.dtype) for i in range(action.shape[1]))
    seen = step_and_restart(world, episode, command, draws)
    for buffer, value in zip(episode.memory(), seen.after.memory(), strict=True):
        buffer.copy_(value)
    return _results(seen, torch.stack, lambda x: x)


def step_arrays(world: World, episode: Episode, action: Tensor, draws: Draws) -> Step:
    """The same on NumPy's arrays."""
    command = tuple(np.ascontiguousarray(action.numpy().T).astype(draws.dtype))
    seen = step_and_restart(world, episode, command, draws)
    write(episode.memory(), seen.after.memory())
    return _results(seen, lambda fields: torch.from_numpy(np.stack(fields)), torch.from_numpy)


def _results(seen: Seen, stack: Any, wrap: Any) -> Step:
    """A step as tensors: ``stack`` makes one of several fields, ``wrap`` of one."""
    outcome = seen.outcome
    return Step(observation=stack(seen.observation).T, reward=wrap(outcome.reward),
                terminated=wrap(outcome.terminated), truncated=wrap(outcome.truncated),
                final_observation=stack(seen.final_observation).T, reached=wrap(outcome.reached),
                terms=stack(tuple(outcome.terms.values())))
