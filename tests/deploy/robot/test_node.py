"""An agent on a robot: frames by one pulse a thruster, messages, faults, bags, and two processes over loopback."""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rosbags")
pytest.importorskip("mcap")

from rans.cli import main
from rans.cli.fly import Fly, opened_bus
from rans.deploy.robot.bag import bag_entries
from rans.deploy.robot.bus import Receive, UDPBus, open_bus
from rans.deploy.robot.frames import Motion, quaternion_of, rotated, swapped
from rans.deploy.robot.interfaces import RobotName, interface
from rans.deploy.robot.messages import FLOATS, PX4_MOTORS, TEXT, array, make, pack, types, unpack
from rans.deploy.robot.node import END_TOPIC, fly_over, replay_bag
from rans.deploy.robot.pilot import (
    CRAFT_TOPIC,
    MessagePilot,
    Plan,
    craft_hash,
    export_for_flight,
    motion_of,
)
from rans.deploy.robot.twin import VALVES_TOPIC, Craft, TwinPlan, run_twin
from rans.deploy.robot.velocity import VelocityFilter
from rans.errors import ConfigError
from rans.model.spacecraft_file import load_spacecraft
from rans.pretrained import pretrained_folder
from rans.randomization.conditions import (
    Conditions,
    FaultConditions,
    SensorConditions,
    SensorsConditions,
    ThrusterConditions,
)
from rans.tasks import Avoid, GoToPose
from tests.support.robots import AWAY

PLATFORM = "floating-platform"
TASK = {"name": "go-to-pose", "settings": {}}


def plan_for(agent: Path, **changes: Any) -> Plan:
    return Plan(folder=str(agent), task=TASK, **changes)


class Wire:
    """A bus within one process."""

    def __init__(self) -> None:
        self.sent: list[tuple[str, bytes]] = []
        self._receivers: dict[str, list[Receive]] = {}

    def subscribe(self, topic: str, kind: str, receive: Receive) -> None:
        self._receivers.setdefault(topic, []).append(receive)

    def publish(self, topic: str, kind: str, data: bytes) -> None:
        self.sent.append((topic, data))
        for receive in self._receivers.get(topic, ()):
            receive(data)

    def close(self) -> None:
        self._receivers.clear()


# Frames


PX4_THRUSTERS = [
    # x, y (m) and direction of the force in FRD: PX4-Space-Systems, airframe 70000, in PX4's order.
    ((-0.12, -0.12), (1, 0)),
    ((0.12, -0.12), (-1, 0)),
    ((-0.12, 0.12), (1, 0)),
    ((0.12, 0.12), (-1, 0)),
    ((0.12, -0.12), (0, 1)),
    ((0.12, 0.12), (0, -1)),
    ((-0.12, -0.12), (0, 1)),
    ((-0.12, 0.12), (0, -1)),
]
ATMOS = 17.8, 0.315, 1.5
"""Mass, kg, yaw inertia, kg m^2, and force, N."""


@pytest.mark.parametrize("thruster", range(8))
@pytest.mark.parametrize("heading", [0.0, 100.0])
def test_one_pulse_of_each_thruster_in_px4s_frames(thruster: int, heading: float) -> None:
    """ActuatorMotors in, VehicleOdometry out, against PX4's own table: Newton's law in NED and FRD by hand."""
    craft = load_spacecraft("atmos")
    plan = TwinPlan(craft, 0.1, robot="px4", start=(1.0, 2.0, heading))
    ends = interface("px4", 8, 8)
    twin = Craft(plan)
    control = np.full(12, np.nan, np.float32)
    control[thruster] = 1.0
    motors = make(PX4_MOTORS, timestamp=0, timestamp_sample=0, reversible_flags=0, control=control)
    command = ends.commanded("fmu/in/actuator_motors", pack(PX4_MOTORS, motors))
    assert command is not None
    before = unpack(*_last(ends.state(twin.motion, 0)))
    twin.hold(command)
    for _ in range(10):  # 0.1 s, one pulse of full duty
        twin.advance()
    after = unpack(*_last(ends.state(twin.motion, 0)))

    mass, inertia, force = ATMOS
    (x, y), (fx, fy) = PX4_THRUSTERS[thruster]
    # PX4's heading is from north, clockwise from above; RANS's from east, the other way.
    yaw = np.pi / 2 - np.radians(heading)
    assert before.position[:2] == pytest.approx([2.0, 1.0])
    north = np.cos(yaw) * fx - np.sin(yaw) * fy
    east = np.sin(yaw) * fx + np.cos(yaw) * fy
    gained = np.subtract(after.velocity, before.velocity)[:2] / 0.1
    # It turns by 0.0029 rad meanwhile, which changes the direction of the force by 0.1 %.
    assert gained == pytest.approx(np.array([north, east]) * force / mass, abs=2e-4)
    rate = (after.angular_velocity[2] - before.angular_velocity[2]) / 0.1
    assert rate == pytest.approx((x * fy - y * fx) * force / inertia, rel=1e-4)


