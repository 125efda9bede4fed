"""Batched episodes on one device: the state lives in tensors, one call steps every spacecraft."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
import torch
from torch import Tensor

from rans.episode import Episode, World
from rans.errors import ConfigError
from rans.fast.distributed import ALONE, Processes
from rans.fast.kernels.launch import Kernel
from rans.fast.step import Step, results, step_and_restart, step_tensors
from rans.model.body import Body, in_memory
from rans.model.dynamics import NODES
from rans.model.fields import leaves, map_leaves
from rans.model.random import seed_words
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from rans.tasks.base import Task, layout
from rans.tasks.rewards import Transition

_FLOAT32_NODES = 4
"""Quadrature nodes at which float32 rounding hides the rule's error, up to 15 rad/s."""
_NUMPY_DTYPES = {torch.float32: np.float32, torch.float64: np.float64}


def field_dtype(device: torch.device, dtype: torch.dtype = torch.float32,
                compiled: bool | None = None) -> Any:
    """Dtype of an engine's fields: NumPy's for an uncompiled step on a CPU, else torch's."""
    return dtype if compiled or device.type == "cuda" else _NUMPY_DTYPES[dtype]


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

    Raises:
        ConfigError: craft is no spacecraft, num_envs not a positive whole number, dtype another one, or mass
            properties are not those of rigid bodies or not so many.
    """

    def __init__(self, craft: Spacecraft, task: Task, num_envs: int, timing: Timing | None = None, *,
                 seed: int | Sequence[int] = 0, device: str | torch.device = "cpu",
                 dtype: torch.dtype = torch.float32, compiled: bool | None = None,
                 generated: bool = True, processes: Processes = ALONE, body: Body | None = None) -> None:
        if not isinstance(craft, Spacecraft):
            raise ConfigError(f"craft must be a Spacecraft, got {craft!r}; rans.load_spacecraft reads one.")
        if isinstance(num_envs, bool) or not isinstance(num_envs, int) or num_envs < 1:
            raise ConfigError(
                f"the number of environments must be a whole number >= 1, got {num_envs!r}.")
        if not isinstance(seed, int) and (not seed or num_envs % len(seed)):
            raise ConfigError(f"{num_envs} environments cannot be divided among {len(seed)} members.")
        if dtype not in _NUMPY_DTYPES:
            raise ConfigError(f"dtype must be torch.float32 or torch.float64, got {dtype!r}.")
        self.craft, self.task, self.timing = craft, task, timing or Timing()
        self.num_envs, self.dtype, self.device = num_envs, dtype, torch.device(device)
        self.compiled = self.device.type == "cuda" if compiled is None else compiled
        self.processes = processes
        self.layout = layout(task, craft.dimension)
        fields = field_dtype(self.device, dtype, self.compiled)
        self._on_numpy = not isinstance(fields, torch.dtype)
        nominal = Body.of(craft)
        self._fields = fields
        self._world = World(craft, task, self.timing,
                            _FLOAT32_NODES if dtype == torch.float32 else NODES)
        step = step_tensors
        self._step = torch.compile(step, fullgraph=True, dynamic=False) if self.compiled else step
        self.members = 1 if isinstance(seed, int) else len(seed)
        seed = seed if isinstance(seed, int) or self.members > 1 else seed[0]
        self._each = num_envs // self.members
        self._body = in_memory(body or nominal, nominal, num_envs, self._field)
        self._numbers = self._first_numbers(), self._each * processes.size
        self._seed = self._words(seed)
        self._episode = self._allocate()
        self._kernel = self._generated() if generated else None
        self.reset(seed)

    def _field(self, values: Any) -> Any:
        """A copy of them, (N,)."""
        copy = torch.as_tensor(values).to(self.device, self.dtype, copy=True)
        return copy.numpy() if self._on_numpy else copy

    def _words(self, seed: int | Sequence[int]) -> tuple[Any, Any]:
        """A seed's two words, or every environment's own of its member's."""
        if isinstance(seed, int):
            low, high = seed_words(seed)
        else:
            low, high = np.repeat([seed_words(s) for s in seed], self._each, axis=0).astype(np.int32).T.copy()
        if self._on_numpy:
            return low, high
        low, high = (torch.as_tensor(word, dtype=torch.int32, device=self.device) for word in (low, high))
        return low, high

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
        world, clock = self._world, self._episode.clock
        if seed is None:
            self._write(clock, world.next_episode(clock))
        else:
            self._set_seed(seed_words(seed) if isinstance(seed, int) else self._words(seed))
            self._write(clock, 0)
        start, goal = world.begin(self._seed, world.number(clock, self._numbers), self._fields)
        now = self._episode
        shut = (0,) * len(now.previous)
        for buffer, value in zip(leaves((now.state, now.goal, now.previous)), leaves((start, goal, shut)),
                                 strict=True):
            if not isinstance(buffer, float):
                self._write(buffer, value)
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
        clock += steps.numpy() if self._on_numpy else steps.to(self.device)

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
        columns = [torch.as_tensor(own / scale, dtype=self.dtype, device=self.device).expand(self.num_envs)
                   for own, scale in zip(leaves(self.body), scales, strict=True)]
        return torch.stack(columns, dim=1)

    def observe(self) -> Tensor:
        """The current observation, (N, width)."""
        return self._stack(self._world.observe(self._episode)).T

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
        if self._on_numpy:
            return self._step_numpy(action)
        if self._kernel is not None:
            return self._kernel(action)
        return self._step(self._world, self._episode, action, self._seed, self._numbers, self._fields)

    def _generated(self) -> Kernel | None:
        """The step as one generated kernel; without it torch's compiler makes several."""
        if self.device.type != "cuda" or not self.compiled:
            return None
        try:
            kernel = Kernel(self._world, self._episode, self._seed, self.processes, self.dtype, self.members)
            kernel.function(self.dtype)
        except Exception as error:  # no compiler, or a task of the user's that only torch understands
            warnings.warn(f"torch.compile makes this engine's step, which is slower: {error}", stacklevel=3)
            return None
        return kernel

    def _step_numpy(self, action: Tensor) -> Step:
        command = tuple(np.ascontiguousarray(action.numpy().T).astype(self._fields))
        seen = step_and_restart(self._world, self._episode, command, self._seed, self._numbers, self._fields)
        for buffer, value in zip(self._buffers(), seen.after.memory(), strict=True):
            self._write(buffer, value)
        return results(seen, lambda rows: torch.from_numpy(np.stack(rows)), torch.from_numpy)

    def save_state(self) -> dict[str, Any]:
        """Everything a later `load_state` needs to go on bit-identically."""
        buffers = [self.processes.whole(torch.as_tensor(b)).clone() for b in self._buffers()]
        return {"buffers": buffers, "seed": [torch.as_tensor(word).tolist() for word in self._seed],
                "episode_steps": self.timing.episode_steps}

    def load_state(self, saved: dict[str, Any]) -> None:
        """Continue from what `save_state` gave.

        Raises:
            ConfigError: it was saved with another number of environments, dimension or length of episodes.
        """
        buffers, values = self._buffers(), [self.processes.mine(value) for value in saved["buffers"]]
        if [tuple(b.shape) for b in buffers] != [tuple(v.shape) for v in values]:
            raise ConfigError(
                f"the saved state is not one of {self.num_envs} environments of {self.craft.name!r}; "
                "the usual cause is a changed number of environments, or an older RANS that saved it.")
        if saved["episode_steps"] != self.timing.episode_steps:
            raise ConfigError(
                f"the saved state is one of episodes of {saved['episode_steps']:,} steps, not "
                f"{self.timing.episode_steps:,}: its clocks would be misread.")
        for buffer, value in zip(buffers, values, strict=True):
            self._write(buffer, value.cpu().numpy() if self._on_numpy else value.to(self.device))
        self._set_seed([np.array(word, dtype=np.int32) for word in saved["seed"]])

    def _set_seed(self, words: Sequence[Any]) -> None:
        """Keep the seed's two words, in memory that never moves: a CUDA graph reads it."""
        if self._on_numpy:
            self._seed = (words[0], words[1])
        else:
            for tensor, word in zip(self._seed, words, strict=True):
                tensor.fill_(word) if isinstance(word, int) else tensor.copy_(torch.as_tensor(word))

    def _first_numbers(self) -> Any:
        mine = np.arange(self.num_envs, dtype=np.int32) % self._each
        numbers = mine * np.int32(self.processes.size) + np.int32(self.processes.rank)
        return numbers if self._on_numpy else torch.from_numpy(numbers).to(self.device)

    def _allocate(self) -> Episode:
        """Buffers of the right shape; their content is written by `reset`."""
        start, goal = self._world.begin(self._seed, self._numbers[0], self._fields)
        moved = self.task.next_goal(goal, start, self.timing.control_period)
        where = {} if self._on_numpy else {"device": self.device}
        zeros: Any = np.zeros if self._on_numpy else torch.zeros
        buffer = lambda _: zeros(self.num_envs, dtype=self._fields, **where)  # noqa: E731
        return Episode(
            state=map_leaves(buffer, start),
            goal=map_leaves(lambda x, later: x if isinstance(x, float) and later is x else buffer(x),
                            goal, moved),
            body=self._body,
            clock=self._numbers[0] * 0,
            previous=self._shut() if self._world.watches_switching else (),
        )

    def _shut(self) -> tuple[Any, ...]:
        """As much memory as the actuators' commands need: one byte where they are 0 or 1."""
        zeros = np.zeros((len(self.craft.thrusters), self.num_envs), dtype=self.craft.actuators.dtype)
        return tuple(zeros) if self._on_numpy else torch.from_numpy(zeros).to(self.device).unbind()

    def _buffers(self) -> list[Any]:
        return self._episode.memory()

    def _write(self, buffer: Any, value: Any) -> None:
        buffer[:] = value

    def _stack(self, rows: tuple[Any, ...]) -> Tensor:
        return torch.from_numpy(np.stack(rows)) if self._on_numpy else torch.stack(rows)
