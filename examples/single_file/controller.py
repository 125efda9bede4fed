"""A controller of your own in one file: proportional and derivative gains, and valves that push the wanted way.

``python controller.py`` flies it beside LQR from the same 256 starts. Every command takes it by its name too,
in the folder of this file: ``rans compare controller:PD:go-to-pose-2d --with lqr switching``, and
``rans view controller:PD:go-to-pose-2d --play --save fly.html`` writes a page in which it flies.
"""

from __future__ import annotations

from typing import Any

import numpy as np

import rans
from rans.extend import Task, sqrt, where, within


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
        changes = wrenches / inertia * timing.control_period
        # A valve opens if half of its effect or more is wanted, in units of the largest effects.
        self._gains = (changes / np.abs(changes).max(axis=0) ** 2).tolist()

    def reset(self, count: int) -> None:
        """Forget what belongs to the last episodes; this controller remembers nothing."""

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """Commands (N, 8), 0 or 1, to states and goals of N spacecraft in W."""
        return np.stack(np.broadcast_arrays(*self.command(state, goal)), axis=1)

    def command(self, state: Any, goal: Any) -> tuple[Any, ...]:
        """A command of each valve, as arithmetic on fields alone: NumPy's arrays, or what a page prints.

        A controller without this method flies in every command as well, but not in a page.
        """
        # The velocity that is wanted: towards the goal, and slow enough to brake.
        way = goal.p - state.p
        distance = sqrt(way.dot(way) + 1e-18)
        velocity = way.scale(within(0.5 * distance, 0.0, 0.35) / distance) + goal.v
        turn = state.attitude.to(goal.attitude).normalised().angle
        spin = within(0.7 * turn, -0.5, 0.5) - state.w
        # In the body frame, and in what each valve does.
        along = state.attitude.inverse().rotate(velocity - state.v)
        wanted = (
            ahead * along.x + left * along.y + about * spin for ahead, left, about in self._gains
        )
        return tuple(where(x > 1.0, 0.0 * x + 1.0, 0.0 * x) for x in wanted)


if __name__ == "__main__":
    for contestant in ("controller:PD:go-to-pose-2d", "lqr:go-to-pose-2d"):
        metrics = rans.evaluate(contestant, episodes=256)
        figures = ("solved", "settling time", "impulse")
        print(contestant, ", ".join(f"{name} {metrics[name].value:.3g}" for name in figures))