def _last(messages: list[Any]) -> tuple[str, bytes]:
    return messages[-1].kind, messages[-1].data


def test_frames_by_examples() -> None:
    """Facing east, moving north, rolling: by hand."""
    facing_east = Motion(
        np.array([3.0, 4.0, 5.0]),
        quaternion_of(0.0),
        np.array([0.0, 1.0, 0.0]),
        np.array([0.1, 0.2, 0.3]),
    )
    px4 = swapped(facing_east)
    assert px4.position == pytest.approx([4.0, 3.0, -5.0])
    assert px4.velocity == pytest.approx([1.0, 0.0, 0.0])
    assert px4.spin == pytest.approx([0.1, -0.2, -0.3])
    # In NED east is +y: a yaw of 90 degrees about down.
    assert np.abs(px4.attitude) == pytest.approx([np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)])
    assert rotated(px4.attitude, (1.0, 0.0, 0.0)) == pytest.approx([0.0, 1.0, 0.0])
    assert rotated(px4.attitude, (0.0, 0.0, 1.0)) == pytest.approx([0.0, 0.0, 1.0])
    for ours, theirs in zip(facing_east, swapped(px4), strict=True):
        assert theirs == pytest.approx(ours)


@pytest.mark.parametrize("robot", ["ros", "odometry", "px4"])
def test_a_motion_survives_its_messages(robot: RobotName) -> None:
    random = np.random.default_rng(3)
    q = random.normal(size=4)
    motion = Motion(
        random.normal(size=3), q / np.linalg.norm(q), random.normal(size=3), random.normal(size=3)
    )
    ends = interface(robot, 8, 8)
    found: dict[str, Any] = {}
    for message in ends.state(motion, 12_345_678_000):
        assert ends.inputs[message.topic] == message.kind
        reading = ends.read(message.topic, message.data)
        assert reading.measured == 12_345_678_000
        found |= {k: v for k, v in reading._asdict().items() if v is not None}
    assert found["position"] == pytest.approx(motion.position, abs=1e-6)
    assert found["velocity"] == pytest.approx(motion.velocity, abs=1e-6)
    assert found["spin"] == pytest.approx(motion.spin, abs=1e-6)
    assert abs(found["attitude"] @ motion.attitude) == pytest.approx(1.0)


@pytest.mark.parametrize("robot", ["ros", "pose", "odometry", "px4", "roboran", "pingu"])
def test_a_command_survives_its_messages(robot: RobotName) -> None:
    command = np.array([1.0, 0, 0, 1, 1, 0, 1, 0])
    ends = interface(robot, 8, 8)
    found = [
        one
        for message in ends.command(command.tolist(), 10**9)
        if (one := ends.commanded(message.topic, message.data)) is not None
    ]
    np.testing.assert_array_equal(found, [command])


def test_messages_of_laboratories() -> None:
    """By hand: RoboRAN's valve 5 is the agent's thruster 0; Pingu's thrusters follow bearing and enable."""
    row = unpack(
        "std_msgs/msg/Int16MultiArray",
        interface("roboran", 8, 8).command([1.0] + [0] * 7, 0)[0].data,
    )
    assert row.data.tolist() == [1, 0, 0, 0, 0, 0, 1, 0, 0]
    row = unpack(FLOATS, interface("pingu", 8, 8).command([0.0, 1.0] + [0] * 6, 0)[0].data)
    assert row.data.tolist() == [1, 1, 0, 1] + [0] * 11
    motors = interface("px4", 8, 8).command([0.0, 0.5] + [0] * 6, 5_000)[1]
    assert len(motors.data) == 72  # as PX4's agent has it
    assert np.isnan(unpack(PX4_MOTORS, motors.data).control[0])
    assert unpack(PX4_MOTORS, motors.data).control[1] == 0.5


