"""Batched episodes on one device: states are tensors, and one call steps every spacecraft.

`tests/fast` compares it with `rans.episode.environment` and NumPy, row by row: rows never depend on one another.
"""

from __future__ import annotations

from contextlib import AbstractContextManager
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from rans.base.errors import ConfigError, brief, checked
from rans.base.registry import typed
from rans.base.settled import settled
from rans.effectors.commands import check_commands, is_identity, is_possible, of_outputs
from rans.episode.step import Episode, Guard, Setup, World
from rans.fast.distributed import ALONE, Processes
from rans.fast.privileged import PrivilegedObservation
from rans.fast.stepping.compiled import generated_step, stepping
from rans.fast.stepping.step import (
    Backend,
    Step,
    copy_into,
    environment_count,
    restore,
    restoring,
    snapshot,
    stepped,
)
from rans.model.accuracy import chosen
from rans.model.body import Body, check_stores, in_memory
from rans.model.fields import leaves, map_leaves
from rans.model.random import Draws, seed_words
from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import load_spacecraft
from rans.model.timing import Timing
from rans.randomization.conditions import Conditions
from rans.randomization.conditions_file import load_conditions
from rans.tasks import Task, load_task
from rans.tasks.base import reward_terms
from rans.tasks.derived import example
from rans.tasks.feasible import warn_of_obstacles
from rans.tasks.rewards import Transition


