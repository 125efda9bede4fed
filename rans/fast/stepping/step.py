"""One step of an engine, which begins the next episode where one ended, and the buffers that it changes.

All ways to step (NumPy, torch, kernels) call `stepped`; results of one are those of the others to rounding.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from rans.base.errors import ConfigError, brief, whole
from rans.episode.step import Episode, StepAndRestart, World, step_and_restart
from rans.fast.distributed import Processes
from rans.model.body import Body
from rans.model.dynamics import NODES
from rans.model.fields import map_leaves
from rans.model.random import Draws
from rans.tasks.base import goal_after
from rans.tasks.rewards import paid

MOST_ENVS = 2**24
"""Largest number of environments of an engine: with about 1 kB each they fill 16 GB."""
FLOAT32_NODES = 4
"""Quadrature nodes at which float32 rounding hides the rule's error, up to 15 rad/s."""
_NUMPY_DTYPES = {torch.float32: np.float32, torch.float64: np.float64}


class Step(NamedTuple):
    """Results of one step of N environments, as tensors on the engine's device."""

    observation: Tensor
    """(N, width): observation after the step; the first one of the new episode where one ended."""
    reward: Tensor
    """(N,): reward; of a lost state (`rans.episode.step.Outcome.lost`) that of the one before, or 0."""
    terminated: Tensor
    """(N,) bool: the task ended the episode by failure or success."""
    truncated: Tensor
    """(N,) bool: time is up, and the task did not end the episode."""
    final_observation: Tensor
    """(N, width): observation of the last state of episodes that ended; where the state was lost
    (`rans.episode.step.Outcome.lost`), of the one before, which is finite. Other rows are undefined."""
    reached: Tensor
    """(N,) bool: within the task's tolerances at the end of the period without a failure, or the mission is won."""
    terms: Tensor
    """(terms, N): reward by term, in the order of `Engine.term_names`."""

    @property
    def at_goal(self) -> Tensor:
        """(N,) bool: the episode ended at its goal: won, or within the tolerances at truncation.

        The latter alone solves no task (`rans.episode.verdict`).
        """
        return self.reached & (self.terminated | self.truncated)


def stepped(
    world: World, episode: Episode, action: Tensor, draws: Draws, plain: bool = False
) -> tuple[Step, Episode]:
    """Results of one step on tensors, and the episodes after it; nothing is changed in place."""
    command = tuple(action[:, i].to(draws.dtype) for i in range(action.shape[1]))
    result = step_and_restart(world, episode, command, draws, plain)
    return _results(result, torch.stack, lambda x: x), result.after


def step_tensors(
    world: World, episode: Episode, action: Tensor, draws: Draws, plain: bool = False
) -> Step:
    """Step actions (N, n), changing the episode's buffers in place; torch compiles it, or it runs eagerly."""
    # Results are computed first, because final observations may be views of the buffers.
    results, after = stepped(world, episode, action, draws, plain)
    values = after.memory()
    if plain:  # Commands move up by one, so that some values are other buffers.
        values = [value.clone() for value in values]
    for buffer, value in zip(episode.memory(), values, strict=True):
        buffer.copy_(value)
    return results


def step_arrays(world: World, episode: Episode, action: Tensor, draws: Draws) -> Step:
    """One step on NumPy's arrays, which changes the episode's buffers in place."""
    command = tuple(np.ascontiguousarray(action.numpy().T).astype(draws.dtype))
    result = step_and_restart(world, episode, command, draws)
    results = _results(result, lambda fields: torch.from_numpy(np.stack(fields)), torch.from_numpy)
    copy_into(episode.memory(), result.after.memory())
    return results


def _results(result: StepAndRestart, stack: Any, wrap: Any) -> Step:
    """Results as tensors: ``stack`` makes a tensor of several fields, ``wrap`` of one."""
    outcome = result.outcome
    terms, reward = paid(outcome.terms, outcome.terminated)
    return Step(
        observation=stack(result.observation).T,
        reward=wrap(reward),
        terminated=wrap(outcome.terminated),
        truncated=wrap(outcome.truncated),
        final_observation=stack(result.final_observation).T,
        reached=wrap(outcome.reached),
        terms=stack(tuple(terms.values())),
    )


