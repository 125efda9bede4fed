"""``rans fly``: an agent in closed loop with a robot."""

from __future__ import annotations

import contextlib
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional, arg

from rans.cli.options import Trust
from rans.errors import ConfigError, positive

Bus = Literal["dds", "zenoh", "udp"]
Ros = Literal["humble", "jazzy", "kilted", "rolling"]
Robot = Literal["ros", "pose", "odometry", "px4", "roboran", "pingu"]


@dataclass(frozen=True)
class Fly:
    """Fly an agent on a robot over ROS 2, PX4 or Zenoh, and record the flight as an MCAP bag.

    The agent acts at its control rate. Any fault shuts all valves and is reported: a stale or missing state,
    another control rate or spacecraft, a lost robot. `rans twin` simulates a robot to test with.
    docs/robots.md has a checklist for the first flight.
    """

    agent: Annotated[str, Positional, arg(metavar="AGENT")]
    """Run folder, name of an agent of RANS, or with --trust the folder of an export as numpy. #TASK selects one of
    the tasks of a multi-task agent."""
    bus: Bus = "dds"
    """Transport: dds (ROS 2 and PX4), zenoh (rmw_zenoh), or udp (within this machine)."""
    robot: Robot = "ros"
    """Messages of the robot: ros (poses and twists), pose (poses alone), odometry (nav_msgs), px4 (odometry
    and motors), or those of the RoboRAN platform or of Pingu."""
    goal: tuple[float, ...] = ()
    """Goal: x, y (m) and heading (degrees) in the plane; x, y, z, roll, pitch, yaw in space. By default the
    origin."""
    goal_velocity: tuple[float, ...] = ()
    """Velocity (m/s), then angular velocity (rad/s), of the goal, for agents that track a velocity."""
    zones: tuple[float, ...] = ()
    """Fixed keep-out zones for agents that avoid some: x, y (in space also z) and radius of each, m; a radius
    includes that of the spacecraft."""
    guard: bool = False
    """Apply the safety filter, which replaces commands that would lead to a violated constraint
    (docs/missions/guard.md)."""
    guard_slack: float | None = None
    """Least margin that the safety filter keeps, in the unit of each constraint (m or m/s); by default 0.002."""
    trade_off: float | None = None
    """Trade-off input of agents that have one, from 0 (fast) to 1 (fuel-efficient)."""
    seconds: float | None = None
    """Length of the flight, s; by default until Ctrl-C."""
    domain: int = 0
    """ROS 2 domain (ROS_DOMAIN_ID)."""
    address: str = ""
    """Zenoh locator to connect to, such as tcp/192.168.0.2:7447, or listen/LOCATOR; by default ROS 2's router on
    this machine, tcp/localhost:7447."""
    ros: Ros = "jazzy"
    """ROS 2 distribution that the other end runs, for Zenoh; rolling is also what came after Kilted."""
    wait: float = 10.0
    """Seconds to wait for the first state."""
    lost_after: float = 1.0
    """Seconds without a state after which the flight ends."""
    output: Path | None = None
    """New folder for the bag and the exported agent; by default runs/flights/AGENT-TIME."""
    trust: Trust = False
    """Whether code that files name may run, by --trust."""

    def run(self) -> int:
        """Fly; the exit code is 0, or 1 after a fault."""
        from rans.deploy.robot.bag import index_bag
        from rans.deploy.robot.bus import open_bus
        from rans.deploy.robot.node import fly_over, planned_task
        from rans.deploy.robot.pilot import AGENT_FILES, Plan, check_plan, export_for_flight
        from rans.deploy.robot.signals import stop_on_signals
        from rans.evaluation.fly.contestant_name import ContestantName
        from rans.evaluation.fly.exported import read_contract
        from rans.fast.learn.config import to_table
        from rans.fast.learn.run_folder import RunFolder
        from rans.terminal import Terminal

        def say(text: str) -> None:
            # A terminal that is gone ends no flight, and no bag's index.
            with contextlib.suppress(OSError):
                Terminal().say(text)

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
        if name.kind == "run folder" and all((source / file).exists() for file in AGENT_FILES):
            if not self.trust:
                raise ConfigError(
                    f"{source} is an export with code, agent.py: add --trust if you made it, or "
                    "name the run folder."
                )
            folder = source
            known = read_contract(source)
            task = {"name": known["task"], "settings": known["settings"]}
        else:
            run = RunFolder(name.folder)
            folder = output / "agent"
            config = run.config()
            task = {"name": config.task, "settings": to_table(config)["settings"]}
        if part and part in task["settings"].get("tasks", ()):
            settings = task["settings"][part.replace("-", "_")]
            task = {"name": part, "settings": settings}
        elif "tasks" in task["settings"]:
            raise ConfigError(
                f"{self.agent} is a multi-task agent: pick one, as in {self.agent}#go-to-pose."
            )
        plan = Plan(
            folder=str(folder.resolve()),
            task=task,
            robot=self.robot,
            goal=self.goal,
            goal_velocity=self.goal_velocity,
            zones=self.zones,
            guard=self.guard,
            guard_slack=self.guard_slack,
            trade_off=float(part)
            if part and self.trade_off is None and "trade_off" in task["settings"]
            else self.trade_off,
            lost_after=self.lost_after,
            wait=self.wait,
        )
        if run is not None:
            # Nothing is written for a flight that cannot begin.
            period = run.config().timing.control_period
            check_plan(plan, run.spacecraft(), planned_task(plan), period)
            bus = open_bus(self.bus, self.domain, self.address, self.ros)
            bus.close()
            say(f"Writing the agent of this flight into {folder}.")
            export_for_flight(run.path, folder)
        stop = stop_on_signals()
        bus = open_bus(self.bus, self.domain, self.address, self.ros)
        try:
            say(f"Flying {name} over {self.bus}; Ctrl-C shuts the valves and ends the flight.")
            bag = output / "flight.mcap"
            report = fly_over(bus, plan, bag, self.seconds, say, stop.is_set)
        finally:
            bus.close()
        say(report.text())
        try:
            index_bag(bag)
        except ConfigError as error:
            say(f"The bag has no index, and tools read it from its beginning: {error}")
        say(f"The flight is recorded in {bag}; rans replay {bag} repeats its commands.")
        return 1 if report.fault else 0
