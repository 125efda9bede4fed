"""One spacecraft moved by the equations that all engines share, as a Gymnasium environment."""

from __future__ import annotations

from typing import Any

from rans.environment import Environment
from rans.model.body import Body
from rans.model.dynamics import held


class SpacecraftEnv(Environment):
    """`Environment` for debugging, pictures and other libraries' algorithms.

    Made by ``gymnasium.make("rans/GoToPose2D-v0")``. It flies the same episodes as one environment of
    `rans.fast.SpacecraftVectorEnv`, and as `rans.reference.env.DrakeEnv`.
    """

    def _moved(self, state: Any, command: tuple[float, ...]) -> Any:
        return held(state, self.craft, Body.of(self.craft), command, self.timing)