class Engine:
    """Batch of N episodes of one spacecraft and one task on one device.

    >>> engine = rans.Engine("floating-platform", "go-to-pose", num_envs=4, seed=0)
    >>> engine.step(torch.ones(4, 8)).reward.shape
    torch.Size([4])

    Args:
        craft: spacecraft, or its name or TOML file.
        task: task, or its name in `rans.tasks.TASKS`.
        num_envs: number of environments, N.
        timing: control period, substeps, checks and length of an episode; None: those of the task.
        seed: seed, which together with the number of an episode determines its start, goal and draws.
        device: torch device of the state.
        dtype: torch.float32, or torch.float64 for comparisons.
        compiled: whether a step is one compiled kernel; by default on a GPU only. Otherwise a CPU runs the same
            source on NumPy, two to six times faster than uncompiled torch.
        generated: whether a GPU uses a package's kernel (docs/decisions/engine.md), which is 1.4 to 2.7 times as
            fast as that of torch.compile, its replacement where there is none.
        processes: processes that share the batch; ``num_envs`` is the number of this one.
        body: mass properties and thruster health of each spacecraft, numbers or (N,); None: as designed.
        conditions: domain randomization, disturbances, faults and sensors, as a name, a TOML file or an object;
            None: everything is nominal.
        guard: safety filter between actions and effectors; None: every action is executed.
        remember: whether the draws of the conditions are stored, for `privileged`. Otherwise the generated kernel
            draws them again in every step; other steps always store them.
        plain: whether every step evaluates the equations on torch tensors one operation at a time, so that
            breakpoints in the functions of a task work (docs/plain.md). Results are equal up to rounding, and
            steps are many times slower. Trainers on a plain engine are plain too.

    Raises:
        ConfigError: plain and compiled are both set; the device, spacecraft, task or conditions do not exist;
            num_envs is not a positive whole number; dtype is another one; or the body is not that of a rigid body,
            of another number of spacecraft, or too light for its effectors.
    """

    @settled
    def __init__(
        self,
        craft: str | Path | Spacecraft,
        task: str | Task,
        num_envs: int,
        timing: Timing | None = None,
        *,
        seed: int = 0,
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
        # What is flown: names become values, and nothing later reads a file.
        if plain and compiled:
            raise ConfigError(
                "plain=True steps by single operations of torch, and compiled=True by a "
                "compiled kernel: give one of them."
            )
        num_envs = environment_count(num_envs)
        self._backend = backend = Backend.of(device, dtype, compiled, plain)
        is_craft_named = isinstance(craft, str | Path)
        if not isinstance(task, Task):
            task = load_task(typed(task))
        self.craft, self.task = craft, task = load_spacecraft(typed(craft)), task
        self.timing = task.timing if timing is None else checked("timing", timing, Timing)
        conditions = None if conditions is None else load_conditions(typed(conditions), craft)
        if is_craft_named:
            warn_of_obstacles(craft, task, self.timing)
        # How it is stepped: device, precision, and whether a step is compiled.
        self.num_envs = num_envs
        self.dtype = dtype
        self.device = backend.device
        self._is_usual = is_identity(craft)
        if getattr(guard, "by_values", False):
            if compiled:
                raise ConfigError(
                    f"the guard {brief(guard)} branches on values, which a compiled step cannot do: leave "
                    "compiled=True out."
                )
            compiled = False
        self.plain = plain
        """Whether steps evaluate single operations of torch, see the class."""
        self.compiled = not plain and (self.device.type == "cuda" if compiled is None else compiled)
        self.processes = processes
        # The world and its buffers, one row for every environment.
        observed = example(task, craft.dimension)
        self.layout = observed.layout()
        self.observation_bounds = observed.bounds()
        """Largest absolute value of each column of an observation."""
        first = np.arange(num_envs) * processes.size + processes.rank
        nominal = Body.of(craft)
        self.observation_width = self.layout.width
        """Number of columns of an observation."""
        self.body = in_memory(body or nominal, nominal, num_envs, lambda x: backend.put(x, dtype))
        """Body of the spacecraft; its fields (N,) may be changed in place without a new compilation."""
        check_stores(craft, self.body)
        how = chosen(craft, self.timing, body) if conditions is None else self.timing
        self._world = World(Setup(craft, task, how, conditions, guard), backend.nodes)
        self.privileged_quantities = PrivilegedObservation(
            self._world, self.body, torch.ones(num_envs, dtype=dtype, device=backend.device)
        )
        """Quantities of `privileged`."""
        low, high = (backend.put(word, torch.int32) for word in seed_words(seed))
        self._draws = draws = Draws(
            low,
            high,
            backend.put(first, torch.int32),
            num_envs * processes.size,
            backend.fields,
        )
        buffers = self._world, self.body, num_envs, draws
        # A generated kernel steps on a GPU where it can; any other step needs episodes that remember.
        self.episode = backend.episodes(*buffers, remember)
        self._kernel = None
        if generated and self.compiled and self.device.type == "cuda":
            self._kernel = generated_step("cuda", self._world, self.episode, draws)
        if self._kernel is None:
            self.episode = backend.episodes(*buffers, remember=True)
        self._step = stepping(backend, self.compiled and self._kernel is None, plain)
        self.state, self.goal = self.episode.state, self.episode.goal
        """State and goal of the running episodes; the next step overwrites their tensors; constants are floats."""
        self.reset(seed)

    def __repr__(self) -> str:
        task = type(self.task).__name__
        return f"<Engine: {self.num_envs:,} x {self.craft.name}, {task}, on {self.device}>"

    @cached_property
    def term_names(self) -> tuple[str, ...]:
        """Names of the reward terms in the order of `Step.terms`, from one example step.

        Sums of rewards are stored in this order (`Rollout.terms`), which may not depend on values or settings.
        """
        zero = leaves(self.state)[0] * 0.0
        shut = (zero,) * self.craft.command_count
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

    @settled
    def reset(self, seed: int | None = None) -> Tensor:
        """Start a new episode in every environment; returns the observation (N, width).

        Args:
            seed: seed, whose episodes are counted from zero; None: continue with the next episodes.
        """
        world = self._world
        now = self.episode
        if seed is None:
            copy_into([now.clock], [world.timing.next_episode(now.clock)])
        else:
            # Numbers are written without a copy from the CPU, which CUDA graphs cannot record.
            copy_into((self._draws.low, self._draws.high), seed_words(seed))
            copy_into([now.clock], [0])
        begun = world.begin(
            *world.scenario(now.clock, self._draws), now.clock, self._draws, now.body
        )
        copy_into(
            leaves(now),
            leaves(begun if now.parameters is not None else replace(begun, parameters=None)),
        )
        return self.observe()

    def stagger(self, generator: torch.Generator | None = None) -> None:
        """Set the clocks of the episodes to random times, so that they do not all end together.

        Args:
            generator: random generator; by default that of torch.
        """
        limit = self.timing.episode_steps
        everywhere = self.num_envs * self.processes.size
        clock = self.episode.clock
        steps = torch.randint(0, limit, (everywhere,), generator=generator, dtype=torch.int32)
        clock -= self.timing.step(clock)
        clock += self._backend.put(self.processes.mine(steps), torch.int32)

    def elapsed(self) -> Tensor:
        """Control periods since the start of the running episodes, (N,)."""
        return torch.as_tensor(self.timing.step(self.episode.clock))

    def privileged(self) -> Tensor:
        """Privileged observations (N, p): quantities that a robot cannot measure, see `PrivilegedObservation`."""
        return self.privileged_quantities.of(self._world.recalled(self.episode, self._draws))

    def observe(self) -> Tensor:
        """Current observation, (N, width)."""
        if self._kernel is not None and self._kernel.observe:
            return self._kernel.observe()
        now = self._world.recalled(self.episode, self._draws)
        return self._backend.stack(self._world.observe(now, self._draws)).T

    def errors(self) -> dict[str, Tensor]:
        """Errors of the task in the current state by quantity, (N,), SI units."""
        errors = self.task.errors(self.state, self.goal)
        return {name: torch.as_tensor(error) for name, error in errors.items()}

    @settled
    def step(self, action: Tensor) -> Step:
        """Hold the commands for one control period.

        Args:
            action: commands (N, commands) within the ranges of the craft's ``commands``, usually 0 (shut) to 1
                (open). Ranges are checked only on a CPU without compilation; elsewhere 5 gives five times the
                thrust, and NaN ends the episode as ``terminated``. Only environments check that commands of on/off
                thrusters are 0 or 1.

        Raises:
            ConfigError: the action is not a tensor of this shape, or a command is out of range.
        """
        cheap = self.device.type == "cpu" and not self.compiled
        _check_actions(action, self.num_envs, self.craft, cheap, self._is_usual)
        if self._kernel is not None:
            return self._kernel(action)
        return self._step(self._world, self.episode, action, self._draws)

    @settled
    def stepped(self, episode: Episode, action: Tensor) -> tuple[Step, Episode]:
        """Differentiable step from episodes of this engine, whose own state does not change.

        Args:
            episode: episodes from `running` or from the last call.
            action: commands (N, commands), each 0 to 1.

        Returns:
            The step, and the episodes of the next step.

        Raises:
            ConfigError: the engine is not plain.
        """
        if not self.plain:
            raise ConfigError(
                "gradients go through a plain engine only: make it with plain=True, which computes with "
                "torch tensors."
            )
        return stepped(self._world, episode, action, self._draws, plain=True)

    def running(self) -> Episode:
        """Copy of the running episodes."""
        return map_leaves(lambda x: x.clone() if isinstance(x, Tensor) else x, self.episode)

    def go_on(self, episode: Episode) -> None:
        """Continue with episodes from `stepped`."""
        copy_into(self.episode.memory(), [x.detach() for x in episode.memory()])

    def commands(self, outputs: Tensor) -> Tensor:
        """Actions from policy outputs (N, commands) in [0, 1], see `rans.effectors.commands.of_outputs`."""
        if self._is_usual:
            return outputs
        return torch.stack(tuple(of_outputs(self.craft, outputs.unbind(dim=1))), dim=1)

    def holding(self, held: Tensor) -> AbstractContextManager[None]:
        """Context in which the episodes where ``held`` (N,) bool is true do not change."""
        return restoring(self.episode.memory(), held)

    def save_state(self) -> dict[str, Any]:
        """Complete state, from which `load_state` continues bit for bit; all processes must call it."""
        return snapshot(
            self._world, self.episode, (self._draws.low, self._draws.high), self.processes
        )

    def load_state(self, table: dict[str, Any]) -> None:
        """Continue from the result of `save_state`.

        Raises:
            ConfigError: it belongs to other environments or episodes.
        """
        restore(
            table, self._world, self.episode, (self._draws.low, self._draws.high), self.processes
        )


def _check_actions(
    action: Tensor, count: int, craft: Spacecraft, with_range: bool, is_usual: bool
) -> None:
    """Reject (`ConfigError`) actions that are not a tensor (environments, commands).

    With ``with_range`` also numbers outside the ranges of the commands, of a tensor on the CPU.
    """
    if not isinstance(action, Tensor):
        checked("actions", action, Tensor)
    shape = tuple(action.shape)
    if shape != (count, craft.command_count):
        raise ConfigError(
            f"actions must have the shape {(count, craft.command_count)} (environments, "
            f"commands), got {shape}."
        )
    unknown_to_numpy = with_range and action.dtype == torch.bfloat16
    if action.layout != torch.strided or action.is_meta or action.is_complex() or unknown_to_numpy:
        raise ConfigError(
            "actions must be a dense tensor of real numbers in memory that NumPy knows, got one with dtype "
            f"{str(action.dtype).removeprefix('torch.')}, layout {str(action.layout).removeprefix('torch.')} "
            f"and device {action.device}."
        )
    if action.requires_grad and torch.is_grad_enabled():
        raise ConfigError(
            "actions must not require gradients, as no gradient goes through this step: give actions.detach(), or "
            "use Engine.stepped with plain=True."
        )
    if with_range:
        _check_range(action.detach().numpy(), craft, is_usual)


def _check_range(actions: np.ndarray, craft: Spacecraft, is_usual: bool) -> None:
    """Reject (`ConfigError`) actions (N, n) outside the ranges of the commands, including NaN.

    It runs in every step, so that usual commands cost only a minimum and a maximum.
    """
    if not is_usual:
        if not is_possible(craft, actions):
            check_commands(craft, actions, len(actions))
        return
    least = actions.min()
    largest = actions.max()
    if not (least >= 0 and largest <= 1):
        raise ConfigError(
            f"actions must be numbers from 0 (shut) to 1 (open), got numbers from {least} to {largest}; "
            "the usual cause is a policy output that was not clipped or rounded."
        )
