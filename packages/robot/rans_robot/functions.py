"""Functions behind the commands of this package: agents on robots, twins, and spacecraft from logs of flights.

Arguments and their texts are those of the commands (`rans.cli.door`); a new one needs its line in "Args:".
"""

from __future__ import annotations

import contextlib
import shlex
import time
from collections.abc import Sequence
from dataclasses import asdict
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rans import load_spacecraft
from rans.api.states import read_state, read_zones
from rans.extend import (
    ConfigError,
    Spacecraft,
    SpacecraftLike,
    Terminal,
    brief,
    positive,
    ready_folder,
    settled_alone,
)
from rans_robot.interfaces import RobotName

if TYPE_CHECKING:
    from rans_robot.frames import Motion
    from rans_robot.identify.log import FlightLog
    from rans_robot.identify.result import Identification
    from rans_robot.node import BagReplay, Report


_SPATIAL = ("v.x", "v.y", "v.z", "w.x", "w.y", "w.z")


@settled_alone
def identify(
    logs: str | Path | FlightLog | Sequence[str | Path | FlightLog],
    spacecraft: SpacecraftLike,
    robot: RobotName | None = None,
    window: float | None = None,
    namespace: str = "",
) -> Identification:
    """Identify forces, inertia, centre of mass, delays and disturbances of a spacecraft from logs of its flights.

    Motion determines forces and inertia only in proportion to the mass: the mass of ``spacecraft`` must be right.

    >>> with tempfile.NamedTemporaryFile("w", suffix=".csv") as log:
    ...     print("time,x,y,heading", *(f"u{k}" for k in range(8)), sep=",", file=log)
    ...     for k in range(30):
    ...         print(0.2 * k, 0.01 * k, 0.0, 0.0, *(0,) * 8, sep=",", file=log)
    ...     log.flush()
    ...     found = rans.identify(log.name, "floating-platform")
    >>> found.channels()[0].after < 1e-4
    True

    Args:
        logs: bags (.mcap) of `rans fly` or ROS 2, folders of `ros2 bag record`, or CSV
            files with the columns time, x, y, heading (in space x, y, z, qw, qx, qy, qz), u0, u1, ... and
            perhaps velocities.
        spacecraft: data sheet from which to begin: a name, or a TOML file.
        robot: kind of robot whose topics a bag has; by default the bag says it, or ros.
        window: the log is predicted over windows of this length, s; None: of 5 s, doubled while the model explains
            the readings.
        namespace: name before the topics of the robot in a bag, such as robot1 for /robot1/pose.

    Raises:
        ConfigError: a log cannot be read or is not of this spacecraft, or the spacecraft has no thruster, wheels,
            propellant, or effectors of other kinds.
    """
    from rans_robot.identify.fit import fit
    from rans_robot.identify.log import FlightLog
    from rans_robot.identify.result import Identification

    if window is not None:
        positive("window", window)
    # One fit over all logs, each checked by itself.
    craft = load_spacecraft(spacecraft)
    sources = [logs] if isinstance(logs, str | Path | FlightLog) else list(logs)
    return Identification(
        fit(
            craft,
            [
                source if isinstance(source, FlightLog) else _read(source, craft, robot, namespace)
                for source in sources
            ],
            window,
        )
    )


