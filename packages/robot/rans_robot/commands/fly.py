"""``rans fly``: an agent in closed loop with a robot."""

from __future__ import annotations

import contextlib
import os
import time
from dataclasses import asdict, dataclass
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, cast, get_args

from tyro.conf import Positional, arg

from rans.cli.options import Trust
from rans.cli.states import POSE, read_state, read_zones
from rans.extend import ConfigError, brief, positive

if TYPE_CHECKING:
    from rans_robot.bus import Bus

Ros = Literal["humble", "jazzy", "kilted", "rolling"]
Robot = Literal["ros", "pose", "odometry", "px4", "roboran", "pingu"]
_SPATIAL = ("v.x", "v.y", "v.z", "w.x", "w.y", "w.z")


@dataclass(frozen=True)
class Fly:
    """Fly an agent on a robot over ROS 2, PX4 or Zenoh, and record the flight as an MCAP bag.

    The agent acts at its control rate. Any fault shuts all valves and is reported: a stale or missing state,
    another control rate or spacecraft, a lost robot. `rans twin` simulates a robot to test with.
    docs/robot/robots.md has a checklist for the first flight.
    """

    group = "Deploy"
    guide = "docs/robot/robots.md"
    examples = ("rans fly pretrained:go-to-pose-2d --goal 1 0 90deg",)

    agent: Annotated[str, Positional, arg(metavar="AGENT")]
    """Run folder, name of an agent of RANS, onnx:FILE:TASK-2d@SPACECRAFT (a network of another library), or with
    --trust the folder of an export as numpy. #TASK selects one of
    the tasks of a multi-task agent."""
    bus: Annotated[str, arg(metavar="BUS[:ADDRESS]")] = "dds"
    """Transport: dds (ROS 2 and PX4), zenoh (rmw_zenoh) or udp (within this machine), in the domain ROS_DOMAIN_ID
    and for the distribution ROS_DISTRO. zenoh:LOCATOR connects to another router than ROS 2's on this machine, such
    as zenoh:tcp/192.168.0.2:7447; zenoh:listen/LOCATOR listens there."""
    robot: Robot = "ros"
    """Messages of the robot: ros (poses and twists), pose (poses alone), odometry (nav_msgs), px4 (odometry
    and motors), or those of the RoboRAN platform or of Pingu."""
    goal: Annotated[tuple[str, ...], arg(metavar=POSE)] = ()
    """Goal: x, y (m) and heading, such as 3 1 40deg, in space x, y, z, roll, pitch, yaw; angles are in degrees, or
    with a unit, such as 0.7rad. Velocities of a goal that moves follow by name: v.x=0.1 (m/s), w=0.1 (rad/s). By
    default the origin."""
    zones: Annotated[tuple[str, ...], arg(metavar="X,Y,R...")] = ()
    """Fixed keep-out zones for agents that avoid some: centre and radius of each, such as 1.5,0.2,0.4, in space
    x,y,z,r, in m; a radius includes that of the spacecraft."""
    guard: bool = False
    """Apply the safety filter, which replaces commands that would lead to a violated constraint
    (docs/missions/guard.md)."""
    guard_slack: float | None = None
    """With --guard: least margin that it keeps, in the unit of each constraint (m or m/s); by default 0.002."""
    seconds: float | None = None
    """Length of the flight, s; by default until Ctrl-C."""
    output: Path | None = None
    """New folder for the bag and the exported agent; by default runs/flights/AGENT-TIME."""
    trust: Trust = False
    """Whether code that files name may run, by --trust."""

    def following(self) -> tuple[str, ...]:
        """See `rans.cli.commands.Command`."""
        return ("rans identify FLIGHT.mcap --spacecraft SPACECRAFT",)

    def run(self) -> int:
        """Fly; the exit code is 0, or 1 after a fault or if no state ever came."""
        from rans.evaluation.fly.exported import read_contract
        from rans.extend import ContestantName, RunFolder, Terminal, contestant, doing
        from rans.fast.learn.config import to_table
        from rans.model.spacecraft_file import load_spacecraft
        from rans.tasks import registered_name
        from rans_robot.bag import index_bag
        from rans_robot.foreign.export import export_foreign_for_flight
        from rans_robot.node import fly_over, planned_task
        from rans_robot.pilot import AGENT_FILES, Plan, check_plan, export_for_flight
        from rans_robot.signals import stop_on_signals

        def say(text: str) -> None:
            # A terminal that is gone ends no flight, and no bag's index.
            with contextlib.suppress(OSError):
                Terminal().say(text)

        # Which agent, as an export or as a run folder, and its task.
        name = ContestantName.parse(self.agent)
        label = Path(name.name).name
        output = self.output or Path("runs/flights") / f"{label}-{time.strftime('%Y%m%d-%H%M%S')}"
        if output.exists():
            raise ConfigError(f"{output} exists already: flights are never overwritten.")
        if self.seconds is not None:
            positive("--seconds", self.seconds)
        part = name.part
        source = Path(name.name)
        run = None
        is_foreign = name.kind == "policy"
        if is_foreign:
            label = name.output_folder.name
            output = self.output or output.with_name(f"{label}-{time.strftime('%Y%m%d-%H%M%S')}")
            folder = output / "agent"
            foreign = contestant(name.text)
            craft = foreign.craft
            period = foreign.timing.control_period
            task = {
                "name": registered_name(foreign.task) or name.setup.partition("@")[0],
                "settings": asdict(foreign.task),  # pyright: ignore[reportArgumentType]
            }
        elif name.kind == "run folder" and all((source / file).exists() for file in AGENT_FILES):
            if not self.trust:
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
            folder = output / "agent"
            config = run.config()
            craft = run.spacecraft()
            period = config.timing.control_period
            task = {"name": config.task, "settings": to_table(config)["settings"]}
        if part and part in task["settings"].get("tasks", ()):
            settings = task["settings"][part.replace("-", "_")]
            task = {"name": part, "settings": settings}
        elif "tasks" in task["settings"]:
            raise ConfigError(
                f"{self.agent} is a multi-task agent: pick one, as in {self.agent}#go-to-pose."
            )
        # A number after "#" is a trade-off, which the plan refuses for agents without one.
        try:
            trade_off = None if not part or part == task["name"] else float(part)
        except ValueError:
            raise ConfigError(f"{self.agent} is no multi-task agent: leave #{part} out.") from None
        # The flight.
        goal = read_state(self.goal, craft.dimension, "--goal")
        names = ("v.x", "v.y", "w") if craft.dimension == 2 else _SPATIAL
        velocity = tuple(goal.velocities.get(name, 0.0) for name in names)
        plan = Plan(
            folder=str(folder.resolve()),
            task=task,
            robot=self.robot,
            goal=goal.pose,
            goal_velocity=velocity if goal.velocities else (),
            zones=tuple(chain(*read_zones(self.zones, craft.dimension, "--zones"))),
            guard=self.guard,
            guard_slack=self.guard_slack,
            trade_off=trade_off,
            lost_after=max(1.0, 2.0 * period),
        )
        if run is not None or is_foreign:
            # Nothing is written for a flight that cannot begin.
            check_plan(plan, craft, planned_task(plan), period)
            bus = opened_bus(self.bus)
            bus.close()
            say(f"Writing the agent of this flight into {folder}.")
            with doing("flying it for the range of its observations"):
                if run is None:
                    export_foreign_for_flight(name.text, folder)
                else:
                    export_for_flight(run.path, folder)
        # From here on a signal ends the flight with shut valves.
        stop = stop_on_signals()
        bus = opened_bus(self.bus)
        try:
            link = f"{self.bus} (ROS_DOMAIN_ID {ros_domain()})"
            say(f"Flying {name} over {link}; Ctrl-C shuts the valves and ends the flight.")
            bag = output / "flight.mcap"
            report = fly_over(bus, plan, bag, self.seconds, say, stop.is_set, link)
        finally:
            bus.close()
        say(report.text())
        try:
            index_bag(bag)
        except ConfigError as error:
            say(f"The bag has no index, and tools read it from its beginning: {error}")
        say(f"The flight is recorded in {bag}; rans replay {bag} repeats its commands.")
        return 1 if report.fault else 0


