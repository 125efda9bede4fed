"""Guidance through the corridor of a port: along the port's axis, which may turn, by LQR."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.linalg import solve_discrete_are

from rans.extend import leaves
from rans_missions.control.velocity_guidance import VelocityGuidance
from rans_missions.orbits.linear import held, transition
from rans_missions.tasks.final_approach import FinalApproach
from rans_missions.vectors import motion_of

_FASTEST = 0.2
"""Greatest speed along the axis, m/s."""
_SLOWING = 0.0025
"""Increase of the speed along the axis per metre of distance from the port, 1/s."""
_QUICKENING = 0.004
"""Acceleration of the reference, m/s^2: a fifth of what the thrusters of V-BAR's craft give."""
_HALF = 0.5
"""Half of the time over which the velocity of the reference is a difference, s."""
_WEIGHTS = np.diag([1.0, 1.0, 1.0, 400.0, 400.0, 400.0])
"""Errors of 1 m count as much as those of 5 cm/s, and as a change of 1.6 cm/s in a period."""
_PRICE = 4e3 * np.eye(3)


class Corridor(VelocityGuidance[FinalApproach]):
    """Flies through the corridor of a port, which may turn with its target, and stays there.

    >>> rans.Corridor("vbar-chaser", "final-approach")
    <corridor: FinalApproach for vbar-chaser>

    A reference begins beside the craft on the axis of the port, and moves along it at half of the speed of contact
    that the task allows and 2.5 mm/s more per metre, at most 0.2 m/s. LQR keeps the craft at the reference. It
    needs exact states.

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

    def reset(self, count: int) -> None:
        """See `rans.episode.flight.Controller`."""
        super().reset(count)
        self._distance: np.ndarray | None = None
        """Distance of every reference from its port, (N,), m; None before the first change."""
        self._fastest = np.zeros(1)
        """Speed that every reference has reached, (N,), m/s."""
        self._past = np.zeros(1)
        """Speed of every reference towards its port in the last period, (N,), m/s."""
        # Motion over a control period, and what a change of velocity that is spread over it adds.
        self._a = transition(self.task.drift, self._period)
        self._b = held(self.task.drift, self._period) / self._period
        gain = self._b.T @ solve_discrete_are(self._a, self._b, _WEIGHTS, _PRICE)
        self._gain = np.linalg.solve(_PRICE + gain @ self._b, gain @ self._a)

    def velocity_change(self, state: Any, goal: Any, now: float) -> tuple[np.ndarray, np.ndarray]:
        """Changes of velocity (N, 3), m/s, and which rows burn, here all in every period; see the base.

        Call it once a period: the references move on.
        """
        states = motion_of(state)
        before = self._distance
        if before is None:
            axis = np.stack(leaves(self.task.axis(goal)), axis=1)
            before = ((states[:, :3] - np.stack(leaves(goal.p), axis=1)) * axis).sum(axis=1)
        # Its speed increases slowly enough for the thrusters to follow, and it stops at the port.
        advised = 0.5 * self.task.velocity_tolerance + _SLOWING * np.maximum(before, 0.0)
        faster = self._fastest + _QUICKENING * self._period
        fastest = np.minimum(np.minimum(advised, _FASTEST), faster)
        after = np.maximum(before - fastest * self._period, 0.0)
        present = self._reference(goal, 0.0, before, self._past)
        self._past = (before - after) / self._period
        later = self._reference(goal, self._period, after, self._past)
        self._distance, self._fastest = after, fastest
        # The change that leads from reference to reference, and the feedback of the error.
        ahead = (later - present @ self._a.T) @ np.linalg.pinv(self._b).T
        return ahead - (states - present) @ self._gain.T, np.ones(len(states), bool)

    def _reference(self, goal: Any, time: float, distance: np.ndarray, speed: Any) -> np.ndarray:
        """States (N, 6) a time, s, from now on the ports' axes, at distances, m, and speeds towards ports, m/s.

        A central difference over `_HALF` gives the velocity of a point at rest on an axis that turns.
        """
        places = []
        for instant in (time - _HALF, time, time + _HALF):
            port = self.task.later(goal, instant)
            axis = np.stack(leaves(self.task.axis(port)), axis=1)
            places.append(np.stack(leaves(port.p), axis=1) + distance[:, None] * axis)
        behind, place, ahead = places
        axis = np.stack(leaves(self.task.axis(self.task.later(goal, time))), axis=1)
        moving = (ahead - behind) / (2.0 * _HALF) - speed[:, None] * axis
        return np.concatenate([place, moving], axis=1)