def fly_on_robot(
    agent: str,
    *,
    bus: str = "dds",
    robot: RobotName = "ros",
    goal: Sequence[str | float] = (),
    zones: Sequence[str] = (),
    guard: bool = False,
    seconds: float | None = None,
    output: str | Path | None = None,
    trust: bool = False,
) -> Report:
    """Fly an agent on a robot over ROS 2, PX4 or Zenoh, and record the flight as an MCAP bag.

    Args:
        agent: run folder, name of an agent of RANS, onnx:FILE:TASK-2d@SPACECRAFT (a network of another library),
            the folder of an export as onnx, or with --trust one as numpy. #TASK
            selects one of the tasks of a multi-task agent.
        bus: transport: dds (ROS 2 and PX4), zenoh (rmw_zenoh) or udp (within this machine), in the domain
            ROS_DOMAIN_ID and for the distribution ROS_DISTRO. zenoh:LOCATOR connects to another router than ROS 2's
            on this machine, such as zenoh:tcp/192.168.0.2:7447; zenoh:listen/LOCATOR listens there.
        robot: messages of the robot: ros (poses and twists), pose (poses alone), odometry (nav_msgs), px4 (odometry
            and motors), or those of the RoboRAN platform or of Pingu.
        goal: goal: x, y (m) and heading, such as 3 1 40deg, in space x, y, z, roll, pitch, yaw; angles are in
            degrees, or with a unit, such as 0.7rad. Velocities of a goal that moves follow by name: v.x=0.1 (m/s),
            w=0.1 (rad/s). By default the origin.
        zones: fixed keep-out zones for agents that avoid some, m; a radius includes that of the spacecraft.
        guard: whether to apply the safety filter, which replaces commands that would lead to a violated constraint
            (docs/missions/guard.md).
        seconds: length of the flight, s; by default until Ctrl-C.
        output: new folder for the bag and the exported agent; by default runs/flights/AGENT-TIME.
        trust: see `rans.api.judging.compare`.

    Raises:
        ConfigError: the flight cannot begin: nothing is written then.
    """
    from rans.deploy.export import write_export
    from rans.evaluation.fly.exported import is_exported
    from rans.extend import ContestantName, RunFolder, contestant, doing, read_contract
    from rans.fast.learn.config import to_table
    from rans_robot.bus import open_bus, ros_domain
    from rans_robot.foreign import task_name, write_foreign_export
    from rans_robot.node import fly_over, planned_task
    from rans_robot.pilot import Plan, check_plan, runs_code
    from rans_robot.signals import stop_on_signals

    # Which agent, as an export or as a run folder, and its task.
    name = ContestantName.parse(agent)
    source = Path(name.name)
    is_foreign = name.kind == "policy"
    label = name.output_folder.name if is_foreign else source.name
    moment = time.strftime("%Y%m%d-%H%M%S")
    flight = Path(output or f"runs/flights/{label}-{moment}")
    if flight.exists():
        raise ConfigError(f"{flight} exists already: flights are never overwritten.")
    ready_folder(flight)
    if seconds is not None:
        positive("--seconds", seconds)
    part = name.part
    run = None
    folder = flight / "agent"
    task: dict[str, Any]
    if is_foreign:
        foreign = contestant(name.text)
        craft = foreign.craft
        period = foreign.timing.control_period
        task = {
            "name": task_name(name, foreign.task),
            "settings": asdict(foreign.task),  # pyrefly: ignore[bad-argument-type]
        }
    elif name.kind == "run folder" and is_exported(source):
        if (source / "agent.py").exists() and runs_code(source) and not trust:
            raise ConfigError(
                f"{source} is an export with code, agent.py: add --trust if you made it, or "
                "name the run folder."
            )
        folder = source
        craft = load_spacecraft(source / "spacecraft.toml")
        contract = read_contract(source)
        period = float(contract["control_period"])
        task = {"name": contract["task"], "settings": contract["settings"]}
    else:
        run = RunFolder(name.folder)
        config = run.config()
        craft = run.spacecraft()
        period = config.timing.control_period
        task = {"name": config.task, "settings": to_table(config)["settings"]}
    if part and part in task["settings"].get("tasks", ()):
        settings = task["settings"][part.replace("-", "_")]
        task = {"name": part, "settings": settings}
    elif "tasks" in task["settings"]:
        raise ConfigError(f"{agent} is a multi-task agent: pick one, as in {agent}#go-to-pose.")
    # A number after "#" is a trade-off, which the plan refuses for agents without one.
    try:
        trade_off = None if not part or part == task["name"] else float(part)
    except ValueError:
        raise ConfigError(f"{agent} is no multi-task agent: leave #{part} out.") from None
    # The flight.
    aim = read_state([*map(str, goal)], craft.dimension, "--goal")
    names = ("v.x", "v.y", "w") if craft.dimension == 2 else _SPATIAL
    velocity = tuple(aim.velocities.get(name, 0.0) for name in names)
    plan = Plan(
        folder=str(folder.resolve()),
        task=task,
        robot=robot,
        goal=aim.pose,
        goal_velocity=velocity if aim.velocities else (),
        zones=tuple(chain(*read_zones(zones, craft.dimension))),
        guard=guard,
        trade_off=trade_off,
        lost_after=max(1.0, 2.0 * period),
    )
    if run is not None or is_foreign:
        # Nothing is written for a flight that cannot begin.
        check_plan(plan, craft, planned_task(plan), period)
        open_bus(bus).close()
        _say(f"Writing the agent of this flight into {folder}.")
        with doing("flying it for the range of its observations"):
            if run is None:
                write_foreign_export(name.text, folder, episodes=0, name=label)
            else:
                write_export(run.path, folder, "numpy", episodes=0, name=run.path.name)
    # From here on a signal ends the flight with shut valves.
    stop = stop_on_signals()
    link = open_bus(bus)
    try:
        how = f"{bus} (ROS_DOMAIN_ID {ros_domain()})"
        _say(f"Flying {name} over {how}; Ctrl-C shuts the valves and ends the flight.")
        bag = flight / "flight.mcap"
        report = fly_over(link, plan, bag, seconds, _say, stop.is_set, how)
    finally:
        link.close()
    _say(report.text())
    _say(f"The flight is recorded in {bag}.")
    # Replay runs an agent that is code.
    again = ["rans", "replay", str(bag), *(["--trust"] if runs_code(folder) else [])]
    identify = ["rans", "identify", str(bag), "--spacecraft", str(folder / "spacecraft.toml")]
    report.next_commands = (shlex.join(again), shlex.join(identify))
    return report


