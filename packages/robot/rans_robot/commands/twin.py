"""``rans twin``: a simulated robot for tests of `rans fly`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional, arg

from rans.cli.states import POSE, read_state
from rans.extend import ConfigError
from rans_robot.commands.fly import Robot, opened_bus, ros_domain

Engine = Literal["fast", "drake"]


@dataclass(frozen=True)
class Twin:
    """Simulate a robot for `rans fly`, which publishes its state on a bus and takes commands.

    Its valves shut two and a half control periods after the last command.
    """

    group = "Deploy"
    guide = "docs/robot/robots.md"
    examples = ("rans twin floating-platform",)

    spacecraft: Annotated[str, Positional, arg(metavar="CRAFT")]
    """Name of the spacecraft, or its TOML file."""
    engine: Engine = "fast"
    """What computes the motion: RANS's own equations (fast), or Drake."""
    bus: Annotated[str, arg(metavar="BUS[:ADDRESS]")] = "dds"
    """Transport, as for `rans fly`: dds (ROS 2 and PX4), zenoh (rmw_zenoh), zenoh:LOCATOR, or udp (within this
    machine)."""
    robot: Robot = "ros"
    """Messages of the robot, as for `rans fly`."""
    period: float = 0.2
    """Control period at which the robot takes commands, s."""
    conditions: str | None = None
    """Latency, noise, dropouts, faults and disturbances of the robot: a name (see `rans list CONDITIONS`), your
    own TOML file, or the run folder of an agent, whose training's conditions are taken."""
    rate: float = 100.0
    """Number of states published per second."""
    start: Annotated[tuple[str, ...], arg(metavar=POSE)] = ()
    """Start at rest: x, y (m) and heading, such as 3 1 40deg, in space x, y, z and perhaps roll, pitch, yaw; angles
    are in degrees, or with a unit, such as 0.7rad. By default that of the seed."""
    seed: int = 0
    """Random seed of the start and the conditions."""
    seconds: float = 600.0
    """Length of the simulation, s."""

    def following(self) -> tuple[str, ...]:
        """See `rans.cli.commands.Command`."""
        return ("rans fly AGENT --goal 1 0 90deg",)

    def run(self) -> int:
        """Simulate until the time is up or an interrupt."""
        from rans.extend import RunFolder, Terminal, load_conditions, load_spacecraft
        from rans_robot.signals import stop_on_signals
        from rans_robot.twin import TwinPlan, run_twin

        say = Terminal().say
        craft = load_spacecraft(self.spacecraft)
        # A run folder stands for the conditions of its training.
        conditions = None
        if self.conditions is not None and Path(self.conditions).is_dir():
            conditions = RunFolder(Path(self.conditions)).config().conditions
        elif self.conditions is not None:
            conditions = load_conditions(self.conditions)
        start = read_state(self.start, craft.dimension, "--start")
        if start.velocities:
            raise ConfigError("--start of a twin is at rest: leave its velocities out.")
        plan = TwinPlan(
            craft=craft,
            control_period=self.period,
            robot=self.robot,
            engine=self.engine,
            conditions=conditions,
            rate=self.rate,
            start=start.pose,
            seed=self.seed,
            seconds=self.seconds,
        )
        # Simulate until the time is up or a signal comes; the bus is closed in any event.
        stop = stop_on_signals()
        bus = opened_bus(self.bus)
        try:
            say(
                f"{craft.name} is on {self.bus} (ROS_DOMAIN_ID {ros_domain()}), at {self.rate:g} "
                "states a second."
            )
            motion = run_twin(bus, plan, say, stop.is_set)
        finally:
            bus.close()
        where = ", ".join(f"{x:.3f}" for x in motion.position[: craft.dimension])
        say(f"Ended at ({where}) m, at {float((motion.velocity**2).sum()) ** 0.5:.3f} m/s.")
        return 0
