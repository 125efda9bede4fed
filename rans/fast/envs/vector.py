"""Many spacecraft as one Gymnasium vector environment: torch tensors in and out, on one device."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import torch
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from torch import Tensor

from rans.environment import action_space, checked_render_mode, choose, observation_space
from rans.errors import ConfigError
from rans.fast.engine import Engine
from rans.model.conditions import Conditions
from rans.model.fields import leaves, unflatten
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from rans.tasks import Task
from rans.tasks.sight import Dimension

_WIDTH, _HEIGHT = 320, 240
"""Of a frame, pixels."""
_SHOWN = 16
"""Most environments in the window."""


class SpacecraftVectorEnv(VectorEnv[Tensor, Tensor, Tensor]):
    """An `Engine` seen through Gymnasium's interface.

    Made by ``gymnasium.make_vec("rans/GoToPose2D-v0", num_envs=4096)``. For wrappers that want NumPy
    arrays use ``gymnasium.wrappers.vector.ArrayConversion(env, torch, numpy)``.

    One seed serves the whole batch: environment i flies episodes i, i + N, i + 2 N, ... of it, and episode k
    is the same whatever N is, here and in `SpacecraftEnv`. Episodes restart in the step that ends them
    (``AutoresetMode.SAME_STEP``). Nothing waits for the device, so every step's ``info`` has the same keys,
    tensors whose masks say where they count: "final_obs" (N, width) and "final_info" {"is_success": (N,)}
    under "_final_obs" and "_final_info", and "reward_terms" {name: (N,)} everywhere.

    Args:
        num_envs: N, number of spacecraft stepped together.
        task_name: of `rans.tasks.TASKS`, or MODULE:NAME.
        dimension: 2 (plane) or 3 (space).
        spacecraft: name, TOML file or object; None: the usual one of this dimension.
        task: settings; None: the defaults.
        timing: see `Engine`, as device, dtype and compiled.
        conditions: what episodes do not promise; None: a perfect world.
        render_mode: None; "rgb_array": `render` gives a frame of every environment; "human": every `reset`
            and `step` shows the first 16 in the browser, at real time (see `rans.window.Window`).

    Raises:
        ConfigError: one of these does not exist or does not fit the others.
    """

    metadata = {"autoreset_mode": AutoresetMode.SAME_STEP,  # noqa: RUF012  (Gymnasium's)
                "render_modes": ["human", "rgb_array"], "render_fps": 5}

    def __init__(self, num_envs: int, task_name: str, dimension: Dimension, *,
                 spacecraft: str | Path | Spacecraft | None = None, task: Task | None = None,
                 timing: Timing | None = None, device: str | torch.device = "cpu",
                 dtype: torch.dtype = torch.float32, compiled: bool | None = None,
                 render_mode: str | None = None, conditions: Conditions | None = None) -> None:
        self.render_mode = checked_render_mode(render_mode)
        craft, task = choose(task_name, dimension, spacecraft, task)
        self.engine = Engine(craft, task, num_envs, timing, device=device, dtype=dtype, compiled=compiled,
                             conditions=conditions)
        self.num_envs, self.device = num_envs, self.engine.device
        width = np.float32 if dtype == torch.float32 else np.float64
        self.single_observation_space = observation_space(task, dimension, width)
        self.single_action_space = action_space(craft)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._seeded = False
        self.metadata = {**self.metadata, "render_fps": 1.0 / self.engine.timing.control_period}
        self._film = None if render_mode is None else Film(self.engine, render_mode)

    def reset(self, *, seed: int | None = None,
              options: dict[str, Any] | None = None) -> tuple[Tensor, dict[str, Any]]:
        """Start a new episode everywhere; the observation is (N, width).

        Episodes count from 0 under a given seed; by default they go on counting, or at first under a random
        one. ConfigError where the seed is a list, or there are options.
        """
        if options:
            raise ConfigError(f"reset has no options here, got {options!r}.")
        if seed is not None and not isinstance(seed, int):
            raise ConfigError(f"the seed must be one whole number for the whole batch, got {seed!r}.")
        super().reset(seed=seed)
        if seed is None and not self._seeded:
            seed = int(self.np_random.integers(2**63))
        self._seeded = True
        observation = self.engine.reset(seed)
        if self._film is not None:
            self._film.restart()
        return observation, {}

    def step(self, actions: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor, dict[str, Any]]:
        """Hold the thrusters for one control period.

        Args:
            actions: (N, thrusters), 0 (shut) or 1 (open); a tensor of any dtype or an array.

        Returns:
            Observation (N, width), reward (N,), terminated and truncated (N,) bool, and the class's info.

        Raises:
            ConfigError: the actions have another shape.
            gymnasium.error.ResetNeeded: there was no `reset` yet.
        """
        self._require_reset()
        actions = torch.as_tensor(actions, device=self.device)
        step = self.engine.step(actions)
        ended = step.terminated | step.truncated
        if self._film is not None:
            self._film.advance(actions, ended)
        info = {"reward_terms": dict(zip(self.engine.term_names, step.terms, strict=True)),
                "final_obs": step.final_observation, "_final_obs": ended,
                "final_info": {"is_success": step.reached & step.truncated}, "_final_info": ended}
        return step.observation, step.reward, step.terminated, step.truncated, info

    def render(self) -> Any:
        """A frame (240, 320, 3) uint8 of every environment in the mode "rgb_array"; first comes `reset`."""
        self._require_reset()
        return self._film.frames() if self._film is not None and self.render_mode == "rgb_array" else None

    def _require_reset(self) -> None:
        if not self._seeded:
            raise ResetNeeded("call reset() before step() and render().")

    def close_extras(self, **_: Any) -> None:
        """Close the window, if there is one."""
        if self._film is not None:
            self._film.close()


class Film:
    """Follows the spacecraft of an engine and draws them, see `SpacecraftVectorEnv`."""

    def __init__(self, engine: Engine, render_mode: str) -> None:
        from rans.drawing import Scene
        from rans.window import Window

        shown = render_mode == "human"
        self._engine, self._count = engine, min(engine.num_envs, _SHOWN) if shown else engine.num_envs
        self._scene = Scene(engine.craft, engine.task, _WIDTH, _HEIGHT)
        self._window = Window(1.0 / engine.timing.control_period) if shown else None

    def restart(self) -> None:
        """New episodes began everywhere."""
        self._commands = np.zeros((self._count, len(self._engine.craft.thrusters)))
        self._trails: list[list[np.ndarray]] = [[] for _ in range(self._count)]
        self._remember()

    def advance(self, actions: Tensor, ended: Tensor) -> None:
        """The engine took these actions (N, thrusters); where ``ended``, (N,) bool, a new episode began."""
        fresh = ended[:self._count].cpu().numpy()
        self._commands = np.where(fresh[:, None], 0.0, actions[:self._count].cpu().numpy())
        for index in np.flatnonzero(fresh):
            self._trails[index] = []
        self._remember()

    def frames(self) -> tuple[np.ndarray, ...]:
        """A frame (240, 320, 3) uint8 of every environment that is filmed."""
        given, filmed = self._engine, zip(self._states, self._rows(self._engine.goal), self._commands,
                                          self._trails, strict=True)
        return tuple(self._scene.render(unflatten(given.state, state), unflatten(given.goal, goal), command,
                                        np.array(trail[:-1])) for state, goal, command, trail in filmed)

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._window is not None:
            self._window.close()
            self._window = None

    def _remember(self) -> None:
        self._states = self._rows(self._engine.state)
        for trail, state in zip(self._trails, self._states, strict=True):
            trail.append(state[:self._engine.craft.dimension])
        if self._window is not None:
            from rans.window import tiled

            self._window.show(tiled(list(self.frames())))

    def _rows(self, states: Any) -> np.ndarray:
        """Fields as rows, (filmed, fields) float64; the position comes first."""
        columns = [np.atleast_1d(torch.as_tensor(x).cpu().numpy())[:self._count] for x in leaves(states)]
        return np.stack(np.broadcast_arrays(*columns), axis=1, dtype=np.float64)
