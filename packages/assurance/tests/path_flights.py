"""Flights along a path: by a tracker without training, and by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
from rans_assurance.follow.follow import Following, Progress, fly_path
from rans_assurance.follow.paths import LookAhead, Path

from rans.flight import Flight
from rans.model.dynamics import PlanarState
from rans.model.fields import Heading, Vec2
from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import load_spacecraft
from rans.model.timing import Timing
from rans.tasks import TrackVelocity

PLATFORM = load_spacecraft("floating-platform")
FLYER = load_spacecraft("free-flyer")
LINE = Path.through("line", np.array([(0.0, 0.0), (2.0, 0.0)]), closed=False)


class Tracker:
    """Opens all nozzles that push along the velocity still to gain; they come in pairs that do not turn.

    A pair changes the velocity by 2 * 1 N * 0.2 s / 5.32 kg = 0.075 m/s: it is opened from half of that.
    """

    name = "pairs"

    def __init__(self, craft: Spacecraft) -> None:
        self.directions = np.array([t.direction for t in craft.thrusters])

    def reset(self, count: int) -> None: ...

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        gain = np.stack((goal.v - state.v).columns(), axis=1)
        axes = [state.attitude.rotate(type(state.p)(*unit)) for unit in np.eye(gain.shape[1])]
        body = np.stack([(gain * np.stack(a.columns(), axis=1)).sum(axis=1) for a in axes], axis=1)
        return (body @ self.directions[:, : body.shape[1]].T > 0.0376).astype(float)


def flown(planner: LookAhead, craft: Spacecraft = PLATFORM, count: int = 4) -> Following:
    return fly_path(craft, TrackVelocity(), Tracker(craft), planner, Timing(), seed=5, count=count)


def by_hand() -> Following:
    """Two flights along the line with a radius of 0.1 m: 0.4 m of approach, the last 1.6 m count.

    One takes 0.4 m a period, 3 cm and then 4 cm beside the line. The other never leaves the approach.
    """
    x = np.array([[0.0, 0.4, 0.8, 1.2, 1.6, 2.0, 2.0], [0.0, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1]]).T
    y = np.array([[0.9, 0.03, 0.03, 0.04, 0.04, 0.9, 0.9], [0.9, 0.9, 0.9, 0.9, 0.9, -0.2, 0.9]]).T
    speed = np.array([[9.0, 9.0, 0.5, 0.5, 0.3, 0.3, 9.0], [9.0, 9.0, 9.0, 9.0, 9.0, 9.0, 0.8]]).T
    zero = np.zeros((7, 2))
    states = PlanarState(Vec2(x, y), Heading(zero), Vec2(speed, zero), zero)
    point = np.round(x / 0.005).astype(int)
    goals = PlanarState(
        Vec2(zero, zero), Heading(zero), Vec2(zero + 0.4, zero), zero, Progress(point)
    )
    thrusters = np.zeros((6, 2, 8))
    thrusters[1:3, 0, :4] = 1.0
    timing = Timing(control_period=0.5, episode_steps=6)
    flight = Flight(PLATFORM, TrackVelocity(), timing, states, goals, thrusters, "by hand")
    return Following(LookAhead(LINE, speed=0.4, radius=0.1), flight)
