"""A controller of your own in one file: proportional and derivative gains, and valves that push the wanted way.

``python controller.py`` flies it beside LQR from the same 256 starts. Every command takes it by its name too,
in the folder of this file: ``rans compare controller:PD:go-to-pose-2d --with lqr switching``.
"""

from __future__ import annotations

from typing import Any

import numpy as np

import rans
from rans.tasks import Task


class PD:
    """Wants a force and a torque from position, velocity, heading and spin, and opens each valve that helps.

    Args:
        craft: on/off spacecraft in the plane.
        task: task that it flies, for controllers that ask for its limits.
        timing: control period and length of an episode.

    Raises:
        rans.ConfigError: the spacecraft moves in space.
    """

    name = "pd"

    def __init__(self, craft: rans.Spacecraft, task: Task, timing: rans.Timing) -> None:
        if craft.dimension != 2:
            raise rans.ConfigError(f"pd flies in the plane only, not {craft.name}.")
        # What one valve changes in a control period when it is open: velocity in B, m/s, and spin, rad/s.
        wrenches = np.array(craft.wrench_map)
        inertia = np.array((craft.mass, craft.mass, craft.inertia[2][2]))
        self._changes = wrenches / inertia * timing.control_period
        self._sizes = np.abs(self._changes).max(axis=0)

    def reset(self, count: int) -> None:
        """Forget what belongs to the last episodes; this controller remembers nothing."""

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """Commands (N, 8), 0 or 1, to states and goals of N spacecraft in W."""
        # Where the goal is and how fast it comes nearer, in W.
        away = np.stack((goal.p.x - state.p.x, goal.p.y - state.p.y))
        closing = np.stack((goal.v.x - state.v.x, goal.v.y - state.v.y))
        turn = goal.attitude.angle - state.attitude.angle
        turn = np.arctan2(np.sin(turn), np.cos(turn))
        # The velocity that is wanted: towards the goal, and slow enough to brake.
        speed = np.minimum(0.35, 0.5 * np.hypot(*away))
        velocity = away * speed / np.maximum(np.hypot(*away), 1e-9) + closing
        spin = np.clip(0.7 * turn, -0.5, 0.5) - state.w
        # In the body frame, and in what one valve does; a valve opens if half of its effect or more is wanted.
        cosine, sine = np.cos(state.attitude.angle), np.sin(state.attitude.angle)
        ahead = cosine * velocity[0] + sine * velocity[1]
        left = cosine * velocity[1] - sine * velocity[0]
        wanted = np.stack((ahead, left, spin)) / self._sizes[:, None]
        return ((self._changes / self._sizes) @ wanted).T > 1.0


if __name__ == "__main__":
    for contestant in ("controller:PD:go-to-pose-2d", "lqr:go-to-pose-2d"):
        metrics = rans.evaluate(contestant, episodes=256)
        figures = ("solved", "settling time", "impulse")
        print(contestant, ", ".join(f"{name} {metrics[name].value:.3g}" for name in figures))
