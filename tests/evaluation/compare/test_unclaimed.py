"""What no optimum or bound is claimed for: a note, and the flights are compared all the same."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import Any

import pytest

from rans import GoToPose, Timing
from rans.evaluation.compare.bounds import Event
from rans.evaluation.compare.contest import Contest
from rans.evaluation.compare.entrants import enlisted
from rans.evaluation.compare.run import Comparison
from rans.model.drift import ClohessyWiltshire, Drift, step_goal
from rans.model.spacecraft import Propellant
from rans.model.spacecraft_file import load_spacecraft

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


def test_propellant_has_neither_optimum_nor_bound():
    tank = replace(PLATFORM, propellant=Propellant(1.0, 60.0))
    found = Comparison(Contest(tank, GoToPose(), Timing(), 4, 3))
    found.fly({}, ["optimal"], certified=2, workers=1)
    optimum, bound = found.notes
    assert found.failures == []
    assert found.certified == []
    assert "No optimum is computed: " in optimum
    assert "propellant" in optimum
    assert re.search("No bound is certified: .* propellant", bound)


def test_a_reaction_wheel_has_no_optimum_and_a_bound(monkeypatch):
    monkeypatch.setattr(Comparison, "horizons", lambda _: (20.0,))
    found = Comparison(Contest(load_spacecraft("pingu"), GoToPose(), Timing(), 4, 3))
    found.fly({}, ["optimal"], certified=1, workers=1)
    assert found.failures == []
    assert found.certified_starts() == [0]
    arrival = found.certified[0]
    assert arrival.event == Event()
    assert arrival.tube is not None
    assert arrival.tube > arrival.hull > 0.0
    optimum, bound = found.notes
    assert "has 1 reaction wheel" in optimum
    assert "tube bound" in bound


@pytest.mark.parametrize(
    ("craft", "task", "said"),
    [
        (PLATFORM, Orbit(), "No bound is certified: .* Orbit has clohessy-wiltshire"),
        (PLATFORM, Chase(), "No bound is certified: .* Chase has clohessy-wiltshire"),
        (PLATFORM, Watch(), "No optimum is computed: .* Watch remembers"),
    ],
)
def test_what_cannot_be_said_is_a_note_and_no_failure(craft, task, said, monkeypatch):
    monkeypatch.setattr("rans_optimal.relaxed.objectives", lambda *_: [])
    found = Comparison(Contest(craft, task, Timing(episode_steps=30), 4, 3))
    found.fly(enlisted(["lqr"], found.contest), ["optimal"], certified=2, workers=1)
    assert [entry.name for entry in found.entries] == ["LQR"]
    assert found.failures == []
    assert any(re.search(said, note) for note in found.notes)
