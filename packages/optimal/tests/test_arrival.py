"""Rounded corners: close to the function everywhere, differentiable where it is not."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, strategies as st
from rans_missions.tasks.avoid import Zones
from rans_optimal.arrival import ROUNDINGS, rounded
from rans_optimal.objectives import MinimumTime
from rans_optimal.pool import solve_all

from rans import TASKS, ConfigError, GoToPose
from rans.episode.scenario import scenarios
from rans.model.fields import leaves, map_leaves
from rans.model.spacecraft_file import load_spacecraft
from rans.tasks.go_to_pose_priced import DrawnTradeOff
from rans.tasks.observation_terms import ObservationTerm, Scalar
from rans.tasks.rewards import Transition, nearness
from rans.tasks.shapes import Ball
from tests.support.crafts import ANY_CRAFT
from tests.support.states import planar, spatial

X = ca.SX.sym("x")  # type: ignore[call-arg]
Y = ca.SX.sym("y")  # type: ignore[call-arg]
NORM = ca.Function("norm", [X, Y], [ca.sqrt(X * X + Y * Y), ca.fabs(X - 2 * Y) * 3.0])


@dataclass(frozen=True)
class Watch(GoToPose):
    """Its goal depends on what the spacecraft did."""

    def remember(self, goal: Any, state: Any) -> Any:
        return replace(goal, p=state.p)


@dataclass(frozen=True)
class Branching(GoToPose):
    """Moves its goal by a branch, which no symbol can follow."""

    def later(self, goal: Any, time: Any) -> Any:
        return goal if math.floor(time) < 1 else replace(goal, v=goal.p)


@dataclass(frozen=True)
class Distant(GoToPose):
    """Shows a distance, which has a corner at the goal."""

    def observation_terms(self, state: Any, goal: Any) -> tuple[ObservationTerm, ...]:
        return *super().observation_terms(state, goal), Scalar(
            "distance", "m", (goal.p - state.p).norm()
        )


@pytest.mark.parametrize(
    ("task", "said"),
    [
        (Watch(), "for goals that are known beforehand, and Watch remembers"),
        (Branching(), "need Branching.later as arithmetic on fields"),
        (Distant(), "what Distant shows .* has no gradient at the goal"),
    ],
)
def test_what_cannot_be_optimised_is_said_before_any_process_starts(task, said, monkeypatch):
    monkeypatch.delattr("rans.base.processes.Processes")
    craft = load_spacecraft("floating-platform")
    with pytest.raises(ConfigError, match=said):
        solve_all(craft, task, MinimumTime(), scenarios(task, craft, 0, 1), workers=2)


@given(x=st.floats(-5, 5), y=st.floats(-5, 5))
def test_never_more_than_the_radius_too_small(x, y):
    norm, size = (float(value) for value in rounded(NORM, 0.01)(x, y))
    assert 0 <= np.hypot(x, y) - norm <= 0.01 + 1e-12
    assert 0 <= 3 * abs(x - 2 * y) - size <= 0.03 + 1e-12


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("name", [name for name in ANY_CRAFT if name != "multi-task"])
def test_rewards_have_gradients_at_the_goal(name, dimension):
    """Where their norms do not; and are worth the same there."""
    task = TASKS[name](spin_weight=0.1)
    rest = planar() if dimension == 2 else spatial()
    state = map_leaves(lambda _: ca.SX.sym("s"), rest)  # type: ignore[call-arg]
    commands = ca.SX.sym("u", 4)  # type: ignore[call-arg]
    u = [commands[i] for i in range(4)]
    notes = DrawnTradeOff(0.5)
    if name == "avoid":
        notes = Zones((Ball(type(rest.p)(*[9.0] * dimension), rest.v, 0.5),))
    goal = replace(rest, notes=notes)
    terms = task.reward(Transition(state, goal, (u[0], u[1]), (u[2], u[3])))
    raw = ca.Function("reward", [ca.vertcat(*leaves(state)), commands], [sum(terms.values())])
    smooth = rounded(raw, ROUNDINGS[0])
    here = list(leaves(rest))
    command = [0.5, 0.5, 0.5, 0.5]
    assert np.isnan(np.array(raw.jacobian()(here, command, 0)[0])).any()
    assert np.isfinite(np.array(smooth.jacobian()(here, command, 0)[0])).all()
    # a quaternion's w loses the radius, which turns nothing
    assert float(smooth(here, command)) == pytest.approx(
        float(raw(here, command)), abs=ROUNDINGS[0] * 1e-9
    )


@given(distance=st.floats(0.0, 0.2))
def test_a_rest_has_a_gradient_at_its_edge(distance):
    """Half a radius early at most; the reward inside is that at the goal but for as much."""
    exact = ca.Function("near", [X], [nearness(X, 0.05, rest=0.04)])
    smooth = rounded(exact, 0.01)
    assert np.isfinite(float(smooth.jacobian()(distance, 0)))
    assert abs(np.log(float(smooth(distance)) / float(exact(distance)))) <= 0.005 / 0.05 + 1e-12
    edge = float(smooth.jacobian()(0.04, 0))
    assert -1.0 / 0.05 < edge < 0.0  # between that inside, 0, and that outside
