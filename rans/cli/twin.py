"""``rans twin``: a simulated robot for tests of `rans fly`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional, arg

from rans.cli.fly import Bus, Robot, Ros

Engine = Literal["fast", "drake"]


@dataclass(frozen=True)
class Twin:
    """Simulate a robot for `rans fly`, which publishes its state on a bus and takes commands.

    Its valves shut two and a half control periods after the last command.
    """

    spacecraft: Annotated[str, Positional, arg(metavar="CRAFT")]
    """Name of the spacecraft, or its TOML file."""
    engine: Engine = "fast"
    """What computes the motion: RANS's own equations (fast), or Drake."""
    bus: Bus = "dds"
    """Transport: dds (ROS 2 and PX4), zenoh (rmw_zenoh), or udp (within this machine)."""
    robot: Robot = "ros"
    """Messages of the robot, as for `rans fly`."""
    period: float = 0.2
    """Control period at which the robot takes commands, s."""
    conditions: str | None = None
    """Latency, noise, dropouts, faults and disturbances of the robot: a name (see `rans list CONDITIONS`), your
    own TOML file, or the run folder of an agent, whose training's conditions are taken."""
    rate: float = 100.0
    """Number of states published per second."""
    start: tuple[float, ...] = ()
    """Start: x, y (m) and heading (degrees) in the plane; x, y, z in space. By default that of the episode."""
    seed: int = 0
    """Random seed of the start and the conditions."""
    episode: int = 0
    """Number of the episode whose start and conditions are used."""
    seconds: float = 600.0
    """Length of the simulation, s."""
    domain: int = 0
    """ROS 2 domain (ROS_DOMAIN_ID)."""
    address: str = ""
    """Zenoh locator to connect to, such as tcp/192.168.0.2:7447, or listen/LOCATOR; by default ROS 2's router on
    this machine, tcp/localhost:7447."""
    ros: Ros = "jazzy"
    """ROS 2 distribution that the other end runs, for Zenoh; rolling is also what came after Kilted."""

    def run(self) -> int:
        """Simulate until the time is up or an interrupt."""
        from rans.api.names import load_conditions, load_spacecraft
        from rans.deploy.robot.bus import open_bus
        from rans.deploy.robot.signals import stop_on_signals
        from rans.deploy.robot.twin import TwinPlan, run_twin
        from rans.fast.learn.run_folder import RunFolder
        from rans.terminal import Terminal

        say = Terminal().say
        craft = load_spacecraft(self.spacecraft)
        conditions = None
        if self.conditions is not None and Path(self.conditions).is_dir():
            conditions = RunFolder(Path(self.conditions)).config().conditions
        elif self.conditions is not None:
            conditions = load_conditions(self.conditions)
        plan = TwinPlan(
            craft=craft,
            control_period=self.period,
            robot=self.robot,
            engine=self.engine,
            conditions=conditions,
            rate=self.rate,
            start=self.start,
            seed=self.seed,
            episode=self.episode,
            seconds=self.seconds,
        )
        stop = stop_on_signals()
        bus = open_bus(self.bus, self.domain, self.address, self.ros)
        try:
            say(f"{craft.name} is on {self.bus}, at {self.rate:g} states a second.")
            motion = run_twin(bus, plan, say, stop.is_set)
        finally:
            bus.close()
        where = ", ".join(f"{x:.3f}" for x in motion.position[: craft.dimension])
        say(f"Ended at ({where}) m, at {float((motion.velocity**2).sum()) ** 0.5:.3f} m/s.")
        return 0
