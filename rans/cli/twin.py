"""``rans twin``: a robot to fly an agent against."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from tyro.conf import Positional, arg

from rans.cli.fly import Bus, Robot, stop_on_signals

Engine = Literal["fast", "drake"]


@dataclass(frozen=True)
class Twin:
    """Be a robot: publish the state of a simulated spacecraft over a bus, and take commands.

    Without a command for two and a half control periods its valves shut. `rans fly` flies an agent against it.
    """

    spacecraft: Annotated[str, Positional, arg(metavar="CRAFT")]
    """Name or TOML file of the spacecraft."""
    engine: Engine = "fast"
    """What computes the motion."""
    bus: Bus = "dds"
    """Transport: ROS 2's and PX4's (dds), rmw_zenoh's, or UDP within this machine."""
    robot: Robot = "ros"
    """What the robot publishes and takes, as for `rans fly`."""
    period: float = 0.2
    """Control period that the robot takes commands at, s."""
    conditions: str | None = None
    """Latency, noise, dropouts, faults and disturbances: name or TOML file."""
    rate: float = 100.0
    """States published a second."""
    start: tuple[float, ...] = ()
    """x, y (m) and heading (degrees) in the plane, x, y, z in space; that of the episode by default."""
    seed: int = 0
    """Seed of the random numbers of conditions and of the start."""
    episode: int = 0
    """Number of the episode."""
    seconds: float = 600.0
    """How long to fly."""
    domain: int = 0
    """ROS_DOMAIN_ID."""
    address: str = ""
    """Zenoh locator to connect to, such as tcp/192.168.0.2:7447, or listen/LOCATOR."""

    def run(self) -> int:
        """Fly until the time is up or somebody interrupts."""
        from rans.deploy.robot.bus import open_bus
        from rans.deploy.robot.twin import TwinPlan, run_twin
        from rans.model.spacecraft_file import load_spacecraft
        from rans.randomization.conditions_file import load_conditions
        from rans.terminal import Terminal

        say = Terminal().say
        craft = load_spacecraft(self.spacecraft)
        conditions = None if self.conditions is None else load_conditions(self.conditions)
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
        bus = open_bus(self.bus, self.domain, self.address)
        try:
            say(f"{craft.name} is on {self.bus}, at {self.rate:g} states a second.")
            motion = run_twin(bus, plan, say, stop.is_set)
        finally:
            bus.close()
        where = ", ".join(f"{x:.3f}" for x in motion.position[: craft.dimension])
        say(f"Ended at ({where}) m, at {float((motion.velocity**2).sum()) ** 0.5:.3f} m/s.")
        return 0
