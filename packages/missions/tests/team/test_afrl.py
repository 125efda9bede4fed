"""Networks of AFRL for three agents, from their documented start, in a folder that is named: nobody may ship them.

Source: safe-autonomy-sims 6d71f7e, test/system_tests/environments/pettingzoo (observations, scales and start).
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rans_missions.team.task import InspectTeam
from rans_missions.vectors import motion_of

from rans.extend import Timing, fly, load_spacecraft, scenarios

FOLDER = os.environ.get("AFRL_NETWORKS", "")
STARTS = np.array(
    [
        [-12.6520983, 1.842438, -32.60466323, -0.05525816, -0.16368131, -0.07830456],
        [-15.54117335, 2.26315411, 35.33016436, -0.07330804, -0.21714724, 0.06216107],
        [-29.18383274, 4.24984071, -24.75601503, -0.03754564, -0.11121469, -0.12248139],
    ]
)
SUN = 1.424975716637098


class Networks:
    """Their forces from positions, velocities, points seen, a direction to unseen points, and the sun's angle."""

    name = "afrl"

    def __init__(self) -> None:
        runtime = pytest.importorskip("onnxruntime")
        files = [Path(FOLDER) / f"team-inspection-{k}.onnx" for k in range(3)]
        self._networks = [runtime.InferenceSession(file) for file in files]

    def reset(self, count: int) -> None:
        assert count == 3

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        unseen = InspectTeam().directions(goal)[0].columns()
        towards = np.array(unseen).T / np.linalg.norm(unseen, axis=0)[:, None]
        count = np.reshape(goal.notes.count, (3, 1)) / 100.0
        sun = np.reshape(goal.notes.sun, (3, 1)) % (2.0 * np.pi)
        motion = motion_of(state) / np.repeat([100.0, 0.5], 3)
        rows = np.concatenate([motion, count, towards, sun], axis=1).astype(np.float32)
        pass_on = np.ones(1, np.float32)
        forces = [
            network.run(None, {"obs": row[None], "state_ins": pass_on})[0][0, ::2]
            for network, row in zip(self._networks, rows, strict=True)
        ]
        both = np.stack([forces, np.negative(forces)], axis=2).reshape(3, 6)
        return np.clip(both, 0.0, 1.0)


@pytest.mark.skipif(not FOLDER, reason="AFRL_NETWORKS names no folder with the networks")
def test_their_networks_leave_the_zone_before_half_of_the_points_are_seen() -> None:
    """As their recorded episodes do, which end beyond 800 m with 49 to 77 of 100 points."""
    task = InspectTeam()
    craft = load_spacecraft("afrl-deputy")
    begin: Any = scenarios(task, craft, 0, 3)
    begin.goal.notes.sun[:] = SUN
    columns = [*begin.start.p.columns(), *begin.start.v.columns()]
    for column, values in zip(columns, STARTS.T, strict=True):
        column[:] = values
    flight = fly(craft, task, Networks(), begin, Timing(10.0, 60))
    when = int(np.argmax(flight.margins["zone"][:, 0] < 0.0))
    assert 35 <= when <= 50
    assert 35 <= float(flight.goals.notes.count[when, 0]) <= 55
    assert flight.margins["keep-apart"][:when].min() > 0.0
