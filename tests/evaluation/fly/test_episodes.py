"""Missions flown in several shares are those flown at once: margins, success and lengths too."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from rans_missions.tasks import Avoid, DockPort

from rans import Timing
from rans.episode.step import Setup
from rans.evaluation.fly.episodes import fly_episodes
from rans.model.spacecraft_file import load_spacecraft


@dataclass
class Push:
    """Opens two thrusters all the time, and is flown in shares of eight if it is slow."""

    slow: bool
    name: str = "push"

    def reset(self, count: int) -> None:
        """Nothing to forget."""

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        command = np.zeros((len(observation), 8))
        command[:, [0, 5]] = 1.0
        return command


@pytest.mark.parametrize(
    "task",
    [Avoid(), DockPort(position_tolerance=2.0, attitude_tolerance=4.0, velocity_tolerance=1.0)],
)
def test_shares_are_joined_with_all_that_a_mission_tells(task):
    setup = Setup(load_spacecraft("floating-platform"), task, Timing(episode_steps=12, checks=2))
    whole, parts = (
        fly_episodes(Push(slow), setup, 3, 20, workers=1, first=5) for slow in (False, True)
    )
    assert whole.margins.keys() == parts.margins.keys()
    for name, margin in whole.margins.items():
        assert np.array_equal(parts.margins[name], margin)
    assert parts.failed().tolist() == whole.failed().tolist()
    assert whole.first == parts.first == 5
    if isinstance(task, DockPort):
        for name in ("done", "lengths"):
            found, expected = (getattr(each, name).tolist() for each in (parts, whole))
            assert found == expected
            assert len({*found}) > 1
