"""Pictures of many environments: a frame of each, and the window that shows the first of them."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor

from rans.fast.engine import Engine
from rans.model.fields import leaves, unflatten

_WIDTH, _HEIGHT = 320, 240
"""Of a frame, pixels."""
_SHOWN = 16
"""Most environments in the window."""


class Film:
    """Follows the spacecraft of an engine and draws them.

    Args:
        engine: what is filmed.
        render_mode: "rgb_array": everything is drawn, by `frames`; "human": the first 16 environments are
            shown in a window after every `restart` and `advance`.
    """

    def __init__(self, engine: Engine, render_mode: str) -> None:
        from rans.drawing import Scene

        self._engine = engine
        self._count = engine.num_envs if render_mode == "rgb_array" else min(engine.num_envs, _SHOWN)
        self._scene, self._window = Scene(engine.craft, engine.task, _WIDTH, _HEIGHT), None
        if render_mode == "human":
            from rans.window import Window

            self._window = Window(1.0 / engine.timing.control_period)

    def restart(self) -> None:
        """New episodes began everywhere."""
        self._commands = np.zeros((self._count, len(self._engine.craft.thrusters)))
        self._trails: list[list[np.ndarray]] = [[] for _ in range(self._count)]
        self._remember()

    def advance(self, actions: Tensor, ended: Tensor) -> None:
        """The engine took one step.

        Args:
            actions: (N, thrusters) that it took.
            ended: (N,) bool: a new episode began.
        """
        fresh = ended[:self._count].cpu().numpy()
        self._commands = np.where(fresh[:, None], 0.0, actions[:self._count].cpu().numpy())
        for index in np.flatnonzero(fresh):
            self._trails[index] = []
        self._remember()

    def frames(self) -> tuple[np.ndarray, ...]:
        """A frame (240, 320, 3) uint8 of every environment that is filmed."""
        goals = self._rows(self._engine.goal)
        return tuple(
            self._scene.render(unflatten(self._engine.state, state), unflatten(self._engine.goal, goal),
                               command, np.array(trail[:-1]))
            for state, goal, command, trail in zip(self._states, goals, self._commands, self._trails,
                                                   strict=True))

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
