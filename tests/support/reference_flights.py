"""Flights to look at, of the LQR and by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rans import Timing
from rans.episode.flight import Flight
from rans.model.dynamics import SpatialState
from rans.model.fields import Quat, Vec3
from rans.model.spacecraft_file import load_spacecraft
from rans.tasks import Task, TrackVelocityHeading

FLYER = load_spacecraft("free-flyer")


def drifting(task: Task, speed: float = 0.5, steps: int = 10) -> Flight:
    """One spacecraft coasting along x without turning; thruster 11 opens in the second period."""
    zeros = np.zeros((steps + 1, 1))
    ones = np.ones((steps + 1, 1))
    x = 0.2 * speed * np.arange(steps + 1.0)[:, None]
    states = SpatialState(
        Vec3(x, zeros, zeros),
        Quat(ones, zeros, zeros, zeros),
        Vec3(zeros + speed, zeros, zeros),
        Vec3(zeros, zeros, zeros),
    )
    one = lambda value: np.array([value])  # noqa: E731
    half_turn = Quat(one(0.0), one(0.0), one(0.0), one(1.0))  # about z
    still = Vec3(one(0.0), one(0.0), one(0.0))
    far = Vec3(one(9.0), one(9.0), one(9.0))
    goal = SpatialState(far, half_turn, replace(still, y=one(0.25)), still)
    commands = np.zeros((steps, 1, len(FLYER.thrusters)))
    commands[1, 0, 11] = 1.0
    return Flight(FLYER, task, Timing(episode_steps=steps), states, goal, commands, "nobody")


TRACKING = TrackVelocityHeading()
