"""Dock with a target on a circular orbit: the benchmark of the Air Force Research Laboratory."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import ClassVar

from rans.model.dynamics import State
from rans.model.fields import Field, Vec3, Vector, cos, sin
from rans.model.random import Random
from rans.model.timing import Timing
from rans.tasks.orbital import OrbitalMission
from rans.tasks.shapes import Shape, SpeedLimit


@dataclass(frozen=True)
class Dock(OrbitalMission):
    """Dock with a target on a circular orbit by a deadline, below a speed limit that falls with the distance.

    >>> rans.load_task("dock").deadline
    (600.0, 2000.0)

    Goal: the origin of W, the target's Hill frame. Won: within 0.5 m at 0.2 m/s or less, at any second of the
    flight. Limit: 0.2 m/s + 2 n (r - 0.5 m) at a distance r, at every second.

    Start: 100 to 150 m away, azimuth and elevation uniform, without rotation. Its velocity has a direction drawn
    the same way and is ``start_speed`` times the limit there, as the benchmark's page documents it. With
    ``starts_as_coded`` the angle drawn as elevation counts from the pole and the speed is in m/s, as the
    benchmark's code has it: every start and every velocity then lies at z >= 0, and about half of the starts
    are above the limit.

    Numbers: U. Ravaioli et al., "Safe reinforcement learning benchmark environments for aerospace control
    systems", IEEE Aerospace Conference, 2022, and Docking-v0 of safe-autonomy-sims 6d71f7e. The control period
    is ours, 10 s instead of 1 s; the benchmark ends episodes 10 km away and after 2,000 s, and knows no deadline.
    """

    spawn_distance: tuple[float, float] = (100.0, 150.0)
    """Range of the start's distance from the target, m."""
    start_speed: tuple[float, float] = (0.0, 0.8)
    """Range of the start's speed: as a share of the limit, or with ``starts_as_coded`` in m/s."""
    starts_as_coded: bool = False
    """Whether starts are those of the benchmark's code instead of those of its page."""
    position_tolerance: float = 0.5
    """Distance from the target that counts as contact, m."""
    velocity_tolerance: float = 0.2
    """Speed at which contact is docking, m/s; also the limit there."""
    limit_slope: float = 0.002054
    """Speed that the limit grows by per metre, 1/s: 2 n."""
    done_weight: float = 1.0
    violation_weight: float = 1.0

    flag = 5
    spacecraft: ClassVar[str | None] = "afrl-deputy"
    timing: ClassVar[Timing] = Timing(control_period=10.0, episode_steps=200, checks=10)

    def limits(self, goal: State) -> dict[str, Shape]:
        """The speed limit."""
        base = self.velocity_tolerance - self.limit_slope * self.position_tolerance
        return {"speed": SpeedLimit(goal.p, base, self.limit_slope)}

    def sample(self, random: Random) -> tuple[State, State]:
        """Start around the target, which is at the origin, a deadline and a plan."""
        distance = random.uniform(*self.spawn_distance)
        place = self._direction(random).scale(distance)
        speed = random.uniform(*self.start_speed)
        if not self.starts_as_coded:
            at_contact = self.velocity_tolerance - self.limit_slope * self.position_tolerance
            speed = speed * (at_contact + distance * self.limit_slope)
        velocity = self._direction(random).scale(speed)
        start = replace(random.moving(velocity, random.no_rotation()), p=place)
        goal = random.at_rest(random.origin(), random.no_rotation())
        return start, self.planned(random, start, goal)

    def _direction(self, random: Random) -> Vector:
        """A unit vector as the benchmark draws it: denser towards the poles than on a uniform sphere."""
        if random.dimension == 2:
            return random.direction()
        azimuth = random.uniform(-math.pi, math.pi)
        angle = random.uniform(-0.5 * math.pi, 0.5 * math.pi)
        along: Field = cos(angle)
        height: Field = sin(angle)
        if self.starts_as_coded:
            along, height = height, along
        return Vec3(along * cos(azimuth), along * sin(azimuth), height)
