"""Batched episodes on one device: the state lives in tensors, one call steps every spacecraft."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from rans.effectors.commands import check, is_identity, is_possible, of_outputs
from rans.episode import Episode, Guard, Setup, World
from rans.errors import ConfigError, brief, checked, counted
from rans.fast.distributed import ALONE, Processes
from rans.fast.privileged import PrivilegedObservation
from rans.fast.stepping.compiled import stepping
from rans.fast.stepping.kernel import Kernel
from rans.fast.stepping.step import (
    Backend,
    Step,
    divisible,
    holding,
    restore,
    snapshot,
    stepped,
    write,
)
from rans.model.accuracy import chosen
from rans.model.body import Body, in_memory
from rans.model.fields import leaves, map_leaves
from rans.model.random import Draws, seed_words
from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import load_spacecraft
from rans.model.timing import Timing
from rans.randomization.conditions import Conditions
from rans.randomization.conditions_file import load_conditions
from rans.tasks import Task, load_task
from rans.tasks.base import reward_terms
from rans.tasks.derived import layout
from rans.tasks.rewards import Transition


class Engine:
    """N copies of one spacecraft flying one task.

    >>> engine = rans.Engine("floating-platform", "go-to-pose", num_envs=4, seed=0)
    >>> engine.step(torch.ones(4, 8)).reward.shape
    torch.Size([4])

    Args:
        craft: what flies: a spacecraft, or its name or TOML file.
        task: what it flies to: a task, or a name of `rans.tasks.TASKS`.
        num_envs: N.
        timing: control period, accuracy and length of an episode; None: the task's own.
        seed: decides all starts and goals, with the episode's number. Several are those of as many members,
            who own the environments in equal, contiguous parts and count their episodes each from zero.
        device: torch device of the state.
        dtype: torch.float32, or torch.float64 for comparisons.
        compiled: whether a step is one compiled kernel; by default on a GPU only. On a CPU the same source
            then runs on NumPy, without a compiler and two to six times faster than uncompiled torch.
        generated: whether on a GPU that is the kernel of docs/decisions/007-generated-kernel.md, 1.4
            to 2.7 times as fast as torch.compile's, which stands in where it cannot be made.
        processes: those among which the batch is divided; ``num_envs`` are this one's.
        body: other than the craft's, each number or (N,), one for each spacecraft.
        conditions: what episodes do not promise, by name, TOML file or as such; None: a perfect world.
        guard: safety filter between actions and effectors; None: every action is taken.
        remember: whether what episodes draw from their conditions lies in memory, for `privileged`; the
            generated kernel else draws it again in every step. A step without one always remembers.
        plain: whether every step is the equations as they are written, on torch's tensors, one operation
            after the other: what a task's functions are given are numbers, and a breakpoint in them stops
            (docs/plain.md). Equal to the fast ways but for rounding, and many times slower. What learns on a
            plain engine is plain too.

    Raises:
        ConfigError: it is to be plain and compiled, there is no such device here, spacecraft, task or
            conditions, num_envs is not a positive whole number, dtype another one, or mass properties are not
            those of rigid bodies or not so many.
    """

    def __init__(
        self,
        craft: str | Path | Spacecraft,
        task: str | Task,
        num_envs: int,
        timing: Timing | None = None,
        *,
        seed: int | Sequence[int] = 0,
        device: str | torch.device = "cpu",
        dtype: torch.dtype = torch.float32,
        compiled: bool | None = None,
        generated: bool = True,
        processes: Processes = ALONE,
        body: Body | None = None,
        conditions: str | Path | Conditions | None = None,
        remember: bool = False,
        guard: Guard | None = None,
        plain: bool = False,
    ) -> None:
        if plain and compiled:
            raise ConfigError(
                "plain=True steps by torch's operations as they are written, and compiled=True by a "
                "compiled kernel: give one of them."
            )
        seeds = seed if isinstance(seed, Sequence) else [seed]
        num_envs = divisible(num_envs, len(seeds))
        self._backend = backend = Backend.of(device, dtype, compiled, plain)
        self.craft, self.task = craft, task = load_spacecraft(craft), load_task(task)
        self.timing = task.timing if timing is None else checked("timing", timing, Timing)
        conditions = None if conditions is None else load_conditions(conditions)
        self.num_envs = num_envs
        self.dtype = dtype
        self.device = backend.device
        self._is_usual = is_identity(craft)
        if getattr(guard, "by_values", False):
            if compiled:
                raise ConfigError(
                    f"the guard {brief(guard)} chooses by values, which no compiled step does: leave "
                    "compiled=True out."
                )
            compiled = False
        self.plain = plain
        """Whether everything is computed as it is written, see the class."""
        self.compiled = not plain and (self.device.type == "cuda" if compiled is None else compiled)
        self.processes = processes
        self.members = len(seeds)
        each = num_envs // len(seeds)
        self.layout = layout(task, craft.dimension)
        nominal = Body.of(craft)
        self.observation_width = self.layout.width
        """Columns of an observation."""
        self.body = in_memory(body or nominal, nominal, num_envs, lambda x: backend.put(x, dtype))
        """What flies; fields (N,) of it may be written in place, which compiles nothing."""
        how = chosen(craft, self.timing, body) if conditions is None else self.timing
        self._world = World(Setup(craft, task, how, conditions, guard), backend.nodes)
        self.privileged_quantities = PrivilegedObservation(
            self._world, self.body, torch.ones(num_envs, dtype=dtype, device=backend.device)
        )
        """What `privileged` tells."""
        first = np.arange(num_envs) % each * processes.size + processes.rank
        self._draws = draws = Draws(
            *backend.words(seeds, each),
            backend.put(first, torch.int32),
            each * processes.size,
            backend.fields,
        )
        buffers = self._world, self.body, num_envs, draws
        self.episode = backend.episodes(*buffers, remember)
        self._kernel = None
        if generated and self.compiled and self.device.type == "cuda":
            self._kernel = Kernel.made(
                self._world, self.episode, draws, processes, dtype, self.members
            )
        if self._kernel is None:
            self.episode = backend.episodes(*buffers, remember=True)
        self._step = stepping(backend, self.compiled and self._kernel is None, plain)
        self.state, self.goal = self.episode.state, self.episode.goal
        """Of the running episodes; fields are what the next step overwrites, those that never vary floats."""
        self.reset(seeds)

    def __repr__(self) -> str:
        task = type(self.task).__name__
        return f"<Engine: {self.num_envs:,} x {self.craft.name}, {task}, on {self.device}>"

    @cached_property
    def term_names(self) -> tuple[str, ...]:
        """Names of the reward terms, in the order of `Step.terms`."""
        zero = leaves(self.state)[0] * 0.0
        shut = (zero,) * len(self.craft.commands)
        transition = Transition(
            self.state,
            self.goal,
            shut,
            shut,
            self.state,
            self.timing.control_period,
            self._world.forces,
        )
        done = self.task.done(self.state, self.goal)
        violated = zero < 0.0 if self.task.constraints(self.state, self.goal) else None
        return tuple(reward_terms(self.task, transition, done, violated))

    def reset(self, seed: int | Sequence[int] | None = None) -> Tensor:
        """Start a new episode everywhere, and observe (N, width).

        Episodes count from zero under a given seed, or one a member, ConfigError else; by default
        they go on counting.
        """
        _check_seeds(seed, self.members)
        world = self._world
        now = self.episode
        if seed is None:
            write([now.clock], [world.timing.next_episode(now.clock)])
        else:
            each = self.num_envs // self.members
            # Numbers go into memory without a copy from the CPU, which no CUDA graph could record.
            words = (
                self._backend.words(seed, each) if isinstance(seed, Sequence) else seed_words(seed)
            )
            write((self._draws.low, self._draws.high), words)
            write([now.clock], [0])
        begun = world.begin(
            *world.scenario(now.clock, self._draws), now.clock, self._draws, now.body
        )
        write(
            leaves(now),
            leaves(begun if now.parameters is not None else replace(begun, parameters=None)),
        )
        return self.observe()

    def stagger(self, *generators: torch.Generator) -> None:
        """Pretend the episodes started at random times, so that they do not all end together.

        Each generator is of the times of an equal part of the batch; by default there is only torch's own.
        """
        limit = self.timing.episode_steps
        everywhere = self.num_envs * self.processes.size
        parts = generators or (None,)
        shape = (everywhere // len(parts),)
        clock = self.episode.clock
        steps = torch.cat(
            [torch.randint(0, limit, shape, generator=own, dtype=torch.int32) for own in parts]
        )
        clock -= self.timing.step(clock)
        clock += self._backend.put(self.processes.mine(steps), torch.int32)

    def privileged(self) -> Tensor:
        """What a simulator knows of every spacecraft and a robot does not, (N, p), see `PrivilegedObservation`."""
        return self.privileged_of(self.episode)

    def privileged_of(self, episode: Episode) -> Tensor:
        """What `privileged` gives, (N, p), of episodes as `stepped` returned them."""
        return self.privileged_quantities.of(self._world.recalled(episode, self._draws))

    def observe(self) -> Tensor:
        """The current observation, (N, width)."""
        if self._kernel is not None:
            return self._kernel.observe()
        now = self._world.recalled(self.episode, self._draws)
        return self._backend.stack(self._world.observe(now, self._draws)).T

    def errors(self) -> dict[str, Tensor]:
        """The task's errors in the current state by name, each (N,)."""
        errors = self.task.errors(self.state, self.goal)
        return {name: torch.as_tensor(error) for name, error in errors.items()}

    def step(self, action: Tensor) -> Step:
        """Hold the commands for one control period.

        Actions are a tensor (N, commands), ConfigError else, in the ranges of the craft's ``commands``, usually
        0 (shut) to 1 (open), checked on a CPU where nothing is compiled; elsewhere 5 is five times the thrust,
        and NaN ends the episode as ``terminated``. Only environments check that on/off thrusters are told
        nothing between.
        """
        cheap = self.device.type == "cpu" and not self.compiled
        _check_actions(action, self.num_envs, self.craft, cheap, self._is_usual)
        if self._kernel is not None:
            return self._kernel(action)
        return self._step(self._world, self.episode, action, self._draws)

    def stepped(self, episode: Episode, action: Tensor) -> tuple[Step, Episode]:
        """One step from episodes of this engine, which changes nothing: gradients go through it.

        Args:
            episode: to act in: `running`, or what the call before returned.
            action: (N, thrusters), each 0 to 1.

        Returns:
            The step, and the episodes to act in next.

        Raises:
            ConfigError: the engine is not plain, so that its numbers are not torch's.
        """
        if not self.plain:
            raise ConfigError(
                "gradients go through a plain engine only: make it with plain=True, as its numbers are "
                "torch's tensors then."
            )
        return stepped(self._world, episode, action, self._draws, plain=True)

    def running(self) -> Episode:
        """A copy of the episodes that run now."""
        return map_leaves(lambda x: x.clone() if isinstance(x, Tensor) else x, self.episode)

    def go_on(self, episode: Episode) -> None:
        """Go on with these episodes, as `stepped` returned them."""
        write(self.episode.memory(), [x.detach() for x in episode.memory()])

    def commands(self, outputs: Tensor) -> Tensor:
        """Actions of a policy whose outputs (N, commands) are from 0 to 1, see `rans.effectors.commands`."""
        if self._is_usual:
            return outputs
        return torch.stack(tuple(of_outputs(self.craft, outputs.unbind(dim=1))), dim=1)

    def holding(self, held: Tensor) -> AbstractContextManager[None]:
        """Within it the spacecraft where ``held``, (N,) bool, stay as they are, whatever the others do."""
        return holding(self.episode.memory(), held)

    def save_state(self) -> dict[str, Any]:
        """Everything a later `load_state` needs to go on bit-identically; all processes must ask."""
        return snapshot(
            self._world, self.episode, (self._draws.low, self._draws.high), self.processes
        )

    def load_state(self, table: dict[str, Any]) -> None:
        """Continue from what `save_state` gave; ConfigError where it is of other environments or episodes."""
        restore(
            table, self._world, self.episode, (self._draws.low, self._draws.high), self.processes
        )


