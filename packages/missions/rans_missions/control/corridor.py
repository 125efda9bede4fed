"""Guidance through the corridor of a port: along the port's axis, which may turn, by LQR."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from rans.extend import leaves
from rans_missions.control.velocity_guidance import VelocityGuidance
from rans_missions.guidance.along_axis import AlongAxis
from rans_missions.tasks.final_approach import FinalApproach
from rans_missions.vectors import motion_of

_FASTEST = 0.2
"""Greatest speed along the axis, m/s."""
_SLOWING = 0.0025
"""Increase of the speed along the axis per metre of distance from the port, 1/s."""


class Corridor(VelocityGuidance[FinalApproach]):
    """Flies through the corridor of a port, which may turn with its target, and stays there.

    >>> rans.Corridor("vbar-chaser", "final-approach")
    <corridor: FinalApproach for vbar-chaser>

    A reference begins beside the craft on the axis of the port, and moves along it at half of the speed of contact
    that the task allows and 2.5 mm/s more per metre, at most 0.2 m/s. LQR keeps the craft at the reference
    (`rans_missions.guidance.along_axis.AlongAxis`). It needs exact states.

    Args:
        craft: by name, TOML file or as such.
        task: a `rans_missions.tasks.final_approach.FinalApproach`, or its name.
        timing: control period, and length of the episode; None: the task's.

    Raises:
        ConfigError: the task is no final approach.
    """

    name = "corridor"
    mission = FinalApproach
    purpose = "the corridor guidance flies final approaches"

    @cached_property
    def _law(self) -> AlongAxis:
        """LQR that keeps the craft at their references."""
        return AlongAxis(self.task.mean_motion, self._period)

    def reset(self, count: int) -> None:
        """See `rans.flight.Controller`."""
        super().reset(count)
        self._law.reset()

    def velocity_change(self, state: Any, goal: Any, now: float) -> tuple[np.ndarray, np.ndarray]:
        """Changes of velocity (N, 3), m/s, and which rows burn, here all in every period; see the base."""

        def line(time: float) -> tuple[np.ndarray, np.ndarray]:
            port = self.task.later(goal, time)
            return np.stack(leaves(port.p), axis=1), np.stack(leaves(self.task.axis(port)), axis=1)

        def speed(distance: np.ndarray) -> np.ndarray:
            contact = 0.5 * self.task.velocity_tolerance
            return np.minimum(contact + _SLOWING * np.maximum(distance, 0.0), _FASTEST)

        rows = motion_of(state)
        change = self._law.change(rows, line, speed, nearest=0.0)
        return change, np.ones(len(rows), bool)
