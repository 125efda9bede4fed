"""Checks and conversion of actions from other libraries, as in the single environment."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor

from rans.base.errors import ConfigError
from rans.base.inputs import array, dense
from rans.effectors.commands import allowed, check_commands, command_bounds, limits
from rans.fast.engine import Engine


class Actions:
    """Checker of actions for an engine that does not synchronise with a GPU.

    On a GPU a wrong action is reported by a later call, usually the next.
    """

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self._shape = (engine.num_envs, engine.craft.command_count)
        self._limits = [
            torch.as_tensor(limit, device=engine.device) for limit in limits(engine.craft)
        ]
        self._bounds = [
            torch.as_tensor(bound, device=engine.device) for bound in command_bounds(engine.craft)
        ]
        self._found = torch.zeros((), dtype=torch.bool, device=engine.device)
        """Whether any action was wrong."""
        self._wrong = torch.zeros((), dtype=torch.bool, pin_memory=engine.device.type == "cuda")
        self._done: torch.cuda.Event | None = None

    def checked(self, actions: Any) -> Tensor:
        """Actions (N, commands) on the engine's device, without gradients, in a dtype that it supports.

        Raises:
            ConfigError: the actions have another shape or type, or are out of range.
        """
        action = dense(actions)
        if not isinstance(action, Tensor):
            action = self._tensor(array("actions", action))
        action = action.to(self._engine.device)
        if action.is_floating_point() and action.dtype not in (torch.float32, torch.float64):
            action = action.float()  # exact for half precision
        if tuple(action.shape) != self._shape:
            return action  # the engine rejects them
        if action.is_complex():
            self._refuse(action.cpu().numpy())
        possible = self._possible(action)
        taken = action
        if self._engine.craft.is_continuous and action.is_floating_point():
            taken = action.clamp(*self._bounds).to(action.dtype)  # which leaves NaN to be refused
        if action.device.type != "cuda":
            if not possible:
                self._refuse(action.numpy())
        elif not torch.cuda.is_current_stream_capturing():
            self._remember(possible)
        return taken

    def _possible(self, action: Tensor) -> Tensor:
        """Whether all of an action (N, n) is in range, as a tensor, so that the device is not waited for."""
        craft = self._engine.craft
        if not craft.is_continuous:
            return ((action == 0) | (action == 1)).all()
        low, high = self._limits
        within = ((action >= low) & (action <= high)).all()
        if craft.actuators.is_continuous:
            return within
        chosen = action[:, craft.thruster_commands]
        return within & ((chosen == 0) | (chosen == 1)).all()

    def _tensor(self, action: np.ndarray) -> Tensor:
        """Tensor of an array, copied if the array is read-only or not contiguous."""
        if action.dtype.kind not in "biufc":
            self._refuse(action)
        return torch.from_numpy(np.require(action, requirements=["C", "W"]))

    def _refuse(self, action: np.ndarray) -> None:
        check_commands(self._engine.craft, action, self._shape[0])

    def _remember(self, possible: Tensor) -> None:
        """Note actions out of range on the device; nobody waits, so that a later call raises the error.

        Where a copy is still under way, the next call asks again.
        """
        self._found |= ~possible
        if self._done is not None:
            if not self._done.query():
                return
            if self._wrong:
                self._done = None
                self._found.zero_()
                raise ConfigError(
                    "an earlier action was out of the craft's ranges: "
                    f"{allowed(self._engine.craft)}."
                )
        self._wrong.copy_(self._found, non_blocking=True)
        self._done = torch.cuda.Event()
        self._done.record()
