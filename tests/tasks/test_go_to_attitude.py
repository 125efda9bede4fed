"""Turns to an attitude: rewards by hand, and flights of a craft that has wheels and no thruster."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import rans
from rans.evaluation.fly.episodes import EngineName
from rans.evaluation.measure.metrics import impulses
from rans.evaluation.stress.effects import applicable_effects
from rans.flight import Flight
from rans.model.dynamics import SpatialState
from rans.model.fields import Quat, Vec3
from rans.model.spacecraft_file import load_spacecraft
from rans.model.timing import Timing
from rans.optimal.control.lqr import LQR
from rans.scenario import scenarios
from rans.tasks import GoToAttitude, observation
from rans.tasks.rewards import Transition

INNOCUBE = load_spacecraft("innocube")
ORIGIN = Vec3(0.0, 0.0, 0.0)
HALF = math.sqrt(0.5)
QUARTER_TURN = SpatialState(ORIGIN, Quat(HALF, 0.0, 0.0, HALF), ORIGIN, Vec3(0.0, 0.03, 0.04))
"""A quarter turn about z, at 0.05 rad/s (3-4-5)."""
UPRIGHT = SpatialState(ORIGIN, Quat(1.0, 0.0, 0.0, 0.0), ORIGIN, ORIGIN)


def test_a_quarter_turn_by_hand() -> None:
    task = GoToAttitude(torque_weight=0.1)
    shut = (0.0, 0.0, 0.0)
    angle = math.pi / 2
    assert task.errors(QUARTER_TURN, UPRIGHT) == pytest.approx({"attitude": angle, "spin": 0.05})
    # The goal's axes in the body: x lies along -y of the body, y along x.
    expected = [0, -1, 0, 1, 0, 0, 0, 0, 0, 0, 0.03, 0.04, -1, 0, 1, 0, -1, 0, 0, 0, 0, 0]
    assert observation(task, QUARTER_TURN, UPRIGHT) == pytest.approx(expected, abs=1e-15)

    reward = task.reward(Transition(QUARTER_TURN, UPRIGHT, (0.5, -1.0, 0.0), shut, forces=()))
    assert reward == pytest.approx(
        {
            "turn": math.exp(-angle),
            "attitude": math.exp(-angle / 0.25),
            "fine attitude": math.exp(-angle / 0.02),
            "rest": math.exp(-angle / 0.25 - 0.05 / 0.02),
            "torque": -0.1 * (0.25 + 1.0),
        }
    )
    # Thrusters are priced by themselves: the first command is one's, the others are of wheels.
    reward = task.reward(Transition(QUARTER_TURN, UPRIGHT, (1.0, -1.0, 0.0), shut, forces=(2.0,)))
    assert (reward["torque"], reward["thrust"]) == pytest.approx((-0.1, -0.02))


def turned(engine: EngineName, steps: int) -> Flight:
    task = GoToAttitude()
    starts = scenarios(task, INNOCUBE, 3, 3)
    timing = Timing(control_period=1.0, substeps=2, episode_steps=steps)
    return rans.fly(INNOCUBE, task, LQR(INNOCUBE, task, timing), starts, timing, engine)


def whole(flight: Flight) -> np.ndarray:
    """Angular momentum of craft and wheels in W, (T + 1, N, 3), N m s, by SciPy's rotations."""
    states: Any = flight.states
    q = np.stack([states.attitude.w, *(getattr(states.attitude, k) for k in "xyz")], axis=-1)
    spin = np.stack([getattr(states.w, k) for k in "xyz"], axis=-1)
    inside = spin @ np.array(flight.craft.inertia) + np.stack(states.stores, axis=-1)
    turn = Rotation.from_quat(q.reshape(-1, 4), scalar_first=True)
    return turn.apply(inside.reshape(-1, 3)).reshape(inside.shape)


def test_wheels_alone_turn_a_craft_and_its_momentum_lasts() -> None:
    """No motor changes the momentum of the whole, of some 1e-3 N m s."""
    flight = turned("fast", 90)
    momentum = whole(flight)
    assert np.abs(momentum - momentum[0]).max() < 1e-12
    assert np.abs(momentum).max() > 1e-3
    task: Any = flight.task
    assert task.reached(flight.states, flight.goals)[-1].all()
    assert (np.abs(flight.commands) <= 1.0).all()
    assert impulses(flight).tolist() == [0.0, 0.0, 0.0]


def test_torques_of_a_stress_test_are_those_of_the_strongest_wheel() -> None:
    """A tenth to 0.7 of 0.6 mN m; nothing gives a force that could be a measure of forces."""
    effects = applicable_effects(INNOCUBE, GoToAttitude.timing)
    sizes = {effect.name: effect.sizes for effect in effects if effect.group == "Disturbances"}
    assert sizes["torque"] == pytest.approx((6e-5, 1.2e-4, 1.8e-4, 3e-4, 4.2e-4))
    assert sizes["force"] == ()


@pytest.mark.slow
def test_drake_turns_it_alike() -> None:
    """30 s of closed loop, in which errors of 1e-10 rad/s in a period add up."""
    ours, drakes = turned("fast", 30), turned("drake", 30)
    assert (ours.engine, drakes.engine) == ("fast", "drake")
    assert (ours.states.w.x != drakes.states.w.x).any()
    for a, b in zip(ours.errors().values(), drakes.errors().values(), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-6)
