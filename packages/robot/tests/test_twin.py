"""The simulated robot: latency, noise, faults, and what it refuses."""

import math

import numpy as np
import pytest
from rans_robot.twin import Craft, TwinPlan

from rans import (
    Conditions,
    FaultConditions,
    SensorConditions,
    SensorsConditions,
    ThrusterConditions,
)
from rans.base.pretrained import pretrained_folder
from rans.deploy.contract import contract
from rans.fast.learn.run_folder import RunFolder
from rans.model.spacecraft_file import load_spacecraft

pytest.importorskip("rosbags")
pytest.importorskip("mcap")


PLATFORM = "floating-platform"


def test_a_twin_has_latency_noise_and_faults():
    craft = load_spacecraft(PLATFORM)
    conditions = Conditions(
        thrusters=ThrusterConditions(latency=0.1),
        sensors=SensorsConditions(position=SensorConditions(noise=0.01, dropout=0.5)),
        faults=FaultConditions(count=1.0, kinds=("stuck-open",), time=1.0),
    )
    twin = Craft(TwinPlan(craft, 0.2, conditions=conditions, start=(1.0, 0.0, 0.0)))
    twin.hold(np.array([1.0, 0, 0, 0, 0, 0, 0, 0]))
    speeds = []
    positions = []
    for _ in range(90):
        twin.advance()
        speeds.append(float(np.linalg.norm(twin.motion.velocity)))
        measured = twin.measured()
        positions.append(np.nan if measured is None else measured.position[0])
    assert speeds[9] == 0.0  # 0.1 s of latency
    assert speeds[20] > 0.0
    errors = np.array(positions) - 1.0
    assert 0.005 < np.nanstd(errors[:10]) < 0.02
    twin.hold(np.zeros(8))
    for _ in range(30):
        twin.advance()
    coasting = twin.motion.velocity
    for _ in range(50):
        twin.advance()
    assert not np.allclose(twin.motion.velocity, coasting)  # one thruster is stuck open


def test_impulses_are_as_noisy_as_in_an_episode():
    """A twin has four steps in a control period, over which the noise of single steps averages out."""
    noisy = Conditions(thrusters=ThrusterConditions(noise=0.05))
    twin = Craft(
        TwinPlan(load_spacecraft(PLATFORM), 0.2, conditions=noisy, rate=20.0, start=(0.0, 0.0, 0.0))
    )
    # Two thrusters whose torques cancel push along one direction of the body.
    twin.hold(np.array([0, 0, 1.0, 0, 0, 0, 0, 1.0]))
    velocities = []
    for _ in range(101):
        for _ in range(4):
            twin.advance()
        velocities.append(twin.motion.velocity)
    impulses = np.linalg.norm(np.diff(velocities, axis=0), axis=1)
    # The standard error of a deviation of 100 numbers is 7 %; without the correction it would be half.
    assert impulses.std() / impulses.mean() == pytest.approx(0.05 / math.sqrt(2.0), rel=0.25)


def test_duties_of_pulsed_thrusters_fall_into_steps():
    """37 % of a period of 0.1 s at steps of 10 ms: three whole ones, then seven tenths."""
    twin = Craft(TwinPlan(load_spacecraft("atmos"), 0.1))
    twin.hold(np.array([0.37, 0, 0, 0, 0, 0, 0, 0]))
    given = [twin.advance()[0] for _ in range(10)]
    assert given == pytest.approx([1, 1, 1, 0.7, 0, 0, 0, 0, 0, 0])


def test_a_contract_tells_which_way_a_wheel_turns_the_craft():
    """Its sentence, beside the motion of the craft over one period of the command 1."""
    config = RunFolder(pretrained_folder("go-to-pose-2d")).config()
    craft = load_spacecraft("pingu")
    about = contract("", config, craft, "", 0, np.zeros((1, 1, 10), np.float32))
    assert "the motor turns its wheel about +axis" in about["command"]["wheel_command"]
    assert "and the spacecraft about -axis" in about["command"]["wheel_command"]
    twin = Craft(TwinPlan(craft, 0.1, start=(1.0, 0.0, 0.0)))
    twin.hold(np.array([*[0.0] * 8, 1.0]))
    twin.advance()
    (wheel,) = about["command"]["wheels"]
    # Torque over inertia, for the 0.01 s between two states of the twin.
    assert twin.motion.spin[2] == pytest.approx(
        -wheel["max_torque"] * wheel["axis"][2] / craft.inertia[2][2] * 0.01, rel=1e-6
    )
