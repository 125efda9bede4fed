"""The observer finds what acts; the MPC with it holds where the MPC alone does not."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from rans.errors import ConfigError
from rans.evaluation.measure.metrics import solved
from rans.flight import fly
from rans.model.body import Body
from rans.model.dynamics import Wrench, advance, wrench
from rans.model.fields import Vec2, Vec3
from rans.model.spacecraft_file import load_spacecraft
from rans.model.timing import Timing
from rans.optimal.control.mpc import MPC
from rans.optimal.control.observer import Observer, ObserverMPC, Trust
from rans.optimal.control.regulator import Deadband
from rans.randomization.conditions import Conditions, DisturbanceConditions
from rans.scenario import draws, scenarios
from rans.tasks import GoToPose

PLATFORM = load_spacecraft("floating-platform")
FLYER = load_spacecraft("free-flyer")
TASK = GoToPose().for_evaluation()
TIMING = Timing()
PUSHED = Conditions(disturbances=DisturbanceConditions(force=0.25, torque=0.03))
"""As an uneven floor pushes at most (RoboRAN)."""


@pytest.mark.parametrize("craft", [PLATFORM, FLYER], ids=lambda craft: craft.name)
def test_finds_force_and_torque_while_thrusters_fire(craft: Any) -> None:
    """Constant in W; after 60 periods 0.9^60 = 0.2 % of what was not known is left, and in space the torque
    is seen 0.02 rad late as the craft turns."""
    planar = craft.dimension == 2
    in_space = Wrench(Vec3(0.2, -0.1, 0.05), Vec3(0.02, 0.0, -0.01))
    acting = Wrench(Vec2(0.2, -0.1), 0.02) if planar else in_space
    observer = Observer(craft, TIMING, Trust(0.1))
    random = np.random.default_rng(0)
    state: Any = scenarios(TASK, craft, 61, 3).start
    observer.reset(3)
    for _ in range(60):
        observer.see(state)
        commands = (random.random((3, len(craft.thrusters))) < 0.2).astype(float)
        observer.expect(state, commands)
        state = advance(
            state, wrench(craft, tuple(commands.T)), Body.of(craft), 0.2, disturbance=acting
        )
    force = np.array(acting.force.columns())[:, None]
    torque = np.array([acting.torque] if planar else acting.torque.columns())[:, None]
    np.testing.assert_allclose(observer.force, np.tile(force, 3), atol=0.002 * 0.25)
    np.testing.assert_allclose(observer.torque, np.tile(torque, 3), atol=2e-4 if planar else 2e-3)


@pytest.mark.slow
def test_holds_on_an_uneven_floor_where_the_plan_alone_does_not() -> None:
    starts = scenarios(TASK, PLATFORM, 62, 2)
    own = draws(62, 2)
    ours, theirs = (
        solved(fly(PLATFORM, TASK, one, starts, TIMING, conditions=PUSHED, draws=own))
        for one in (ObserverMPC(PLATFORM, TASK, TIMING), MPC(PLATFORM, TASK, TIMING))
    )
    assert ours.all()
    assert not theirs.any()


def test_without_trust_or_disturbance_it_is_the_mpc() -> None:
    timing = Timing(episode_steps=25)
    starts = scenarios(TASK, PLATFORM, 63, 2)
    plain = fly(PLATFORM, TASK, MPC(PLATFORM, TASK, timing), starts, timing).commands
    for trust in (Trust(0.0), Trust(0.1)):
        made = ObserverMPC(PLATFORM, TASK, timing, trust=trust)
        assert np.array_equal(fly(PLATFORM, TASK, made, starts, timing).commands, plain)


def test_a_force_wakes_who_rests() -> None:
    """At rest at the goal; 1 N moves 5.32 kg by 6 cm in 0.8 s."""
    goal = scenarios(TASK, PLATFORM, 64, 1).goal
    for force, rests in ((0.0, True), (1.0, False)):
        acting = Wrench(Vec2(np.array([force]), np.zeros(1)), np.zeros(1))
        assert Deadband().holds(PLATFORM, TASK, goal, goal, acting) == [rests]


@pytest.mark.parametrize("share", [-0.1, 1.1, math.nan])
def test_refuses_a_share_that_means_nothing(share: float) -> None:
    with pytest.raises(ConfigError, match="share must be from 0 to 1"):
        Trust(share)
