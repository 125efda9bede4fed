"""The pool answers as one process would, and neither a dead worker nor Ctrl-C hangs it."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Any

import pytest
from rans_optimal.objectives import MinimumTime, SymbolicTrajectory
from rans_optimal.pool import solve_all

from rans import GoToPose
from rans.episode.scenario import scenarios
from rans.model.spacecraft_file import load_spacecraft

PLATFORM = load_spacecraft("floating-platform")
TASK = GoToPose(spawn_distance=(3.0, 4.0))


@dataclass(frozen=True)
class Fatal(MinimumTime):
    """Kills the process that tries to solve it."""

    def cost(self, path: SymbolicTrajectory) -> Any:
        os._exit(9)


@pytest.mark.slow
def test_dead_worker_is_a_status():
    starts = scenarios(TASK, PLATFORM, 3, 4)
    answers = solve_all(PLATFORM, TASK, Fatal(10), starts, workers=2)
    assert [a.status for a in answers] == ["Worker_Died"] * 4
    assert not any(a.solved for a in answers)
    assert answers[0].commands.shape == (10, 8)