# Velocities from poses


def test_velocities_from_poses_settle_on_the_truth() -> None:
    """A body that moves steadily and turns, measured with noise at irregular times."""
    random = np.random.default_rng(0)
    velocity = np.array([0.2, -0.1, 0.0])
    filtered = VelocityFilter((0.05, 0.2), (0.001, 0.002))
    motion = None
    time = 0
    for _ in range(400):
        time += int(random.uniform(5e6, 15e6))
        seconds = time * 1e-9
        position = velocity * seconds + random.normal(0, 0.001, 3)
        attitude = quaternion_of(0.5 * seconds + random.normal(0, 0.002))
        motion = filtered.update(time, position, attitude)
    assert motion is not None
    # Steady state of this filter at 100 poses a second: a velocity's variance is sqrt(2) q^1.5 r^0.5, where q is
    # the density of the acceleration, 0.05 m/s^2 for a second, and r that of the noise, 1 mm at 100 Hz.
    expected = np.sqrt(np.sqrt(2.0) * 0.05**1.5 * (0.001 * 0.1) ** 0.5)
    assert np.abs(motion.velocity - velocity).max() < 4.0 * expected
    assert motion.spin[2] == pytest.approx(0.5, abs=0.1)


def test_velocities_follow_a_push() -> None:
    """Within a fifth of a second of a thruster's opening, exactly measured."""
    filtered = VelocityFilter((0.2, 1.0), (0.001, 0.002))
    motion = None
    for k in range(300):
        seconds = k * 0.01
        pushed = max(0.0, seconds - 2.0)
        position = np.array([0.5 * 0.2 * pushed**2, 0.0, 0.0])
        motion = filtered.update(k * 10_000_000, position, quaternion_of(0.0))
    assert motion is not None
    assert motion.velocity[0] == pytest.approx(0.2 * 0.99, abs=0.2 * 0.2)


# Deciding


def steps(pilot: MessagePilot, motion: Motion, count: int = 3, begin: int = 0) -> list[Any]:
    """Decisions with a fresh state before each."""
    found = []
    for k in range(begin, begin + count):
        now = (k + 1) * round(pilot.period * 1e9)
        for message in pilot.interface.state(motion, now):
            pilot.receive(message.topic, message.data, now)
        found.append(pilot.decide(now))
    return found


def test_it_gives_the_agents_commands(agent: Path) -> None:
    """The same as the agent here gives to the observation of this state, written by hand."""
    from rans.evaluation.fly.agent import load_policy

    pilot = MessagePilot(plan_for(agent, goal=(0.5, -0.5, 30.0)), GoToPose())
    (decision, *_) = steps(pilot, AWAY)
    turn = np.radians(30.0) - 0.5
    row = [np.cos(0.5), np.sin(0.5), 0, 0, 0, 1, -1.5, -1.5, np.cos(turn), np.sin(turn)]
    controller = load_policy(pretrained_folder("go-to-pose-2d")).controller
    controller.reset(1)
    expected = controller.act(None, None, np.array([row], np.float32))[0]
    np.testing.assert_array_equal(decision.command, expected)
    assert decision.command.any()
    assert decision.note == ""