def field_dtype(
    device: torch.device,
    dtype: torch.dtype = torch.float32,
    compiled: bool | None = None,
    plain: bool = False,
) -> Any:
    """Dtype of an engine's fields: NumPy's for an uncompiled step on a CPU that is not plain, else torch's."""
    on_torch = compiled or plain or device.type == "cuda"
    return dtype if on_torch else _NUMPY_DTYPES[dtype]


@dataclass(frozen=True)
class Backend:
    """The library that fields are of: NumPy, or torch with its tensors on a device."""

    device: torch.device
    fields: Any
    """Floating dtype of the fields; see `field_dtype`."""

    @classmethod
    def of(
        cls,
        device: str | torch.device,
        dtype: torch.dtype,
        compiled: bool | None,
        plain: bool = False,
    ) -> Backend:
        """Library of fields for a device and a dtype; see `field_dtype`.

        Raises:
            ConfigError: there is no such device, or the dtype is neither float32 nor float64.
        """
        if dtype not in _NUMPY_DTYPES:
            raise ConfigError(f"dtype must be torch.float32 or torch.float64, got {brief(dtype)}.")
        require_device(device)
        device = torch.device(device)
        return cls(device, field_dtype(device, dtype, compiled, plain))

    @property
    def on_numpy(self) -> bool:
        """Whether fields are NumPy arrays."""
        return not isinstance(self.fields, torch.dtype)

    @property
    def nodes(self) -> int:
        """Number of nodes of the quadrature in the plane."""
        return FLOAT32_NODES if self.fields in (np.float32, torch.float32) else NODES

    def put(self, values: Any, dtype: torch.dtype) -> Any:
        """Copy of numbers, an array or a tensor, as a field."""
        copy = torch.as_tensor(values).to(self.device, dtype, copy=True)
        return copy.numpy() if self.on_numpy else copy

    def stack(self, rows: Sequence[Any]) -> Tensor:
        """Fields (N,) as one tensor (rows, N)."""
        return torch.from_numpy(np.stack(rows)) if self.on_numpy else torch.stack(tuple(rows))

    def episodes(
        self, world: World, body: Body | None, count: int, draws: Draws, remember: bool
    ) -> Episode:
        """Episodes of N spacecraft in buffers, which a reset fills; the body is in them already.

        Values that vary have buffers; they are known from the draws of the first episodes. The episodes remember
        the draws of their conditions, or draw them in every step.
        """
        zeros = torch.zeros(count, dtype=torch.float64)
        command_dtype = getattr(torch, world.craft.command_dtype)
        real = torch.float64 if self.fields in (np.float64, torch.float64) else torch.float32
        clock = self.put(zeros, torch.int32)

        def buffer(x: Any, later: Any = None) -> Any:
            return x if isinstance(x, int | float) and later is x else self.put(zeros, real)

        # First episodes, which show what varies among spacecraft or changes in a step.
        start, goal = world.scenario(clock, draws)
        new = world.begin(start, goal, clock, draws, body)
        anywhere = map_leaves(lambda x: x + self.put(zeros, real), start)
        next_goal = goal_after(world.task, goal, anywhere, world.timing.control_period)
        # A buffer for each of these values.
        parameters = None
        if remember and new.parameters is not None:
            parameters = replace(
                map_leaves(buffer, new.parameters, new.parameters),
                number=self.put(zeros, torch.int32),
            )
        return replace(
            new,
            state=map_leaves(buffer, new.state),
            goal=map_leaves(buffer, goal, next_goal),
            parameters=parameters,
            past=map_leaves(buffer, new.past),
            reading=map_leaves(buffer, new.reading),
            commands=map_leaves(lambda _: self.put(zeros, command_dtype), new.commands),
            violated=None if new.violated is None else self.put(zeros, real),
        )


