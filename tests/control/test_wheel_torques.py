"""Controllers without training fly reaction wheels: who gives which torque, within which momentum."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import rans
from campaigns.craft import flown
from rans import GoToPose, Spacecraft, Timing
from rans.control.allocation import Allocation, Rounding
from rans.control.wheel_torques import WheelTorques
from rans.effectors.motion import held
from rans.episode.flight import fly
from rans.episode.scenario import scenarios
from rans.evaluation.measure.metrics import settling_times
from rans.model.actuators import Throttle, Wheel
from rans.model.body import Body
from rans.model.dynamics import PlanarState, SpatialState
from rans.model.fields import Heading, Quat, Vec2, Vec3
from tests.support.effector_crafts import BURNING, CUBESAT, UNEVEN, platform

PERIOD = 0.1
THROTTLED = platform(actuators=Throttle(), wheels=(Wheel((0.0, 0.0, 1.0), 0.1, 0.7, 1e-3),))
"""Eight thrusters of 1 N at 0.31 m, and a wheel of 0.1 N m and 0.7 N m s."""


def split(craft: Spacecraft, wrench: list[float], *momenta: float) -> np.ndarray:
    """Commands of one craft that owes nothing."""
    ours = Rounding(craft, PERIOD)
    ours.reset(1)
    return ours.round(np.array([wrench]), stores=tuple(np.array([h]) for h in momenta))[0]


@pytest.mark.parametrize(
    ("momentum", "torque", "wheel"),
    [
        (0.0, 0.08, -0.8),  # within the wheel's torque: thrusters stay shut
        (0.0, 0.25, -1.0),  # beyond: the wheel gives 0.1 N m, thrusters 0.15 N m
        (-0.555, 0.25, -0.5),  # 0.005 N m s below 80 % of 0.7 N m s: 0.05 N m for 0.1 s
        (-0.56, 0.25, 0.0),  # at 80 %: thrusters give all
        (-0.565, 0.25, 0.5),  # beyond 80 %: slowed down at 0.05 N m, which thrusters balance
        (-0.7, 0.0, 1.0),  # full: slowed down at 0.1 N m, also where no torque is wanted
        (0.7, 0.0, -1.0),
    ],
)
def test_split_by_hand(momentum, torque, wheel):
    """The torque on the craft is minus that of the motor; four thrusters of 0.31 N m turn it either way."""
    commands = split(THROTTLED, [0.0, 0.0, torque], momentum)
    assert commands[-1] == pytest.approx(wheel, abs=1e-9)
    rest = torque + 0.1 * wheel
    opened = commands[:-1]
    # Commands meet wrenches to 1e-9 of a thruster's.
    assert opened.sum() == pytest.approx(abs(rest) / 0.31, abs=1e-8)
    assert np.sort(opened)[:4] == pytest.approx(np.zeros(4), abs=1e-8)


def test_wheels_make_up_for_pulses():
    """On/off thrusters turn by pulses of 0.31 N m and more; over a second wheel and pulses give 0.15 N m."""
    craft = replace(THROTTLED, actuators=platform().actuators)
    ours = Rounding(craft, PERIOD)
    ours.reset(1)
    momentum = np.zeros(1)
    turned = 0.0
    for _ in range(10):
        commands = ours.round(np.array([[0.0, 0.0, 0.15]]), stores=(momentum,))[0]
        assert set(commands[:-1]) <= {0.0, 1.0}
        momentum = momentum + commands[-1] * 0.1 * PERIOD
        turned += float(commands[:-1] @ np.array(craft.wrench_map)[:, 2] - 0.1 * commands[-1])
    # What is owed at the end is less than half a pulse.
    assert turned == pytest.approx(1.5, abs=0.155)
    assert turned + ours.owed[0, 2] == pytest.approx(1.5, abs=1e-8)


@pytest.mark.parametrize("craft", [THROTTLED, CUBESAT, UNEVEN], ids=lambda craft: craft.name)
def test_engine_turns_as_the_allocation_says(craft):
    """From rest, a torque for 0.1 s gives I^-1 torque x 0.1 s; the engine has no map of wheels."""
    flat = craft.dimension == 2
    torque = np.array([0.05]) if flat else np.array([0.004, -0.003, 0.002])
    wrench = [*np.zeros(craft.dimension), *torque]
    commands = split(craft, wrench, *np.zeros(len(craft.wheels)))
    zero = np.zeros(1)
    stores = tuple(zero for _ in craft.wheels)
    start = (
        PlanarState(Vec2(zero, zero), Heading(zero), Vec2(zero, zero), zero, stores=stores)
        if flat
        else SpatialState(
            Vec3(zero, zero, zero),
            Quat(zero + 1.0, zero, zero, zero),
            Vec3(zero, zero, zero),
            Vec3(zero, zero, zero),
            stores=stores,
        )
    )
    timing = Timing(control_period=PERIOD)
    command = tuple(np.array([x]) for x in commands)
    end = held(start, craft, Body.of(craft), command, timing)
    inertia = np.array(craft.inertia)
    expected = torque / inertia[2, 2] if flat else np.linalg.solve(inertia, torque)
    # The gyroscopic torque of a spin of at most 0.007 rad/s changes 1e-5 of it.
    np.testing.assert_allclose(
        np.concatenate(end.spin()), PERIOD * expected, rtol=1e-4, atol=PERIOD * 1e-6
    )


def test_other_wheels_make_up_for_a_full_one():
    """Four wheels in a pyramid: with one at its limit the other three still give the torque."""
    a, b = np.sqrt([2.0 / 3.0, 1.0 / 3.0])
    axes = [(a, 0.0, b), (-a, 0.0, b), (0.0, a, b), (0.0, -a, b)]
    craft = replace(CUBESAT, wheels=tuple(Wheel(axis, 0.01, 0.02, 4e-5) for axis in axes))
    wheels = WheelTorques(craft, PERIOD)
    full = (0.02, 0.0, 0.0, 0.0)
    low, high = wheels.bounds(tuple(np.array([h]) for h in full), np.zeros(1))
    assert high[0, 0] == 0.0  # no thruster turns this craft, so nothing unloads it
    torque = np.array([[-0.002, 0.001, 0.001]])  # the pseudoinverse asks the first for more
    assert (torque @ np.linalg.pinv(wheels.map))[0, 0] > 0.0
    commands = wheels.commands(torque, low, high)
    assert ((commands >= low) & (commands <= high)).all()
    np.testing.assert_allclose(commands @ wheels.map, torque, atol=1e-12)


def test_authority_counts_wheels():
    """Of the platform 4 x 0.31 N m of thrusters and 0.1 N m of the wheel; of the CubeSat wheels alone about z."""
    plain = platform(actuators=Throttle())
    force, torque = Allocation(plain).authority()
    ours = Allocation(THROTTLED).authority()
    assert ours == pytest.approx((force, torque + 0.1), rel=1e-9)
    craft = rans.load_spacecraft("cubesat-3u")
    assert Allocation(craft).authority()[1] == pytest.approx(0.004, rel=1e-9)
    # About z 0.004 N m turn 0.00833 kg m^2; about x and y it is much more, but of 0.04954 kg m^2.
    _, turn = Allocation(craft).accelerations()
    assert 0.004 / 0.04954 < turn <= 0.004 / 0.00833


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "kind"), [("roboran-platform", rans.Switching), ("afrl-12kg", rans.LQR)]
)
def test_real_craft_settle(name, kind):
    """Without domain randomization; and no wheel exceeds its limit, or 80 % where thrusters unload it."""
    run = flown(name)
    task = run.task.for_evaluation()
    starts = scenarios(task, run.craft, 2023, 2)
    flight = fly(run.craft, task, kind(run.craft, task, run.timing), starts, run.timing)
    # In the mean of the last fifth: the limit cycle of switching's pulses grazes the tolerance of 5 cm.
    for quantity, errors in flight.errors().items():
        held = np.asarray(errors)[-len(errors) // 5 :].mean(axis=0)
        assert (held < flight.task.tolerances()[quantity]).all()
    # Thrusters do not turn this CubeSat.
    share = 1.0 if name == "afrl-12kg" else 0.8
    for wheel, momenta in zip(run.craft.wheels, flight.states.stores, strict=True):
        assert np.abs(momenta).max() <= share * wheel.max_momentum * (1.0 + 1e-9)


@pytest.mark.parametrize("kind", [rans.LQR, pytest.param(rans.Switching, marks=pytest.mark.slow)])
def test_propellant_makes_the_craft_lighter(kind):
    """Half of 2 of 5.32 kg is left, so that forces are 4.32 / 5.32 of those of the full craft; flights settle."""
    task = GoToPose().for_evaluation()
    starts = scenarios(task, BURNING, 5, 2)
    left = replace(starts.start, stores=(np.full(2, 1.0),))
    full = replace(starts.start, stores=(np.full(2, 2.0),))
    controller = kind(BURNING, task, task.timing)
    if kind is rans.LQR:
        now, before = (controller.wrench(state, starts.goal) for state in (left, full))
        np.testing.assert_allclose(now, before * 4.32 / 5.32, rtol=1e-12)
    else:
        # From rest the least time is 2 sqrt(s / a).
        gaps = [controller._gap(0.0, state, starts.goal) for state in (left, full)]
        shut = np.zeros((2, 1, BURNING.thruster_count), bool)
        now, before = (controller._cost(gap, shut, controller._scales(2)) for gap in gaps)
        np.testing.assert_allclose(now, before * np.sqrt(4.32 / 5.32), rtol=1e-9)
    flight = fly(BURNING, task, controller, starts, task.timing)
    assert np.isfinite(settling_times(flight)).all()
