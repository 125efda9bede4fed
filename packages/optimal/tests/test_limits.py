"""Limits of speed, spin and zones along optimal trajectories."""

import numpy as np
import pytest
from rans_optimal.limits import PathLimits
from rans_optimal.objectives import (
    MinimumFuel,
)
from rans_optimal.transcription import (
    Transcription,
)

from rans import Timing
from rans.model.drift import FREE
from rans.reference.flight import replay
from tests.support.problems import (
    PLATFORM,
    TASK,
    solved,
)
from tests.support.states import planar


@pytest.mark.slow
def test_limits_hold_between_periods_too():
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
