"""One spacecraft moved by Drake, as a Gymnasium environment."""

from __future__ import annotations

from typing import Any

import numpy as np

from rans.environment import Environment
from rans.reference.flight import rows_from_states, states_from_rows
from rans.reference.plant import Plant


class DrakeEnv(Environment):
    """`Environment` whose motion an independent judge computes.

    Made by ``gymnasium.make("rans/GoToPose2D-Drake-v0")``. It flies the same episodes as
    `rans.fast.SpacecraftEnv`, observes, rewards and ends them in the same way, and needs about a
    millisecond a step. Its motion is as accurate as `Plant` is: ``timing.substeps`` does not concern it.

    Raises:
        ConfigError: see `Environment`; or Drake refuses the spacecraft's mass properties.
    """

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._plant = Plant(self.craft)

    def _moved(self, state: Any, command: tuple[float, ...]) -> Any:
        rows = self._plant.advance(rows_from_states(state)[None], np.array([command]),
                                   self.timing.control_period)
        return states_from_rows(rows[0], state).normalised()
