"""Logs of flights from bags: what a robot published and what it was commanded."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rans.deploy.robot.bag import bag_entries
from rans.deploy.robot.interfaces import WHEELS_TOPIC, RobotName, interface, read_wheels
from rans.deploy.robot.messages import TEXT, unpack
from rans.deploy.robot.node import FLIGHT_TOPIC
from rans.errors import ConfigError
from rans.evaluation.identify.log import FlightLog
from rans.files import parse_json
from rans.model.spacecraft import Spacecraft


def read_bag(file: Path, craft: Spacecraft, robot: RobotName | None = None) -> FlightLog:
    """Log of an MCAP bag, of `rans fly` or of ``ros2 bag record``.

    Messages have the times at which they were recorded, by one clock. Speeds of reaction wheels are those of
    ``joint_states``, a sensor_msgs/JointState with one velocity a wheel.

    Args:
        file: the bag; it may end anywhere.
        craft: spacecraft, in whose order commands are.
        robot: kind of robot (`rans.deploy.robot.interfaces`); None: the bag says it, or "ros".

    Raises:
        ConfigError: the file is no bag, or none of its messages is a pose or a command of this kind of robot.
    """
    # Readings and commands by the time at which they were recorded, ns; parts that no message had are NaN. Rows are
    # position, attitude, velocity, spin and speeds of wheels.
    sizes = (3, 4, 3, 3, craft.wheel_count)
    kind: RobotName = robot or "ros"
    poses: dict[int, list[np.ndarray]] = {}
    commands: dict[int, np.ndarray] = {}
    ends = interface(kind, craft.command_count, craft.thruster_count)
    refused = ""
    is_of_rans = False
    for entry in bag_entries(file):
        if entry.topic == FLIGHT_TOPIC and robot is None:
            plan = parse_json(unpack(TEXT, entry.data).data, f"{file}, {FLIGHT_TOPIC}")
            ends = interface(plan.get("robot", kind), craft.command_count, craft.thruster_count)
            is_of_rans = True
            continue
        try:
            if entry.topic in ends.outputs:
                command = ends.commanded(entry.topic, entry.data)
                if command is not None:
                    commands[entry.time] = command
            elif entry.topic in ends.inputs:
                reading = ends.read(entry.topic, entry.data)
                columns = poses.setdefault(entry.time, [np.full(k, np.nan) for k in sizes])
                parts = reading.position, reading.attitude, reading.velocity, reading.spin
                for j, part in enumerate(parts):
                    if part is not None:
                        columns[j] = np.asarray(part, dtype=float)
            elif entry.topic == WHEELS_TOPIC and craft.wheels:
                columns = poses.setdefault(entry.time, [np.full(k, np.nan) for k in sizes])
                columns[4] = read_wheels(entry.data, craft.wheel_count)
        except ValueError as error:  # a message that the robot's node would refuse too
            refused = refused or f"; {entry.topic}: {error}"
    if not poses or not commands:
        needed = ", ".join([*ends.inputs, *ends.outputs])
        cause = (
            "no state came while `rans fly` recorded it, as when the robot or its twin was not there"
            if is_of_rans
            else "name the kind of robot with --robot"
        )
        raise ConfigError(
            f"the bag {file} has {len(poses)} readings and {len(commands)} commands on the topics "
            f"{needed}{refused}; {cause}."
        )
    # In the order of time, in seconds since the first.
    begin = min(*poses, *commands)
    times = np.array(sorted(poses))
    readings = [poses[time] for time in sorted(poses)]
    position, attitude, velocity, spin, speeds = (
        np.array([row[j] for row in readings]) for j in range(5)
    )
    given = np.array(sorted(commands))
    return log_in_space(
        file,
        craft,
        (given - begin) * 1e-9,
        np.array([commands[time] for time in sorted(commands)]),
        (times - begin) * 1e-9,
        (position, attitude, velocity, spin),
        None if np.isnan(speeds).all() else speeds,
    )


def log_in_space(
    file: Path,
    craft: Spacecraft,
    command_times: np.ndarray,
    commands: np.ndarray,
    times: np.ndarray,
    readings: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray],
    wheel_speeds: np.ndarray | None = None,
    notes: tuple[str, ...] = (),
) -> FlightLog:
    """Log of readings in space (M, 3), (M, 4), (M, 3), (M, 3), of which a planar craft has its plane.

    Speeds of wheels are (M, W), or None if none was measured.
    """
    position, attitude, velocity, spin = readings
    flat = craft.dimension == 2
    return FlightLog(
        str(file),
        command_times,
        commands,
        times,
        position[:, :2] if flat else position,
        2.0 * np.arctan2(attitude[:, 3], attitude[:, 0]) if flat else attitude,
        velocity[:, :2] if flat else velocity,
        spin[:, 2] if flat else spin,
        wheel_speeds,
        notes,
    )
