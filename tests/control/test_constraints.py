"""Constraints of a task: the MPC keeps them, and the other controllers say that they do not."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import pytest
from rans_optimal.mpc import MPC

from rans import LQR, GoToPosition, Timing
from rans.episode.flight import fly
from rans.episode.scenario import scenarios
from rans.model.actuators import Throttle
from rans.model.fields import Vec2
from rans.model.spacecraft_file import load_spacecraft
from tests.support.crafts import deputy

THROTTLED = replace(load_spacecraft("floating-platform"), actuators=Throttle())
TIMING = Timing(episode_steps=100)


@dataclass(frozen=True)
class Slow(GoToPosition):
    """0.3 m/s at most: the controllers of free motion fly at up to 1 m/s."""

    def constraints(self, state: Any, goal: Any) -> dict[str, Any]:
        return {"speed": 0.3 - state.v.norm()}


@dataclass(frozen=True)
class Centre:
    """What a goal of `Around` notes."""

    x: Any
    """Of the ball, m."""
    y: Any
    """Of the ball, m."""


@dataclass(frozen=True)
class Around(GoToPosition):
    """A ball of 0.4 m beside the straight way from (2, 0.1) m, which the goal notes."""

    goal_notes = Centre

    def sample(self, random: Any) -> tuple[Any, Any]:
        start, goal = super().sample(random)
        zero = 0.0 * start.p.x
        away = replace(start, p=Vec2(zero + 2.0, zero + 0.1))
        return away, replace(goal, notes=Centre(zero + 1.0, zero - 0.1))

    def constraints(self, state: Any, goal: Any) -> dict[str, Any]:
        return {"ball": (state.p - Vec2(goal.notes.x, goal.notes.y)).norm() - 0.4}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("craft", "task", "period"),
    [(deputy(), Slow().for_evaluation(), 0.5), (THROTTLED, Around(), 0.2)],
    ids=["speed", "ball"],
)
def test_the_mpc_keeps_margins_and_arrives(craft, task, period):
    """Up to what linearising costs: a millimetre, or a millimetre a second, where nothing turns much."""
    timing = Timing(control_period=period, episode_steps=100)
    starts = scenarios(task, craft, 11, 2)
    flight = fly(craft, task, MPC(craft, task, timing), starts, timing)
    [margin] = flight.margins.values()
    assert margin.min() > -2e-3
    assert margin.min() < 0.02  # and not for want of thrust
    assert flight.errors()["position"][-10:].max() < 0.05
    with pytest.warns(UserWarning, match="LQR does not know the constraints of"):
        careless = LQR(craft, task, timing)
    [without] = fly(craft, task, careless, starts, timing).margins.values()
    assert without.min() < -0.05


def test_no_constraint_changes_nothing(recwarn):
    LQR(THROTTLED, GoToPosition(), TIMING)
    assert not recwarn.list