def twin(
    spacecraft: SpacecraftLike,
    *,
    bus: str = "dds",
    robot: RobotName = "ros",
    period: float = 0.2,
    conditions: str | Path | None = None,
    rate: float = 100.0,
    start: Sequence[str | float] = (),
    seconds: float = 600.0,
    fault: str = "",
) -> Motion:
    """Simulate a robot for `rans fly`, which publishes its state on a bus and takes commands.

    Args:
        spacecraft: name of a spacecraft that comes with RANS, or your own TOML file.
        bus: see `fly_on_robot`.
        robot: see `fly_on_robot`.
        period: control period at which the robot takes commands, s.
        conditions: latency, noise, dropouts, faults and disturbances of the robot: a name (see `rans list
            CONDITIONS`), your own TOML file, or the run folder of an agent, whose training's conditions are taken.
        rate: number of states published per second.
        start: start at rest: x, y (m) and heading, such as 3 1 40deg, in space x, y, z and perhaps roll, pitch,
            yaw; angles are in degrees, or with a unit, such as 0.7rad. By default a sampled one.
        seconds: length of the simulation, s.
        fault: NAME:SECONDS, what fails and when, to see a node shut: frozen, dead, restart, two-senders, outliers,
            no-twist, slow-link or fast-clock.

    Raises:
        ConfigError: one of these does not exist, or a number is out of its range.
    """
    from rans import load_conditions
    from rans.extend import (
        RunFolder,
    )
    from rans_robot.bus import open_bus, ros_domain
    from rans_robot.signals import stop_on_signals
    from rans_robot.twin import TwinPlan, run_twin

    craft = load_spacecraft(spacecraft)
    # A run folder stands for the conditions of its training.
    met = None
    if conditions is not None and Path(conditions).is_dir():
        met = RunFolder(Path(conditions)).config().conditions
    elif conditions is not None:
        met = load_conditions(str(conditions), craft)
    begin = read_state([*map(str, start)], craft.dimension, "--start")
    if begin.velocities:
        raise ConfigError("--start of a twin is at rest: leave its velocities out.")
    plan = TwinPlan(
        craft=craft,
        control_period=period,
        robot=robot,
        conditions=met,
        rate=rate,
        start=begin.pose,
        seconds=seconds,
        fault=fault,
    )
    # Simulate until the time is up or a signal comes; the bus is closed in any event.
    stop = stop_on_signals()
    link = open_bus(bus)
    try:
        _say(
            f"{craft.name} is on {bus} (ROS_DOMAIN_ID {ros_domain()}), at {rate:g} states a second. Fly it from "
            f"another terminal: rans fly AGENT --bus {bus} --goal 1 0 90deg."
        )
        return run_twin(link, plan, _say, stop.is_set)
    finally:
        link.close()


def _say(text: str) -> None:
    """Say a sentence; a terminal that is gone ends no flight, and no bag's index."""
    with contextlib.suppress(OSError):
        Terminal().say(text)


def replay(bag: str | Path, folder: str | Path | None = None) -> BagReplay:
    """Give the messages of a `rans fly` bag to its agent again, at their times, and compare every command.

    Args:
        bag: MCAP file that `rans fly` wrote; it may end anywhere.
        folder: folder of the exported agent; by default the one that flew.

    Raises:
        ConfigError: the file is no bag of a flight, its agent is not there, or is an agent.py that is not trusted
            (`rans.base.registry.trust_files`).
    """
    from rans_robot.node import replay_bag

    return replay_bag(Path(bag), None if folder is None else Path(folder))


def _read(log: str | Path, craft: Spacecraft, robot: RobotName | None, namespace: str) -> FlightLog:
    """A log from a file or folder by its ending, in SI units and RANS's frames; `ConfigError` for others."""
    from rans_robot.identify.log import read_csv

    file = Path(log)
    if file.suffix == ".csv":
        return read_csv(file, craft)
    if file.suffix == ".mcap" or file.is_dir():
        from rans_robot.logs import read_bag

        return read_bag(file, craft, robot, namespace)
    raise ConfigError(
        f"a log is a bag (.mcap) or a bag's folder, or a CSV file (.csv), got {brief(str(file))}; "
        "`ros2 bag convert` writes .db3 as MCAP."
    )