def test_what_is_wrong_shuts_the_valves(agent: Path) -> None:
    def fresh() -> MessagePilot:
        pilot = MessagePilot(plan_for(agent), GoToPose())
        assert steps(pilot, AWAY)[-1].command.any()
        return pilot

    second = 10**9

    pilot = MessagePilot(plan_for(agent), GoToPose())
    assert not pilot.decide(second).command.any()
    late = pilot.decide(12 * second)
    assert (late.over, late.command.any()) == (True, False)
    assert late.note == "no state came on pose and twist for 11.00 s: valves shut."

    pilot = fresh()  # last state at 0.6 s
    stale = pilot.decide(round(0.9 * second))
    assert (stale.over, stale.command.any()) == (False, False)
    assert "the state on pose and twist is 0.30 s old, more than the 0.2 s" in stale.note
    assert steps(pilot, AWAY, 1, begin=5)[0].command.any()  # and on it goes

    lost = fresh().decide(2 * second)
    assert (lost.over, lost.command.any()) == (True, False)
    assert "the robot is lost: its last state on pose and twist is 1.40 s old" in lost.note

    pilot = fresh()
    for k in range(4, 40):  # the same reading published again is none
        for message in pilot.interface.state(AWAY, round(0.6 * second)):
            pilot.receive(message.topic, message.data, k * second // 5)
    assert "the robot is lost" in pilot.decide(8 * second).note

    pilot = fresh()
    slow = []
    for k in range(25):
        now = (2 + k) * round(0.35 * second)
        for message in pilot.interface.state(AWAY, now):
            pilot.receive(message.topic, message.data, now)
        slow.append(pilot.decide(now))
    assert slow[-1].over
    assert "come every 0.35 s, but the agent decides every 0.2 s" in slow[-1].note

    pilot = fresh()
    nan = AWAY._replace(velocity=np.array([np.nan, 0, 0]))
    assert "twist: the velocity is (nan, 0, 0)" in steps(pilot, nan, 1, begin=3)[0].note


@pytest.mark.parametrize(
    ("craft", "period", "sentence"),
    [
        ("atmos", 0.2, "the robot is the spacecraft atmos"),
        (PLATFORM, 0.1, "takes a command every 0.1 s, but the agent gives one every 0.2 s"),
    ],
)
def test_another_robot_is_refused(agent: Path, craft: str, period: float, sentence: str) -> None:
    pilot = MessagePilot(plan_for(agent), GoToPose())
    assert steps(pilot, AWAY)[-1].command.any()
    about = {
        "sha256": craft_hash(load_spacecraft(craft)),
        "control_period": period,
        "name": craft,
    }
    pilot.receive(CRAFT_TOPIC, pack(TEXT, make(TEXT, data=json.dumps(about))), 0)
    decision = steps(pilot, AWAY, 1, begin=3)[0]
    assert (decision.over, decision.command.any()) == (True, False)
    assert sentence in decision.note


def test_bytes_that_are_no_message(agent: Path) -> None:
    pilot = MessagePilot(plan_for(agent), GoToPose())
    steps(pilot, AWAY)
    for topic in pilot.inputs:
        pilot.receive(topic, b"\x00\x01\x00\x00nonsense", 0)
    assert pilot.decide(700_000_000).note


# The twin


def test_a_twin_has_latency_noise_and_faults() -> None:
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


@pytest.mark.parametrize("engine", ["fast", "drake"])
def test_both_engines_are_the_same_robot(engine: Any) -> None:
    """A pulse of 0.2 s of two thrusters, by hand: 2 N on 5.32 kg."""
    craft = load_spacecraft(PLATFORM)
    twin = Craft(TwinPlan(craft, 0.2, engine=engine, start=(0.0, 0.0, 0.0), rate=20.0))
    wrench = np.array(craft.wrench_map)
    straight = next(
        (a, b)
        for a in range(8)
        for b in range(a)
        if np.allclose(wrench[a][:2], wrench[b][:2]) and abs(wrench[a][2] + wrench[b][2]) < 1e-9
    )
    command = np.zeros(8)
    command[list(straight)] = 1.0
    twin.hold(command)
    for _ in range(4):
        twin.advance()
    expected = 2.0 * wrench[straight[0]][:2] * 0.2 / craft.mass
    assert twin.motion.velocity[:2] == pytest.approx(expected, rel=1e-6)


def test_duties_of_pulsed_thrusters_fall_into_steps() -> None:
    """37 % of a period of 0.1 s at steps of 10 ms: three whole ones, then seven tenths."""
    twin = Craft(TwinPlan(load_spacecraft("atmos"), 0.1))
    twin.hold(np.array([0.37, 0, 0, 0, 0, 0, 0, 0]))
    given = [twin.advance()[0] for _ in range(10)]
    assert given == pytest.approx([1, 1, 1, 0.7, 0, 0, 0, 0, 0, 0])


# The safety filter

ZONES = (1.5, 0.0, 0.4, 60.0, 60.0, 0.4, -60.0, 60.0, 0.4)
"""One zone between start and goal, and two far away: the agent observes three."""


@pytest.fixture(scope="module")
def avoider(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The shipped agent of avoid, as a node flies it."""
    folder = tmp_path_factory.mktemp("avoider") / "avoid-2d"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("rans.deploy.robot.pilot._RANGE_FLIGHTS", 64)
        export_for_flight(pretrained_folder("avoid-2d"), folder)
    return folder


def avoiding(folder: Path, **changes: Any) -> Plan:
    settings: dict[str, Any] = {"zones": ZONES} | changes
    return Plan(str(folder), {"name": "avoid", "settings": {}}, **settings)


class Forward:
    """An agent that opens every thruster which pushes along -x, towards the zone."""

    note = ""

    def __init__(self, craft: Any) -> None:
        self._command = (np.array(craft.wrench_map)[:, 0] < -1e-6).astype(np.float32)

    def reset(self) -> None:
        """Nothing to forget."""

    def act(self, observation: np.ndarray) -> np.ndarray:
        return self._command


@pytest.mark.parametrize("guard", [False, True])
def test_no_agent_enters_a_zone_behind_the_filter(guard: bool, avoider: Path) -> None:
    """Distances by hand, of the twin's motion."""
    pilot = MessagePilot(avoiding(avoider, guard=guard), Avoid())
    pilot.agent = Forward(pilot.craft)
    twin = Craft(TwinPlan(pilot.craft, 0.2, start=(3.0, 0.1, 0.0), rate=25.0))
    nearest = np.inf
    replaced = 0
    for k in range(60):
        decision = steps(pilot, twin.motion, 1, begin=k)[0]
        replaced += decision.guarded
        twin.hold(decision.command)
        for _ in range(5):
            twin.advance()
            nearest = min(nearest, float(np.hypot(*(twin.motion.position[:2] - (1.5, 0.0)))))
    assert (nearest > 0.4) == guard
    assert (replaced > 0) == guard


@pytest.mark.slow
def test_a_filtered_flight_comes_out_of_its_bag_again(avoider: Path, tmp_path: Path) -> None:
    bag = tmp_path / "flight.mcap"
    plan = avoiding(avoider, guard=True, lost_after=5.0)
    # It moves so fast towards the zone that the filter must act at once.
    fast = AWAY._replace(position=np.array([2.1, 0.0, 0.0]), velocity=np.array([-0.45, 0.0, 0.0]))
    wire = Wire()
    ends = interface("ros", 8, 8)
    stop = threading.Event()

    def publish() -> None:
        while not stop.wait(0.04):
            for message in ends.state(fast, time.time_ns()):
                wire.publish(*message)

    robot = threading.Thread(target=publish)
    robot.start()
    try:
        report = fly_over(wire, plan, bag, 1.5, lambda _: None)
    finally:
        stop.set()
        robot.join()
    assert report.guarded
    assert "safety filter" in report.text()
    again = replay_bag(bag)
    assert again.decisions == report.decisions
    assert again.equal == again.decisions


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"zones": ()}, "9 numbers"),
        ({"zones": (*ZONES[:8], 0.0)}, "above 0"),
    ],
)
def test_zones_that_are_missing(changes: dict[str, Any], sentence: str, avoider: Path) -> None:
    with pytest.raises(ConfigError, match=sentence):
        MessagePilot(avoiding(avoider, **changes), Avoid())


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"goal": (math.nan, 0.0, 0.0)}, "numbers of a goal must be finite"),
        ({"goal_velocity": (0.0, math.inf, 0.0)}, "goal's velocity must be finite"),
        ({"zones": (1.0, math.nan, 1.0)}, "numbers of a zone must be finite"),
        ({"lost_after": math.nan}, "--lost-after must be a finite number above 0, got nan"),
        ({"wait": 0.0}, "--wait must be a finite number above 0, got 0.0"),
    ],
)
def test_a_plan_of_wild_numbers_is_refused(
    changes: dict[str, Any], sentence: str, tmp_path: Path
) -> None:
    with pytest.raises(ConfigError, match=sentence):
        plan_for(tmp_path, **changes)


