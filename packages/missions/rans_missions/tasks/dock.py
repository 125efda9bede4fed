"""Dock with a target on an orbit: a benchmark of the Air Force Research Laboratory."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import ClassVar

from rans.extend import Field, Random, Shape, SpeedLimit, State, Timing, Vec3, Vector, cos, sin
from rans_missions.orbits.elliptic import mean_anomaly
from rans_missions.passive_safety import CoastZone
from rans_missions.tasks.orbital import OrbitalMission


@dataclass(frozen=True)
class Dock(OrbitalMission):
    """Dock with a target on an orbit by a deadline, below a speed limit that decreases towards the target.

    >>> rans.load_task("dock").deadline
    (600.0, 2000.0)

    Goal: the origin of W, the Hill frame of the target. Success: within 0.5 m at 0.2 m/s or less, at any second
    of the flight. Constraint: speed at most 0.2 m/s + 2 n (r - 0.5 m) at a distance r, at every second.

    Start: 100 to 150 m away, azimuth and elevation uniform, without rotation. The direction of its velocity is
    drawn in the same way, and its speed is ``start_speed`` times the limit there, as the page of the benchmark
    documents it. With ``starts_as_coded`` the elevation is measured from the pole and the speed is in m/s, as in
    the code of the benchmark: every start and every velocity then has z >= 0, and about half of the starts are
    above the limit.

    Source: U. Ravaioli et al., "Safe reinforcement learning benchmark environments for aerospace control
    systems", IEEE Aerospace Conference, 2022, and Docking-v0 of safe-autonomy-sims 6d71f7e. The control period is
    10 s instead of 1 s. The benchmark ends episodes 10 km away and after 2,000 s, and has no deadline.
    """

    spawn_distance: tuple[float, float] = (100.0, 150.0)
    """Range of the start's distance from the target, m."""
    start_speed: tuple[float, float] = (0.0, 0.8)
    """Range of the start's speed, as a share of the limit, or in m/s with ``starts_as_coded``."""
    starts_as_coded: bool = False
    """Whether starts are those of the benchmark's code instead of those of its page."""
    position_tolerance: float = 0.5
    """Distance from the target that counts as contact, m."""
    velocity_tolerance: float = 0.2
    """Largest speed of docking at contact, m/s; also the speed limit there."""
    limit_slope: ClassVar[float] = 0.002054
    """Increase of the speed limit per metre, 1/s: 2 n."""
    done_weight: float = 1.0
    violation_weight: float = 1.0

    flag = 5
    ellipses: ClassVar[bool] = True
    spacecraft: ClassVar[str | None] = "afrl-deputy"
    timing: ClassVar[Timing] = Timing(control_period=10.0, episode_steps=200, checks=10)

    @property
    def half_turn(self) -> float:
        """See `OrbitalMission.half_turn`: around the perigee."""
        return 2.0 * mean_anomaly(0.5 * math.pi, self.orbit.eccentricity)

    @property
    def coast_zone(self) -> CoastZone | None:
        """A ball of 5 m, until the craft is within 20 m of the target: our choice; see `Hold.coast_zone`."""
        return CoastZone(5.0, 20.0) if self.orbit.is_steady else None

    def limits(self, goal: State) -> dict[str, Shape]:
        """The speed limit."""
        base = self.velocity_tolerance - self.limit_slope * self.position_tolerance
        return {"speed": SpeedLimit(goal.p, base, self.limit_slope)}

    def sample(self, random: Random) -> tuple[State, State]:
        """Start around the target at the origin, which notes a deadline and a plan; seeds rely on the order."""
        distance = random.uniform(*self.spawn_distance)
        position = self._direction(random).scale(distance)
        speed = random.uniform(*self.start_speed)
        if not self.starts_as_coded:
            at_contact = self.velocity_tolerance - self.limit_slope * self.position_tolerance
            speed = speed * (at_contact + distance * self.limit_slope)
        velocity = self._direction(random).scale(speed)
        start = replace(random.moving(velocity, random.no_rotation()), p=position)
        goal = random.at_rest(random.origin(), random.no_rotation())
        return start, self.planned(random, start, goal)

    def _direction(self, random: Random) -> Vector:
        """Unit vector as the benchmark draws it, denser towards the poles than uniform directions.

        The azimuth is drawn first; starts of published comparisons depend on the order.
        """
        if random.dimension == 2:
            return random.direction()
        azimuth = random.uniform(-math.pi, math.pi)
        angle = random.uniform(-0.5 * math.pi, 0.5 * math.pi)
        along: Field = cos(angle)
        height: Field = sin(angle)
        if self.starts_as_coded:
            along, height = height, along
        return Vec3(along * cos(azimuth), along * sin(azimuth), height)
