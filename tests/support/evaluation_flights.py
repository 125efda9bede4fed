"""Flights built by hand, whose every metric can be worked out on paper."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from rans import GoToPose, Timing
from rans.episode.flight import Flight
from rans.model.dynamics import PlanarState
from rans.model.fields import Heading, Vec2
from rans.model.spacecraft_file import load_spacecraft

GOAL_HEADING = math.radians(175.0)
"""Errors of more than 5 degrees cross the jump of the heading from 180 to -180 degrees."""


def flight_of(
    distance: Any,
    error_degrees: Any,
    commands: np.ndarray | None = None,
    speed: tuple[float, float] = (0.0, 0.0),
    spin: float = 0.0,
    task: Any = None,
    craft: str = "floating-platform",
) -> Flight:
    """Episodes on the negative x axis of the goal.

    Args:
        distance: (T + 1, N) m.
        error_degrees: heading error, broadcast to the same.
        commands: (T, N, 8), all shut by default.
        speed: velocity at every instant of the first episode, m/s; the others rest.
        spin: the same for the angular velocity, rad/s.
        task: go to pose by default.
        craft: a planar spacecraft.
    """
    distance = np.asarray(distance, dtype=float)
    first = np.zeros_like(distance)
    first[:, 0] = 1.0
    angle = np.broadcast_to(GOAL_HEADING + np.radians(error_degrees), distance.shape)
    states = PlanarState(
        Vec2(2.0 - distance, -1.0 + 0.0 * distance),
        Heading(angle),
        Vec2(speed[0] * first, speed[1] * first),
        spin * first,
    ).normalised()
    still = np.zeros(distance.shape[1])
    goals = PlanarState(
        Vec2(2.0 + still, -1.0 + still), Heading(GOAL_HEADING + still), Vec2(still, still), still
    )
    if commands is None:
        commands = np.zeros((len(distance) - 1, distance.shape[1], 8))
    return Flight(
        load_spacecraft(craft),
        task or GoToPose(),
        Timing(control_period=0.5, episode_steps=len(distance) - 1),
        states,
        goals,
        commands,
        "by hand",
    )


def two_episodes() -> Flight:
    """Ten steps of half a second: one episode that settles, one that leaves at the last step."""
    first = [1.0, 0.5, 0.2, 0.04, 0.04, 0.015, 0.015, 0.04, 0.008, 0.004, 0.004]
    second = [0.04] * 9 + [0.03, 0.06]
    turning = [10.0, 10.0, 6.0, 6.0, 6.0, 4.0, 3.0, 1.5, 0.5, 0.5, 0.5]
    commands = np.zeros((10, 2, 8))
    commands[:4, 0, 0] = 1.0
    return flight_of(
        np.transpose([first, second]),
        np.transpose([turning, [0.0] * 11]),
        commands,
        speed=(0.3, -0.4),
        spin=-0.2,
    )


def many_episodes(count: int, steps: int = 125) -> Flight:
    """Distances that decay at different rates, with random commands."""
    generator = np.random.default_rng(3)
    time = np.linspace(0.0, 5.0, steps + 1)[:, None]
    distance = 3.5 * np.exp(-time * generator.uniform(0.5, 2.0, count))
    commands = (generator.random((steps, count, 8)) < 0.2).astype(float)
    return flight_of(distance, 90.0 * np.exp(-time), commands)


@dataclass(frozen=True)
class TrackNothing(GoToPose):
    """A task whose errors are those of velocity and spin, towards rest."""

    def errors(self, state: Any, goal: Any) -> dict[str, Any]:
        return {"velocity": (goal.v - state.v).norm(), "spin": abs(goal.w - state.w)}

    def tolerances(self) -> dict[str, float]:
        return {"velocity": 0.1, "spin": 0.1}

    def reward(self, transition: Any) -> dict[str, Any]:
        return {"velocity": -self.errors(transition.state, transition.goal)["velocity"]}
