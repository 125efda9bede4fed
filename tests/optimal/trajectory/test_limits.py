"""Limits of speed, spin and zones along optimal trajectories."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from rans.model.drift import FREE
from rans.model.timing import Timing
from rans.optimal.trajectory.limits import PathLimits
from rans.optimal.trajectory.objectives import (
    MinimumFuel,
    MinimumTime,
)
from rans.optimal.trajectory.transcription import (
    Transcription,
)
from rans.reference.flight import replay
from rans.tasks import GoToPosition
from tests.support.crafts import deputy
from tests.support.problems import (
    PLATFORM,
    TASK,
    solved,
    spatial,
)
from tests.support.states import planar


@dataclass(frozen=True)
class SpeedLimit(GoToPosition):
    """0.2 m/s at most."""

    def constraints(self, state: Any, goal: Any) -> dict[str, Any]:
        return {"speed": 0.2 - state.v.norm()}


@pytest.mark.slow
def test_least_time_under_a_speed_limit_is_bang_coast_bang() -> None:
    """1/12 m/s^2 up to 0.2 m/s, coast, brake: distance / speed + speed / acceleration. Commands are held for
    a fiftieth of it, which costs part of one."""
    trajectory = solved(deputy(), MinimumTime(50), spatial(x=-3.0), spatial(), SpeedLimit())
    closed = 3.0 / 0.2 + 0.2 * 12.0
    assert closed * (1 - 1e-4) < trajectory.cost < closed * (1 + 0.02)


@pytest.mark.slow
def test_limits_hold_between_periods_too() -> None:
    """Straight ahead lies a ball, and 0.4 m/s is all there may be: both hold at four instants a period."""
    limits = PathLimits(speed=0.4, keep_out=((-1.5, 0.0, 0.4),))
    objective = MinimumFuel(14.0, 0.4)
    problem = Transcription(PLATFORM, TASK, objective, limits)
    free = solved(PLATFORM, objective, planar(x=-3.0, heading=0.5), planar())
    kept = problem.solve(planar(x=-3.0, heading=0.5), planar(), guesses=3)
    assert kept.solved
    assert kept.cost > free.cost
    timing = Timing(control_period=0.1, episode_steps=4 * len(kept.commands))
    states = replay(
        PLATFORM, planar(x=-3.0, heading=0.5), np.repeat(kept.commands, 4, axis=0), timing, FREE
    )
    assert np.hypot(states.p.x + 1.5, states.p.y).min() > 0.4 - 1e-4
    assert states.v.norm().max() < 0.4 + 1e-4
    through = replay(
        PLATFORM, planar(x=-3.0, heading=0.5), np.repeat(free.commands, 4, 0), timing, FREE
    )
    assert np.hypot(through.p.x + 1.5, through.p.y).min() < 0.4
