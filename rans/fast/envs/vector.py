"""Gymnasium vector environment of many spacecraft, with torch tensors on one device.

Row i is the single environment with the same seed and number i (`tests/fast/envs/test_vector.py`).
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from gymnasium.envs.registration import EnvSpec
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from torch import Tensor

from rans.base.errors import ConfigError, NamedArguments, brief, checked, whole
from rans.base.settled import settled
from rans.effectors.commands import action_space
from rans.episode.environment import choose, observation_space, own_spec
from rans.episode.scenario import Scenario, each
from rans.fast.engine import Engine
from rans.fast.envs.actions import Actions
from rans.fast.stepping.step import Step
from rans.model.fields import map_leaves
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from rans.randomization.conditions import Conditions
from rans.tasks import Task
from rans.tasks.observation_terms import Dimension


class SpacecraftVectorEnv(NamedArguments, VectorEnv[Tensor, Tensor, Tensor]):
    """Gymnasium vector environment of N spacecraft, with torch tensors for observations and actions.

    >>> envs = gymnasium.make_vec("rans/GoToPose2D-v0", num_envs=4)
    >>> envs.reset(seed=0)[0].shape
    torch.Size([4, 10])

    ``gymnasium.make_vec("rans/GoToPose2D-v0", num_envs=4096)`` creates it. For wrappers that need NumPy arrays use
    ``gymnasium.wrappers.vector.ArrayConversion(env, torch, numpy)``.

    One seed serves the whole batch: environment i has episodes i, i + N, i + 2 N, ... of it, and episode k is the
    same for any N, here and in `SpacecraftEnv`. By default episodes restart in the step that ends them
    (``AutoresetMode.SAME_STEP``).

    No step waits for the device. The ``info`` of every step therefore has the same keys: "final_obs" (N, width) and
    "final_info" {"at_goal": (N,)}, for missions {"is_success": (N,)}, valid where the masks "_final_obs" and
    "_final_info" are true, and every term of the reward, such as "reward/position" (N,).

    Args:
        num_envs: number of spacecraft, N.
        task_name: name in `rans.tasks.TASKS`, or MODULE:NAME.
        dimension: 2 (plane) or 3 (space).
        spacecraft: name, TOML file or object; None: the default one of the task or the dimension.
        task: task settings; None: the defaults.
        timing: control period, substeps, checks and length of an episode; None: those of the task.
        device: torch device, see `Engine`.
        dtype: floating dtype, see `Engine`.
        compiled: whether steps are compiled, see `Engine`.
        conditions: domain randomization, disturbances, faults and sensors, as a name, a TOML file or an object;
            None: everything is nominal.
        plain: whether steps evaluate single operations of torch, so that breakpoints in the task work, see
            `Engine`.
        autoreset_mode: SAME_STEP; or NEXT_STEP, where the step after an end begins the next episode and ignores its
            action, which copies the state once more per step.
        max_episode_steps: control periods after which an episode is truncated, where the timing's are more, as
            ``gymnasium.make_vec(max_episode_steps=)`` has it of other environments; None: those of the timing.
        render_mode: None, or "rgb_array": `render` returns a frame of each spacecraft.

    Raises:
        ConfigError: one of these does not exist or does not fit the others.
    """

    metadata = {  # noqa: RUF012
        "autoreset_mode": AutoresetMode.SAME_STEP,
        "render_modes": ["rgb_array"],
    }

    @settled
    def __init__(
        self,
        num_envs: int,
        task_name: str,
        dimension: Dimension,
        *,
        spacecraft: str | Path | Spacecraft | None = None,
        task: Task | None = None,
        timing: Timing | None = None,
        device: str | torch.device = "cpu",
        dtype: torch.dtype = torch.float32,
        compiled: bool | None = None,
        conditions: str | Path | Conditions | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.SAME_STEP,
        plain: bool = False,
        max_episode_steps: int | None = None,
        render_mode: str | None = None,
    ) -> None:
        """Make the environments: arguments are those of the class."""
        if render_mode not in (None, "rgb_array"):
            raise ConfigError(f'render_mode must be None or "rgb_array", got {brief(render_mode)}.')
        self.render_mode = render_mode
        self.autoreset_mode = _mode(autoreset_mode)
        craft, task = choose(task_name, dimension, spacecraft, task)
        if max_episode_steps is not None:
            usual = task.timing if timing is None else checked("timing", timing, Timing)
            step_limit = whole("max_episode_steps", max_episode_steps)
            timing = replace(usual, episode_steps=min(step_limit, usual.episode_steps))
        self.engine = Engine(
            craft,
            task,
            num_envs,
            timing,
            device=device,
            dtype=dtype,
            compiled=compiled,
            conditions=conditions,
            plain=plain,
        )
        self._actions = Actions(self.engine)
        self._over = torch.zeros(num_envs, dtype=torch.bool, device=self.engine.device)
        self.num_envs, self.device = num_envs, self.engine.device
        width = np.float32 if dtype == torch.float32 else np.float64
        self.single_observation_space = observation_space(task, dimension, width)
        self.single_action_space = action_space(craft)
        high = np.where(
            self.single_observation_space.high < np.finfo(np.float32).max,
            self.single_observation_space.high,
            np.inf,
        )
        self._high = torch.as_tensor(high, device=self.engine.device)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._seeded = False
        self._terms = [f"reward/{name}" for name in self.engine.term_names]
        self.metadata = {
            **self.metadata,
            "autoreset_mode": self.autoreset_mode,
        }

    _spec: EnvSpec | None = None

    @property
    def spec(self) -> EnvSpec | None:  # type: ignore[override]  # an attribute in Gymnasium
        """Specification as registered, with the length of an episode of this environment."""
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:  # type: ignore[override]
        engine = self.engine
        self._spec = None if spec is None else own_spec(spec, engine.task, engine.timing)

    @settled
    def reset(
        self,
        *,
        seed: int | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Tensor, dict[str, Any]]:
        """Start new episodes; returns the observation (N, width) and an empty info.

        Args:
            seed: seed, whose episodes are counted from 0; None: the next episodes, or at first those of a random
                seed.
            options: None or an empty dict; there are none.

        Raises:
            ConfigError: a seed or an option is wrong.
        """
        for option in checked("the options of reset", options or {}, dict):
            raise ConfigError(f"unknown option {brief(option)} of reset; there are none.")
        chosen = None if seed is None else whole("the seed", seed, 0, 64)
        super().reset(seed=chosen)
        if chosen is None and not self._seeded:
            chosen = int(self.np_random.integers(2**63))
        self._seeded = True
        observation = self._within(self.engine.reset(chosen))
        self._over.fill_(False)
        return observation, {}

    @settled
    def step(self, actions: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor, dict[str, Any]]:
        """Hold the commands for one control period.

        Args:
            actions: commands (N, commands), usually 0 (shut) or 1 (open); a tensor of any dtype or an array.

        Returns:
            Observation (N, width), reward (N,), terminated and truncated (N,) bool, and info (see the class).

        Raises:
            ConfigError: the actions have another shape or are out of range.
            gymnasium.error.ResetNeeded: `reset` has not been called.
        """
        if not self._seeded:
            raise ResetNeeded("call reset() before step().")
        actions = self._actions.checked(actions)
        step = self._stepped(actions)
        ended = step.terminated | step.truncated
        info = {
            **dict(zip(self._terms, step.terms, strict=True)),
            "final_obs": self._within(step.final_observation),
            "_final_obs": ended,
            "final_info": {self.engine.task.end_key: step.at_goal},
            "_final_info": ended,
        }
        observation = step.observation
        if self.autoreset_mode == AutoresetMode.NEXT_STEP:
            observation = torch.where(ended[:, None], step.final_observation, observation)
            self._over = ended
        return self._within(observation), step.reward, step.terminated, step.truncated, info

    def render(self) -> tuple[np.ndarray, ...] | None:
        """A frame (480, 640, 3), uint8, of each spacecraft in the mode "rgb_array", else None."""
        if self.render_mode is None:
            return None
        from rans.episode.drawing import Scene

        if not self._seeded:
            raise ResetNeeded("call reset() before render().")
        scene = Scene(self.engine.craft, self.engine.task)
        shut = [0.0] * self.engine.craft.command_count
        zeros = np.zeros(self.num_envs)
        ends = [
            map_leaves(lambda x: np.asarray(torch.as_tensor(x).cpu()) + zeros, end)
            for end in (self.engine.state, self.engine.goal)
        ]
        return tuple(scene.render(one.start, one.goal, shut) for one in each(Scenario(*ends)))

    def _within(self, observation: Tensor) -> Tensor:
        """Observations (N, width), contiguous, within the bounds of their space; see `within`."""
        return observation.clamp(-self._high, self._high).contiguous()

    def _stepped(self, actions: Tensor) -> Step:
        """Step (N, n) actions where episodes are not over; with NEXT_STEP the others begin new ones.

        With NEXT_STEP an environment that is over does not move in the step that begins its next episode.
        """
        if self.autoreset_mode == AutoresetMode.SAME_STEP:
            return self.engine.step(actions)
        held = self._over
        with self.engine.holding(held):
            step = self.engine.step(actions)
        return step._replace(
            observation=torch.where(held[:, None], self.engine.observe(), step.observation),
            reward=step.reward.masked_fill(held, 0.0),
            terminated=step.terminated & ~held,
            truncated=step.truncated & ~held,
            reached=step.reached & ~held,
            terms=step.terms.masked_fill(held, 0.0),
        )


def _mode(mode: AutoresetMode | str) -> AutoresetMode:
    """Gymnasium's mode of resets, by its name in any case (`ConfigError`)."""
    known = {x.name: x for x in (AutoresetMode.SAME_STEP, AutoresetMode.NEXT_STEP)}
    name = mode.name if isinstance(mode, AutoresetMode) else str(mode).upper()
    if name not in known:
        raise ConfigError(f"autoreset_mode must be one of {', '.join(known)}, got {brief(mode)}.")
    return known[name]