def _check_actions(
    action: Tensor, count: int, craft: Spacecraft, with_range: bool, is_usual: bool
) -> None:
    """Refuse (`ConfigError`) actions that are no tensor (environments, commands).

    With their range also numbers that are in none of the commands' ranges, of a tensor on the CPU; usual ones
    are from 0 to 1.
    """
    if not isinstance(action, Tensor):
        checked("actions", action, Tensor)
    shape = tuple(action.shape)
    if shape != (count, len(craft.commands)):
        raise ConfigError(
            f"actions must have the shape {(count, len(craft.commands))} (environments, "
            f"commands), got {shape}."
        )
    if with_range:
        _check_range(action.numpy(), craft, is_usual)


def _check_range(actions: np.ndarray, craft: Spacecraft, is_usual: bool) -> None:
    """Refuse (`ConfigError`) what is outside the commands' ranges; NaN is one of these.

    It takes half a per cent of a step of 16,384 environments.
    """
    if not is_usual:
        if not is_possible(craft, actions):
            check(craft, actions, len(actions))
        return
    least = actions.min()
    most = actions.max()
    if not (least >= 0 and most <= 1):
        raise ConfigError(
            f"actions must be numbers from 0 (shut) to 1 (open), got numbers from {least} to {most}; "
            "the usual cause is a policy's output that nobody clipped or rounded."
        )


def _check_seeds(seed: int | Sequence[int] | None, members: int) -> None:
    """Refuse (`ConfigError`) several seeds that are not one for each member."""
    if isinstance(seed, Sequence) and len(seed) not in (1, members):
        raise ConfigError(
            f"an engine of {counted(members, 'member')} is reset by one seed or by one "
            f"for each, got {len(seed)}."
        )
