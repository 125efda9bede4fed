"""Go to a pose among keep-out zones that stand still or move, in the plane or in space."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

from rans.errors import ConfigError
from rans.model.dynamics import State
from rans.model.fields import Field, Vec2, Vector, absolute, at_least, sqrt, where
from rans.model.random import Random
from rans.model.timing import Timing
from rans.tasks.go_to_pose import GoToPose
from rans.tasks.observation_terms import InformationInW, ObservationTerm
from rans.tasks.rewards import Transition, is_used, nearness
from rans.tasks.shapes import Ball, nearest_first

_MOST_ZONES = 16
"""The observation grows by seven columns a zone at most, and sorting by a comparison for every pair."""


@dataclass(frozen=True)
class Avoid(GoToPose):
    """Go to a pose and stay there without entering a keep-out zone on the way.

    >>> rans.Avoid(zone_speed=(0.0, 0.0)).zones
    3

    Goal, start and success are those of `GoToPose`, with starts far enough away for zones between. Every zone
    is a `rans.tasks.shapes.Ball` that the spacecraft's centre must not enter: its radius includes the
    spacecraft's own. Zones lie between start and goal, beside the straight way by up to `zone_offset`, and
    move across it at a constant velocity; at a time within `crossing_time` a zone is at its offset. As they
    move at right angles to the straight way, none ever comes nearer than `clearance` to start or goal.

    Observed task data: those of `GoToPose`, then of every zone, the nearest first: way to its centre and its
    relative velocity in W, the distance from its rim, and the direction to its centre times
    exp(-distance from the rim / zone_scale), which changes most where it matters.

    Raises:
        ConfigError: the number of zones is not whole or out of range, or starts are too near for the largest
            zone to fit between; and as `GoToPose`.
    """

    spawn_distance: tuple[float, float] = (2.2, 4.5)
    """Range of the start's distance from the goal in training, m."""
    zones: int = 3
    """Number of zones."""
    zone_radius: tuple[float, float] = (0.3, 0.5)
    """Range of their radii, m."""
    zone_speed: tuple[float, float] = (0.0, 0.04)
    """Range of their speeds, m/s."""
    zone_offset: float = 0.5
    """Largest distance of a zone's centre from the straight way when it crosses, m."""
    crossing_time: tuple[float, float] = (0.0, 12.0)
    """Range of the time at which a zone is at its offset, s: moving zones come from the side."""
    clearance: float = 0.4
    """Least distance of start and goal from every zone, m."""
    zone_weight: float = 0.5
    """Reward lost per step at the rim of a zone."""
    zone_scale: float = 0.15
    """Distance from the rim at which that has fallen to 1/e, m."""
    violation_weight: float = 20.0
    """Reward lost once when a zone is entered, which ends the episode."""

    timing: ClassVar[Timing] = Timing(checks=4)

    def __post_init__(self) -> None:
        super().__post_init__()
        if type(self.zones) is not int or not 1 <= self.zones <= _MOST_ZONES:
            raise ConfigError(
                f"zones must be a whole number from 1 to {_MOST_ZONES}, got {self.zones!r}."
            )
        nearest = min(self.spawn_distance[0], self.evaluation_distance[0])
        room = 2.0 * (self.zone_radius[1] + self.clearance)
        if isinstance(room, float) and isinstance(nearest, float) and nearest < room:
            raise ConfigError(
                "spawn_distance and evaluation_distance must begin at twice the largest zone_radius plus "
                f"clearance, {room:g} m, got {nearest:g} m: the zones would not fit between start and goal."
            )

    def sample(self, random: Random) -> tuple[State, State]:
        """As `GoToPose`; the goal's notes are the zones."""
        start, goal = super().sample(random)
        distance = (start.p - goal.p).norm()
        along = (start.p - goal.p).scale(1.0 / distance)
        zones: list[Ball] = []
        for _ in range(self.zones):
            radius = random.uniform(*self.zone_radius)
            margin = radius + self.clearance
            from_goal = margin + random.unit() * (distance - margin * 2.0)
            side = _across(random.direction(), along).scale(random.uniform(0.0, self.zone_offset))
            velocity = _across(random.direction(), along).scale(random.uniform(*self.zone_speed))
            crossing = random.uniform(*self.crossing_time)
            centre = goal.p + along.scale(from_goal) + side - velocity.scale(crossing)
            zones.append(Ball(centre, velocity, radius))
        return start, replace(goal, notes=tuple(zones))

    def later(self, goal: State, time: Field) -> State:
        """The goal stands still, zones move."""
        return replace(goal, notes=tuple(zone.later(time) for zone in self.scenery(goal)))

    def scenery(self, goal: State) -> tuple[Ball, ...]:
        """The zones."""
        return goal.notes

    def constraints(self, state: State, goal: State) -> dict[str, Field]:
        """Distance of the spacecraft's centre from the rim of every zone, m."""
        zones = self.scenery(goal)
        return {f"zone {k}": zone.gap(state.p) for k, zone in enumerate(zones, 1)}

    def observation_terms(self, state: State, goal: State) -> tuple[ObservationTerm, ...]:
        """As `GoToPose`, and the zones, the nearest first."""
        entries = list(super().observation_terms(state, goal))
        for k, zone in enumerate(nearest_first(self.scenery(goal), state.p), 1):
            way = zone.centre - state.p
            close = nearness(_outside(zone.gap(state.p)), self.zone_scale)
            towards = way.scale(close / at_least(way.norm(), 1e-6))
            entries += zone.entries(f"zone {k}", state)
            entries.append(InformationInW(f"zone {k} near ", "-", towards))
        return tuple(entries)

    def reward(self, transition: Transition) -> dict[str, Field]:
        """As `GoToPose`, less a price of being close to a zone."""
        terms = super().reward(transition)
        if is_used(self.zone_weight):
            zones = self.scenery(transition.goal)
            gaps = (_outside(zone.gap(transition.state.p)) for zone in zones)
            close = sum(nearness(gap, self.zone_scale) for gap in gaps)
            terms["zones"] = close * -self.zone_weight
        return terms


def _across(direction: Vector, along: Vector) -> Vector:
    """Unit vector of the part of a direction at right angles to a unit vector.

    In the plane only its sign is computed: the part itself may be so short that rounding is all of it.
    """
    if isinstance(along, Vec2):
        left = Vec2(-along.y, along.x)
        side = direction.dot(left)
        one = side * 0.0 + 1.0
        return left.scale(where(side < 0.0, -one, one))
    part = direction - along.scale(direction.dot(along))
    return part.scale(1.0 / sqrt(part.dot(part) + 1e-12))


def _outside(gap: Field) -> Field:
    """A distance from a rim, and zero inside."""
    return 0.5 * (gap + absolute(gap))
