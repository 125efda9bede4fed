"""Batched episodes on one device: the state lives in tensors, one call steps every spacecraft."""

from __future__ import annotations

import operator
import warnings
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
import torch
from torch import Tensor

from rans.episode import World
from rans.errors import ConfigError
from rans.fast.distributed import ALONE, Processes
from rans.fast.kernels.cuda import CudaError
from rans.fast.kernels.launch import Kernel
from rans.fast.memory import Place, allocated, field_dtype, restore, saved, write
from rans.fast.step import Step, results, step_and_restart, step_tensors
from rans.model.body import Body, in_memory
from rans.model.conditions import Conditions
from rans.model.dynamics import NODES
from rans.model.fields import leaves
from rans.model.random import Draws, seed_words
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from rans.model.trace import UNTRACEABLE
from rans.tasks.base import Task, layout
from rans.tasks.rewards import Transition

_FLOAT32_NODES = 4
"""Quadrature nodes at which float32 rounding hides the rule's error, up to 15 rad/s."""


class Engine:
    """N copies of one spacecraft flying one task.

    Args:
        craft: the spacecraft.
        task: the task.
        num_envs: number of spacecraft stepped together.
        timing: control period, accuracy and length of an episode.
        seed: decides all starts and goals, with the episode's number. Several are those of as many members,
            who own the environments in equal, contiguous parts and count their episodes each from zero.
        device: torch device of the state.
        dtype: torch.float32, or torch.float64 for comparisons.
        compiled: whether a step is one compiled kernel. By default on a GPU only: a CPU step then
            runs the same source on NumPy, two to six times faster than uncompiled torch for 4,096 to
            128 spacecraft, and without a compiler.
        generated: whether on a GPU the step is the kernel of docs/decisions/007-generated-kernel.md, 1.4
            to 2.7 times as fast as torch.compile's, which stands in where it cannot be made.
        processes: those among which the batch is divided; ``num_envs`` are this one's.
        body: other than the craft's, each number or (N,), one for each spacecraft.
        conditions: what episodes do not promise; None: a perfect world.
        remember: whether what episodes draw from their conditions lies in memory, for `privileged`; the
            generated kernel else draws it again in every step. A step without a kernel always remembers.

    Raises:
        ConfigError: craft is no spacecraft, num_envs not a positive whole number, dtype another one, or mass
            properties are not those of rigid bodies or not so many.
    """

    def __init__(self, craft: Spacecraft, task: Task, num_envs: int, timing: Timing | None = None, *,
                 seed: int | Sequence[int] = 0, device: str | torch.device = "cpu",
                 dtype: torch.dtype = torch.float32, compiled: bool | None = None,
                 generated: bool = True, processes: Processes = ALONE, body: Body | None = None,
                 conditions: Conditions | None = None, remember: bool = False) -> None:
        if not isinstance(craft, Spacecraft):
            raise ConfigError(f"craft must be a Spacecraft, got {craft!r}; rans.load_spacecraft reads one.")
        if isinstance(num_envs, bool) or not isinstance(num_envs, int) or num_envs < 1:
            raise ConfigError(
                f"the number of environments must be a whole number >= 1, got {num_envs!r}.")
        if not isinstance(seed, int) and (not seed or num_envs % len(seed)):
            raise ConfigError(f"{num_envs} environments cannot be divided among {len(seed)} members.")
        if dtype not in (torch.float32, torch.float64):
            raise ConfigError(f"dtype must be torch.float32 or torch.float64, got {dtype!r}.")
        self.craft, self.task, self.timing = craft, task, timing or Timing()
        self.num_envs, self.dtype, self.device = num_envs, dtype, torch.device(device)
        self.compiled = self.device.type == "cuda" if compiled is None else compiled
        self.processes = processes
        self.layout = layout(task, craft.dimension)
        self.members = 1 if isinstance(seed, int) else len(seed)
        self._place = Place(self.device, field_dtype(self.device, dtype, self.compiled))
        self._world = World(craft, task, self.timing, _FLOAT32_NODES if dtype == torch.float32 else NODES,
                            conditions)
        self._body = in_memory(body or Body.of(craft), Body.of(craft), num_envs,
                               lambda values: self._place.put(values, dtype))
        each, seeds = num_envs // self.members, [seed] if isinstance(seed, int) else seed
        first = np.arange(num_envs) % each * processes.size + processes.rank
        self._draws = Draws(*self._place.words(seeds, each), self._place.put(first, torch.int32),
                            each * processes.size, self._place.fields)
        made = lambda remember: allocated(  # noqa: E731
            self._world, self._body, self._place, num_envs, self._draws, remember)
        self._episode = made(remember)
        self._kernel = self._generated() if generated else None
        if self._kernel is None:
            self._episode = made(remember=True)
        self._step = (torch.compile(step_tensors, fullgraph=True, dynamic=False) if self.compiled
                      else step_tensors)
        self.reset(seeds[0] if self.members == 1 else seeds)

    @cached_property
    def term_names(self) -> tuple[str, ...]:
        """Names of the reward terms, in the order of `Step.terms`."""
        e = self._episode
        shut = (leaves(e.state)[0] * 0.0,) * len(self.craft.thrusters)
        return tuple(self.task.reward(Transition(e.state, e.goal, shut, shut)))

    @property
    def observation_width(self) -> int:
        """Columns of an observation."""
        return self.layout.width

    @property
    def state(self) -> Any:
        """The current `State`; its fields are views that the next step overwrites."""
        return self._episode.state

    @property
    def body(self) -> Body:
        """What flies; fields (N,) of it may be written in place, which compiles nothing."""
        return self._body

    @property
    def goal(self) -> Any:
        """The current goals; fields that never vary are floats."""
        return self._episode.goal

    def reset(self, seed: int | Sequence[int] | None = None) -> Tensor:
        """Start a new episode everywhere.

        Args:
            seed: episodes count from zero under this seed, or one a member; by default they go on counting.

        Returns:
            Observation (N, width).
        """
        world, now = self._world, self._episode
        if seed is None:
            write([now.clock], [world.next_episode(now.clock)])
        else:
            each = self.num_envs // self.members
            # Numbers go into memory without a copy from the CPU, which no CUDA graph could record.
            words = seed_words(seed) if isinstance(seed, int) else self._place.words(seed, each)
            write((self._draws.low, self._draws.high), words)
            write([now.clock], [0])
        begun = world.begin(*world.scenario(now.clock, self._draws), now.clock, self._draws, now.body)
        write(leaves(now), leaves(begun if now.case is not None else replace(begun, case=None)))
        return self.observe()

    def stagger(self, *generators: torch.Generator) -> None:
        """Pretend the episodes started at random times, so that they do not all end together.

        Args:
            generators: of the random times, each of an equal part of the batch; by default torch's own.
        """
        limit, everywhere = self.timing.episode_steps, self.num_envs * self.processes.size
        parts = generators or (None,)
        steps = self.processes.mine(torch.cat([
            torch.randint(0, limit, (everywhere // len(parts),), generator=generator, dtype=torch.int32)
            for generator in parts]))
        clock = self._episode.clock
        clock -= clock & self._world.step_mask
        clock += self._place.put(steps, torch.int32)

    @property
    def privileged_width(self) -> int:
        """Columns of `privileged`."""
        return len(leaves(self.body))

    def privileged(self) -> Tensor:
        """What a simulator knows and a robot does not, (N, p): the body's numbers over the craft's own."""
        nominal = Body.of(self.craft)
        scales = leaves(replace(nominal, inertia=(max(nominal.inertia),) * len(nominal.inertia),
                                centre=(self.craft.radius,) * len(nominal.centre),
                                leak=(1.0,) * len(nominal.leak)))
        everywhere = torch.ones(self.num_envs, dtype=self.dtype, device=self.device)
        columns = [everywhere * (x if isinstance(x, int | float) else torch.as_tensor(x))
                   for x in map(operator.truediv, leaves(self.body), scales)]
        return torch.stack(columns, dim=1)

    def observe(self) -> Tensor:
        """The current observation, (N, width)."""
        now = self._world.recalled(self._episode, self._draws)
        return self._place.stack(self._world.observe(now, self._draws)).T

    def errors(self) -> dict[str, Tensor]:
        """The task's errors in the current state by name, each (N,)."""
        errors = self.task.errors(self._episode.state, self._episode.goal)
        return {name: torch.as_tensor(error) for name, error in errors.items()}

    def step(self, action: Tensor) -> Step:
        """Hold the thrusters for one control period.

        Args:
            action: (N, thrusters), 0 (shut) or 1 (open); any dtype.

        Raises:
            ConfigError: the action has another shape.
        """
        shape = (self.num_envs, len(self.craft.thrusters))
        if tuple(action.shape) != shape:
            raise ConfigError(f"actions must have the shape {shape} (environments, thrusters), got "
                              f"{tuple(action.shape)}.")
        if self._place.on_numpy:
            return self._step_numpy(action)
        if self._kernel is not None:
            return self._kernel(action)
        return self._step(self._world, self._episode, action, self._draws)

    def _generated(self) -> Kernel | None:
        """The step as one generated kernel; without it torch's compiler makes several."""
        if self.device.type != "cuda" or not self.compiled:
            return None
        try:
            kernel = Kernel(self._world, self._episode, self._draws, self.processes, self.dtype, self.members)
            kernel.function(self.dtype)
        # No compiler, or a task that does more than arithmetic on fields.
        except (OSError, CudaError, *UNTRACEABLE) as error:
            warnings.warn(f"torch.compile makes this engine's step, which is slower: {error}", stacklevel=3)
            return None
        return kernel

    def _step_numpy(self, action: Tensor) -> Step:
        command = tuple(np.ascontiguousarray(action.numpy().T).astype(self._place.fields))
        seen = step_and_restart(self._world, self._episode, command, self._draws)
        write(self._episode.memory(), seen.after.memory())
        return results(seen, self._place.stack, torch.from_numpy)

    def save_state(self) -> dict[str, Any]:
        """Everything a later `load_state` needs to go on bit-identically."""
        return saved(self._world, self._episode, (self._draws.low, self._draws.high), self.processes)

    def load_state(self, table: dict[str, Any]) -> None:
        """Continue from what `save_state` gave.

        Raises:
            ConfigError: it was saved with another number of environments, dimension or length of episodes.
        """
        restore(table, self._world, self._episode, (self._draws.low, self._draws.high), self.processes)
