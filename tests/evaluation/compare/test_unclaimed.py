"""What no optimum or bound is claimed for: a note, and the flights are compared all the same."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import pytest

from rans.evaluation.compare.contest import Contest
from rans.evaluation.compare.entrants import enlisted
from rans.evaluation.compare.run import Comparison
from rans.model.drift import ClohessyWiltshire, Drift, step_goal
from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import load_spacecraft
from rans.model.timing import Timing
from rans.tasks import GoToPose
from tests.support.slosh import SLOSHING

PLATFORM = load_spacecraft("floating-platform")


@dataclass(frozen=True)
class Orbit(GoToPose):
    """Something pulls, and the goal stands still."""

    @property
    def drift(self) -> Drift:
        return ClohessyWiltshire(0.0011)


@dataclass(frozen=True)
class Chase(Orbit):
    """The goal moves too."""

    def later(self, goal: Any, time: Any) -> Any:
        return step_goal(goal, self.drift, time)


@dataclass(frozen=True)
class Watch(GoToPose):
    """The goal notes what the spacecraft did."""

    def remember(self, goal: Any, state: Any) -> Any:
        return goal


@pytest.mark.parametrize(
    ("craft", "task", "said"),
    [
        (PLATFORM, Orbit(), "No bound is certified: .* Orbit has clohessy-wiltshire"),
        (PLATFORM, Chase(), "No bound is certified: .* Chase has clohessy-wiltshire"),
        (PLATFORM, Watch(), "Neither optima nor bounds are claimed: .* Watch remembers"),
        (SLOSHING, GoToPose(), "Neither optima nor bounds are claimed: .* sloshing liquid"),
    ],
)
def test_what_cannot_be_said_is_a_note_and_no_failure(
    craft: Spacecraft, task: GoToPose, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rans.evaluation.compare.relaxed.objectives", lambda *_: [])
    found = Comparison(Contest(craft, task, Timing(episode_steps=30), 4, 3))
    found.fly(enlisted(["lqr"], found.contest), ["optimal"], certified=2, workers=1)
    found.trace({}, 1.0)
    assert [entry.name for entry in found.entries] == ["LQR"]
    assert found.failures == []
    note, trade_off = found.notes  # the front has the first in common
    assert re.search(said, note)
    assert "Nobody has a trade-off" in trade_off