def environment_count(num_envs: object) -> int:
    """Number of environments, checked.

    Raises:
        ConfigError: it is no whole number >= 1, or too large.
    """
    count = whole("the number of environments", num_envs)
    if count > MOST_ENVS:
        raise ConfigError(
            f"the number of environments must be at most {MOST_ENVS:,}, got {count:,}, which would need about "
            f"{count * 1e-6:,.0f} GB of memory."
        )
    return count


def require_device(device: str | torch.device) -> None:
    """Refuse (`ConfigError`) a device that is neither cpu nor cuda, or that torch does not see."""
    try:
        kind = torch.device(device).type
    except RuntimeError:
        kind = ""
    if kind not in ("cpu", "cuda"):
        raise ConfigError(f"device must be cpu or cuda, got {brief(device)}.")
    if kind == "cuda" and not torch.cuda.is_available():
        raise ConfigError("device is cuda, but torch sees no CUDA device here; use the device cpu.")


def copy_into(buffers: Sequence[Any], values: Sequence[Any]) -> None:
    """Write values into buffers in place; a value that never varies is a number in both."""
    for buffer, value in zip(buffers, values, strict=True):
        if isinstance(buffer, Tensor):
            buffer.copy_(value) if isinstance(value, Tensor) else buffer.fill_(value)
        elif not isinstance(buffer, float):
            buffer[...] = value


@contextmanager
def restoring(memory: Sequence[Any], held: Tensor) -> Iterator[None]:
    """Context that restores the buffers of the spacecraft where ``held``, (N,) bool, at its end."""
    before = [
        x.copy() if isinstance(x, np.ndarray) else x.clone() if isinstance(x, Tensor) else x
        for x in memory
    ]
    yield
    for buffer, old in zip(memory, before, strict=True):
        if isinstance(buffer, Tensor) and isinstance(old, Tensor):
            buffer.copy_(torch.where(held, old, buffer))
        elif isinstance(buffer, np.ndarray):
            np.copyto(buffer, old, where=held.numpy())


def snapshot(
    world: World, episode: Episode, seed: Sequence[Any], processes: Processes
) -> dict[str, Any]:
    """Result of `Engine.save_state`, of all processes' rows: checkpoints hold it, `restore` reads it."""
    buffers = [processes.whole(torch.as_tensor(buffer)).clone() for buffer in episode.memory()]
    return {
        "buffers": buffers,
        "seed": [torch.as_tensor(word).tolist() for word in seed],
        "episode_steps": world.timing.episode_steps,
    }


def restore(
    table: dict[str, Any], world: World, episode: Episode, seed: Sequence[Any], processes: Processes
) -> None:
    """Write the result of `save_state` into an engine's buffers, in place; ConfigError if shapes differ."""
    # Refuse a state of other environments or episodes.
    buffers = episode.memory()
    values = [processes.mine(value) for value in table["buffers"]]
    if [tuple(b.shape) for b in buffers] != [tuple(v.shape) for v in values]:
        raise ConfigError(
            f"the saved state is not one of {len(episode.clock)} environments of {world.craft.name!r}; "
            "the usual cause is a changed number of environments, or an older RANS that saved it."
        )
    if table["episode_steps"] != world.timing.episode_steps:
        raise ConfigError(
            f"the saved state is one of episodes of {table['episode_steps']:,} steps, not "
            f"{world.timing.episode_steps:,}: its clocks would be misread."
        )
    # Write the buffers and the seed's words.
    copy_into(
        buffers,
        [
            value.cpu() if isinstance(b, np.ndarray) else value.to(b.device)
            for b, value in zip(buffers, values, strict=True)
        ],
    )
    copy_into(
        seed,
        [
            torch.as_tensor(word).numpy()
            if isinstance(saved, np.ndarray)
            else torch.as_tensor(word)
            for saved, word in zip(seed, table["seed"], strict=True)
        ],
    )