@pytest.mark.parametrize(
    "changes",
    [{"rate": math.inf}, {"seconds": math.nan}, {"start": (math.nan, 0.0, 0.0)}],
)
def test_a_twin_of_wild_numbers_is_refused(changes: dict[str, Any]) -> None:
    with pytest.raises(ConfigError, match="finite"):
        TwinPlan(load_spacecraft(PLATFORM), 0.2, **changes)
    with pytest.raises(ConfigError, match="--period must be a finite number above 0"):
        TwinPlan(load_spacecraft(PLATFORM), 0.0)


@pytest.mark.parametrize(
    ("option", "value", "sentence"),
    [
        ("--episode", "-1", "--episode must be a whole number >= 0 and < 2^31, got -1."),
        ("--episode", str(2**31), "--episode must be a whole number >= 0 and < 2^31"),
        ("--seed", str(2**64), "the seed must be a whole number of at most 64 bits"),
    ],
)
def test_a_twin_of_no_episode_is_refused(
    option: str, value: str, sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Before a bus is opened: such an episode would be flown as another one, or end in a traceback."""
    assert main(["twin", "floating-platform", "--bus", "udp", option, value]) != 0
    assert sentence in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"goal": ("1", "2")}, "--goal takes x, y and heading"),
        ({"goal": ("1", "2deg", "3")}, "'2deg' is an angle where a length must be"),
        ({"bus": "udp:7"}, "--bus takes dds, zenoh, udp or zenoh:LOCATOR"),
        ({"seconds": math.nan}, "--seconds must be a finite number above 0"),
        ({"trade_off": 0.3}, "no trade-off input"),
        ({"guard": True}, "has none"),
    ],
)
def test_nothing_is_written_for_a_flight_that_cannot_begin(
    options: dict[str, Any], sentence: str, tmp_path: Path
) -> None:
    output = tmp_path / "flight"
    with pytest.raises(ConfigError, match=sentence):
        Fly("pretrained:go-to-pose-2d", **{"bus": "udp", "output": output} | options).run()
    assert not output.exists()


def test_the_bus_is_that_of_the_robots_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[tuple[Any, ...]] = []
    monkeypatch.setattr("rans.deploy.robot.bus.open_bus", lambda *given: opened.append(given))
    monkeypatch.setenv("ROS_DOMAIN_ID", "7")
    monkeypatch.setenv("ROS_DISTRO", "humble")
    opened_bus("zenoh:listen/tcp/0.0.0.0:7447", None, "", None)
    opened_bus("dds", 3, "", None)
    assert opened == [("zenoh", 7, "listen/tcp/0.0.0.0:7447", "humble"), ("dds", 3, "", "humble")]
    monkeypatch.setenv("ROS_DISTRO", "noetic")
    opened_bus("udp", None, "", None)  # no distribution matters here
    with pytest.raises(ConfigError, match="ROS_DISTRO must be one of humble"):
        opened_bus("zenoh", None, "", None)
    monkeypatch.setenv("ROS_DOMAIN_ID", "seven")
    with pytest.raises(ConfigError, match="ROS_DOMAIN_ID must be a whole number, got 'seven'"):
        opened_bus("dds", None, "", None)


def test_what_no_filter_keeps_is_refused(agent: Path) -> None:
    with pytest.raises(ConfigError, match="has none"):
        MessagePilot(plan_for(agent, guard=True), GoToPose())
    with pytest.raises(ConfigError, match="no keep-out zones"):
        MessagePilot(plan_for(agent, zones=ZONES), GoToPose())


# Flights, bags and buses


def flown(
    wire: Any, agent: Path, bag: Path, seconds: float, **changes: Any
) -> tuple[Any, Motion, list[str]]:
    """A flight of a node against a twin, as two threads."""
    said: list[str] = []
    stop = threading.Event()
    plan = TwinPlan(load_spacecraft(PLATFORM), 0.2, start=(0.3, 0.2, 10.0), rate=25.0, **changes)
    ends: list[Motion] = []
    other = changes.get("robot", "ros")
    twin = threading.Thread(
        target=lambda: ends.append(run_twin(wire, plan, said.append, stop.is_set))
    )
    twin.start()
    try:
        report = fly_over(
            wire, plan_for(agent, robot=other, lost_after=5.0), bag, seconds, said.append
        )
    finally:
        stop.set()
        twin.join()
    return report, ends[0], said


@pytest.mark.slow
@pytest.mark.parametrize("robot", ["ros", "pose"])
def test_a_flight_and_its_bag(agent: Path, tmp_path: Path, robot: RobotName) -> None:
    bag = tmp_path / "flight.mcap"
    report, _, _ = flown(Wire(), agent, bag, 3.0, robot=robot)
    assert report.fault == ""
    assert report.decisions >= 5
    kept = list(bag_entries(bag))
    topics = {entry.topic for entry in kept}
    assert {"rans/flight", "pose", "commands", END_TOPIC} <= topics
    again = replay_bag(bag)
    assert again.decisions == report.decisions
    assert (again.equal, again.first_difference) == (again.decisions, None)

    # A bag whose process was killed.
    short = tmp_path / "killed.mcap"
    short.write_bytes(bag.read_bytes()[: int(bag.stat().st_size * 0.6)])
    again = replay_bag(short)
    assert 0 < again.decisions < report.decisions
    assert again.equal == again.decisions
    # It may have been killed anywhere in a message.
    whole = short.read_bytes()
    for cut in range(1, 200):
        short.write_bytes(whole[:-cut])
        assert [*bag_entries(short)] == kept[: len([*bag_entries(short)])]


def test_a_bag_that_was_changed_does_not_come_out(agent: Path, tmp_path: Path) -> None:
    bag = tmp_path / "flight.mcap"
    flown(Wire(), agent, bag, 2.0)
    shut = pack(FLOATS, array(FLOATS, np.zeros(8), np.float32))
    data = bag.read_bytes()
    moved = [e for e in bag_entries(bag) if e.topic == "commands" and e.data != shut]
    assert moved
    changed = bytearray(moved[0].data)
    changed[-1] ^= 0x40
    bag.write_bytes(data.replace(moved[0].data, bytes(changed), 1))
    assert replay_bag(bag).first_difference is not None


def test_mcaps_own_reader_opens_a_bag(agent: Path, tmp_path: Path) -> None:
    from mcap.reader import make_reader

    bag = tmp_path / "flight.mcap"
    flown(Wire(), agent, bag, 1.0)
    with bag.open("rb") as stream:
        reader = make_reader(stream)
        summary = reader.get_summary()
        assert summary is not None
        names = {schema.name for schema in summary.schemas.values()}
        assert {"geometry_msgs/msg/PoseStamped", FLOATS} <= names
        count = sum(1 for _ in reader.iter_messages())
    assert count == len(list(bag_entries(bag)))


def _buses(name: str) -> tuple[Any, Any]:
    if name == "udp":
        return open_bus("udp", 37), open_bus("udp", 37)
    if name == "zenoh":
        pytest.importorskip("zenoh")
        first = open_bus("zenoh", 0, "listen/tcp/127.0.0.1:17491")
        return first, open_bus("zenoh", 0, "tcp/127.0.0.1:17491")
    pytest.importorskip("cyclonedds")
    os.environ.setdefault(
        "CYCLONEDDS_URI",
        "<CycloneDDS><Domain><General><Interfaces><NetworkInterface name='lo' multicast='false'/>"
        "</Interfaces><AllowMulticast>false</AllowMulticast></General><Discovery><ParticipantIndex>auto"
        "</ParticipantIndex><Peers><Peer address='127.0.0.1'/></Peers></Discovery></Domain></CycloneDDS>",
    )
    return open_bus("dds", 77), open_bus("dds", 77)


@pytest.mark.parametrize("name", ["udp", "zenoh", "dds"])
def test_every_type_crosses_every_bus(name: str) -> None:
    """The bytes that arrive are those that were sent."""
    first, second = _buses(name)
    try:
        motion = AWAY._replace(spin=np.array([0.0, 0.0, 0.25]))
        sent = []
        for robot in ("ros", "odometry", "px4", "roboran"):
            ends = interface(robot, 8, 8)
            sent += [*ends.state(motion, 10**9), *ends.command([1.0] + [0.0] * 7, 10**9)]
        got: dict[str, bytes] = {}
        for message in sent:
            second.subscribe(
                message.topic, message.kind, lambda data, m=message: got.update({m.topic: data})
            )
        wanted = {message.topic: message.data for message in sent}
        deadline = time.monotonic() + 10.0
        while len(got) < len(wanted) and time.monotonic() < deadline:
            for message in sent:
                first.publish(*message)
            time.sleep(0.1)
        assert {topic: len(data) for topic, data in got.items()} == {
            topic: len(data) for topic, data in wanted.items()
        }
        for message in sent:
            if message.topic in ("pose", "twist"):
                continue  # sent by two kinds of robots
            assert got[message.topic] == wanted[message.topic]
    finally:
        first.close()
        second.close()


def test_types_have_the_hashes_of_ros() -> None:
    """Of std_msgs/msg/String, as every distribution since Iron prints it."""
    assert types().hash_rihs01(TEXT) == (
        "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
    )


def start(command: list[str], folder: Path) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "rans", *command],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[3])},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


def until(holds: Callable[[], bool], seconds: float = 60.0) -> None:
    deadline = time.monotonic() + seconds
    while not holds():
        assert time.monotonic() < deadline, "it took too long"
        time.sleep(0.05)


@pytest.mark.slow
@pytest.mark.parametrize("killed", ["node", "twin"])
def test_a_kill_of_either_side_shuts_the_valves(killed: str, agent: Path, tmp_path: Path) -> None:
    """Two processes over UDP; one is ended by SIGKILL while valves are open."""
    domain = {"node": "41", "twin": "42"}[killed]
    monitor = UDPBus(int(domain))
    valves: list[bool] = []
    commands: list[bool] = []
    monitor.subscribe(VALVES_TOPIC, FLOATS, lambda x: valves.append(any(unpack(FLOATS, x).data)))
    monitor.subscribe("commands", FLOATS, lambda x: commands.append(any(unpack(FLOATS, x).data)))
    shared = ["--bus", "udp", "--domain", domain]
    twin = start(["twin", PLATFORM, *shared, "--start", "4", "0", "0", "--rate", "25"], tmp_path)
    node = start(
        ["fly", str(agent), "--trust", *shared, "--output", "flight", "--wait", "60"], tmp_path
    )
    try:
        until(lambda: any(commands[-5:]) and any(valves[-5:]))
        victim, survivor = (node, twin) if killed == "node" else (twin, node)
        victim.send_signal(signal.SIGKILL)
        victim.wait()
        if killed == "node":
            until(lambda: len(valves) > 3 and not any(valves[-3:]), 10.0)
        else:
            assert survivor.wait(30.0) == 1
            assert not any(commands[-3:])
        survivor.send_signal(signal.SIGTERM)
        text, _ = survivor.communicate(timeout=30)
        assert "valves shut" in " ".join(text.split())
    finally:
        for process in (twin, node):
            process.kill()
            process.communicate()
        monitor.close()


def test_one_sentence_for_what_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    for module, name in (("zenoh", "zenoh"), ("cyclonedds.core", "dds")):
        monkeypatch.setitem(sys.modules, module, None)
        with pytest.raises(ConfigError, match=r"pip install 'rans\[robot\]'"):
            open_bus(name)  # type: ignore[arg-type]
    with pytest.raises(ConfigError, match="domain must be a whole number from 0 to 232"):
        open_bus("udp", 500)
    with pytest.raises(ConfigError, match="has 12 thrusters and no wheel"):
        interface("px4", 16, 16)


def test_states_and_motions_are_the_same() -> None:
    """Of a state in space."""
    twin = Craft(TwinPlan(load_spacecraft("free-flyer"), 0.2, start=(1.0, 2.0, 3.0)))
    assert twin.motion.position == pytest.approx([1.0, 2.0, 3.0])
    assert motion_of(twin._now.state).attitude == pytest.approx([1.0, 0.0, 0.0, 0.0])