def opened_bus(text: str) -> Bus:
    """A bus by the text of --bus, in the domain and for the distribution that ROS's environment names.

    Args:
        text: "dds", "zenoh", "udp", or "zenoh:LOCATOR".

    Raises:
        ConfigError: there is no such bus, or the environment has a wrong value.
    """
    from rans_robot.bus import BusName, open_bus

    kind, _, locator = text.partition(":")
    if kind not in get_args(BusName) or (locator and kind != "zenoh"):
        raise ConfigError(
            f"--bus takes dds, zenoh, udp or zenoh:LOCATOR, such as zenoh:tcp/192.168.0.2:7447, got {brief(text)}."
        )
    name = os.environ.get("ROS_DISTRO") or "jazzy"
    if kind == "zenoh" and name not in get_args(Ros):
        raise ConfigError(
            f"ROS_DISTRO must be one of {', '.join(get_args(Ros))} for zenoh, got {brief(name)}."
        )
    distribution = name if name in get_args(Ros) else "jazzy"  # which only zenoh reads
    return open_bus(cast("BusName", kind), ros_domain(), locator, cast("Ros", distribution))


def ros_domain() -> int:
    """The domain of ROS's environment, or 0.

    Raises:
        ConfigError: ROS_DOMAIN_ID is no whole number.
    """
    number = os.environ.get("ROS_DOMAIN_ID") or "0"
    if not number.isdecimal():
        raise ConfigError(f"ROS_DOMAIN_ID must be a whole number, got {brief(number)}.")
    return int(number)
