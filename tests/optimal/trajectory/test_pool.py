"""The pool answers as one process would, and neither a dead worker nor Ctrl-C hangs it."""

from __future__ import annotations

import os
import signal
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from rans.model.spacecraft_file import load_spacecraft
from rans.optimal.trajectory.objectives import MinimumFuel, MinimumTime, SymbolicTrajectory
from rans.optimal.trajectory.pool import solve_all
from rans.scenario import scenarios
from rans.tasks import GoToPose
from tests.support.processes import PATIENCE, python

PLATFORM = load_spacecraft("floating-platform")
TASK = GoToPose(spawn_distance=(3.0, 4.0))


@dataclass(frozen=True)
class Fatal(MinimumTime):
    """Kills the process that tries to solve it."""

    def cost(self, path: SymbolicTrajectory) -> Any:
        os._exit(9)


@pytest.mark.slow
def test_pool_equals_serial() -> None:
    starts = scenarios(TASK, PLATFORM, 3, 3)
    objectives = [MinimumTime(10), MinimumFuel(20.0, 1.0)]
    ticks: list[int] = []
    serial = solve_all(PLATFORM, TASK, objectives, starts, workers=1)
    pooled = solve_all(PLATFORM, TASK, objectives, starts, workers=2, progress=ticks.append)
    assert len(ticks) == 6
    for alone, shared in zip(serial, pooled, strict=True):
        assert [t.objective for t in alone] == [t.objective for t in shared]
        for a, b in zip(alone, shared, strict=True):
            assert a.solved
            assert np.array_equal(a.commands, b.commands)  # same machine, same code, same bits
    assert len({t.cost for t in serial[0]}) == 3  # three starts, not one thrice


@pytest.mark.slow
def test_dead_worker_is_a_status() -> None:
    starts = scenarios(TASK, PLATFORM, 3, 4)
    (answers,) = solve_all(PLATFORM, TASK, [Fatal(10)], starts, workers=2)
    assert [a.status for a in answers] == ["Worker_Died"] * 4
    assert not any(a.solved for a in answers)
    assert answers[0].commands.shape == (10, 8)


_ENDLESS = """
import signal
from rans.scenario import scenarios
from rans.optimal.trajectory.objectives import MinimumFuel
from rans.optimal.trajectory.pool import solve_all
from rans.model.spacecraft_file import load_spacecraft
from rans.tasks import GoToPose
signal.signal(signal.SIGINT, signal.default_int_handler)
craft, task = load_spacecraft("floating-platform"), GoToPose()
try:
    solve_all(craft, task, [MinimumFuel()], scenarios(task, craft, 0, 5000), 2,
              lambda _: print("solved", flush=True))
except KeyboardInterrupt:
    print("interrupted")
"""


@pytest.mark.slow
def test_interrupt_ends_it_quickly_and_quietly() -> None:
    with python("-c", _ENDLESS, start_new_session=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "solved\n"
        os.killpg(
            process.pid, signal.SIGINT
        )  # as a terminal does: to the parent and all its workers
        out, error = process.communicate(timeout=PATIENCE)
    assert out.count("solved") < 4000  # it did not go on to the 5,000th
    assert out.endswith("interrupted\n")
    assert error == ""
