"""Actions as other libraries give them, refused or converted as the single environment does."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor

from rans.effectors.commands import allowed, check, limits
from rans.environment import array, dense
from rans.errors import ConfigError
from rans.fast.engine import Engine


class Actions:
    """Checks actions for an engine's thrusters without making a GPU wait.

    There a wrong action is told by the first later call that finds it checked, usually the next.
    """

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self._shape = (engine.num_envs, len(engine.craft.commands))
        self._limits = [
            torch.as_tensor(limit, device=engine.device) for limit in limits(engine.craft)
        ]
        self._found = torch.zeros((), dtype=torch.bool, device=engine.device)
        """Whether any was wrong."""
        self._wrong = torch.zeros((), dtype=torch.bool, pin_memory=engine.device.type == "cuda")
        self._done: torch.cuda.Event | None = None

    def checked(self, actions: Any) -> Tensor:
        """Actions (N, commands) on the engine's device, without gradients, in a dtype that it knows.

        Raises:
            ConfigError: they have another shape or kind, or the craft cannot follow them.
        """
        given = dense(actions)
        if not isinstance(given, Tensor):
            given = self._tensor(array(given))
        given = given.to(self._engine.device)
        if given.is_floating_point() and given.dtype not in (torch.float32, torch.float64):
            given = given.float()  # exactly: from half precision
        if tuple(given.shape) != self._shape:
            return given  # which the engine refuses
        if given.is_complex():
            self._refuse(given.cpu().numpy())
        possible = self._possible(given)
        if given.device.type != "cuda":
            if not possible:
                self._refuse(given.numpy())
        elif not torch.cuda.is_current_stream_capturing():
            self._remember(possible)
        return given

    def _possible(self, given: Tensor) -> Tensor:
        craft = self._engine.craft
        if not craft.is_continuous:
            return ((given == 0) | (given == 1)).all()
        low, high = self._limits
        within = ((given >= low) & (given <= high)).all()
        if craft.actuators.is_continuous:
            return within
        chosen = given[:, : len(craft.thrusters)]
        return within & ((chosen == 0) | (chosen == 1)).all()

    def _tensor(self, given: np.ndarray) -> Tensor:
        """The same numbers, copied where torch takes no such array or warns of it: one that is read-only."""
        if given.dtype.kind not in "biufc":
            self._refuse(given)
        return torch.from_numpy(np.require(given, requirements=["C", "W"]))

    def _refuse(self, given: np.ndarray) -> None:
        check(self._engine.craft, given, self._shape[0])

    def _remember(self, possible: Tensor) -> None:
        self._found |= ~possible
        if self._done is not None:
            if not self._done.query():
                return
            if self._wrong:
                self._done = None
                self._found.zero_()
                raise ConfigError(
                    "an action of before was not what the craft takes: "
                    f"{allowed(self._engine.craft)}."
                )
        self._wrong.copy_(self._found, non_blocking=True)
        self._done = torch.cuda.Event()
        self._done.record()
