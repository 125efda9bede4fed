"""Approach a hold point behind a target on a circular orbit from any side, around a keep-out ball."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

from rans.model.dynamics import State
from rans.model.random import Random
from rans.model.timing import Timing
from rans.tasks.orbital import OrbitalMission
from rans.tasks.shapes import Ball, Shape


@dataclass(frozen=True)
class Hold(OrbitalMission):
    """Reach a hold point behind a target on a circular orbit from any side, outside a keep-out ball.

    >>> rans.load_task("hold").hold_distance
    100.0

    Goal: at rest 100 m behind the target, on its orbit. Success: within 5 m at 0.05 m/s or less, at any check.
    Constraint: at least 50 m from the target, at every check.

    Start: at rest in the Hill frame of the target, 150 to 300 m from the target in a uniform direction, and no
    nearer to the goal than the goal is to the ball.

    Source: hold point, keep-out ball and tolerances of the approach benchmark V-BAR (2026), with its craft
    `vbar-chaser` at 500 km. The range of starts is our choice.
    """

    mean_motion: float = 0.0011068
    """Mean motion n of an orbit 500 km above the Earth (mu = 3.986004e14 m^3/s^2, radius 6,378.137 km), rad/s."""
    spawn_distance: tuple[float, float] = (150.0, 300.0)
    """Range of the start's distance from the target, m."""
    hold_distance: float = 100.0
    """Distance of the hold point behind the target, m."""
    keep_out: float = 50.0
    """Radius of the keep-out ball around the target, m."""
    position_tolerance: float = 5.0
    """Distance from the hold point that counts as reached, m."""
    velocity_tolerance: float = 0.05
    """Speed that counts as at rest, m/s."""
    shortest_aim: float = 10.0
    """Least coasting time of the velocity to gain, s: a control period."""
    braking_time: float = 10.0
    done_weight: float = 1.0
    violation_weight: float = 1.0
    impulse_weight: float = 0.002
    """Reward lost per newton-second of thruster impulse."""
    gain_weight: float = 1.0
    """Reward per m/s by which the velocity to gain decreases; by default the price of 1 m/s for 500 kg."""

    flag = 9
    brakes: ClassVar[bool] = True
    few_burns: ClassVar[bool] = True
    spacecraft: ClassVar[str | None] = "vbar-chaser"
    timing: ClassVar[Timing] = Timing(control_period=10.0, episode_steps=200, checks=10)

    def limits(self, goal: State) -> dict[str, Shape]:
        """The keep-out ball around the target at the origin."""
        origin = goal.p.scale(0.0)
        return {"keep-out": Ball(origin, origin, self.keep_out)}

    def sample(self, random: Random) -> tuple[State, State]:
        """Start around the target and goal behind it; the notes of the goal have a deadline and a plan."""
        place = random.direction().scale(random.uniform(*self.spawn_distance))
        rest = random.at_rest(random.origin(), random.no_rotation())
        behind = replace(rest.p, y=-self.hold_distance)
        start = replace(rest, p=place)
        return start, self.planned(random, start, replace(rest, p=behind))
