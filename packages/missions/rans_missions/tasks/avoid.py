"""Go to a pose among fixed or moving keep-out zones, in the plane or in space.

Observations are trained: the order of zones and the random numbers of `sample` stay.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

from rans import GoToPose
from rans.extend import (
    Ball,
    ConfigError,
    Field,
    InformationInW,
    ObservationTerm,
    Random,
    Shape,
    State,
    Timing,
    Transition,
    Vec2,
    Vector,
    absolute,
    at_least,
    is_used,
    nearness,
    sqrt,
    where,
)
from rans.tasks.shapes import nearest_first

_MOST_ZONES = 16
"""Largest number of zones. Each adds 7 (plane) or 10 (space) columns to the observation; sorting compares all
pairs."""


@dataclass(frozen=True)
class Zones:
    """What a goal of `Avoid` notes."""

    zones: tuple[Ball, ...]
    """The keep-out zones, each with its centre (W, m), its velocity (W, m/s) and its radius (m)."""


@dataclass(frozen=True)
class Avoid(GoToPose):
    """Go to a pose and stay there without entering a keep-out zone.

    >>> rans.Avoid(zone_speed=(0.0, 0.0)).zones
    3

    Goal, start and success are those of `GoToPose`, with starts far enough away for zones between start and
    goal. Every zone is a `rans.tasks.shapes.Ball` that the centre of the spacecraft must not enter; its radius
    includes that of the spacecraft. Zones lie up to `zone_offset` beside the line from start to goal and move at a
    constant velocity at right angles to it; at a time within `crossing_time` a zone is at its offset. The
    distance of a zone from start and goal is therefore never below `clearance`.

    Observed task data: those of `GoToPose`, then for every zone, the nearest first: vector to its centre and its
    relative velocity in W, distance from its surface, and direction to its centre times
    exp(-distance from the surface / zone_scale), which changes most near the surface.

    Raises:
        ConfigError: the number of zones is not a whole number in range, or starts are too near for the largest
            zone to fit between; and as for `GoToPose`.
    """

    spawn_distance: tuple[float, float] = (2.2, 4.5)
    """Range of the start's distance from the goal in training, m."""
    zones: int = 3
    """Number of zones."""
    zone_radius: tuple[float, float] = (0.3, 0.5)
    """Range of the radii of zones, m."""
    zone_speed: tuple[float, float] = (0.0, 0.04)
    """Range of the speeds of zones, m/s."""
    zone_offset: ClassVar[float] = 0.5
    """Largest distance of a zone's centre from the line between start and goal when it crosses, m."""
    crossing_time: ClassVar[tuple[float, float]] = (0.0, 12.0)
    """Range of the time at which a zone is at its offset, s; moving zones come from the side."""
    clearance: ClassVar[float] = 0.4
    """Least distance of start and goal from every zone, m."""
    zone_weight: float = 0.5
    """Reward lost per step at the surface of a zone."""
    zone_scale: ClassVar[float] = 0.15
    """Distance from the surface at which the zone penalty has fallen to 1/e, m."""
    violation_weight: float = 20.0
    """Reward lost once when a zone is entered, which ends the episode."""

    goal_notes = Zones
    optimal_problem = "zones"
    timing: ClassVar[Timing] = Timing(checks=4)

    def __post_init__(self) -> None:
        if type(self.zones) is not int or not 1 <= self.zones <= _MOST_ZONES:
            raise ConfigError(
                f"zones must be a whole number from 1 to {_MOST_ZONES}, got {self.zones!r}."
            )
        super().__post_init__()
        nearest = min(self.spawn_distance[0], self.evaluation_distance[0])
        room = 2.0 * (self.zone_radius[1] + self.clearance)
        if isinstance(room, float) and isinstance(nearest, float) and nearest < room:
            raise ConfigError(
                "spawn_distance and evaluation_distance must begin at twice the largest zone_radius plus "
                f"clearance, {room:g} m, got {nearest:g} m: the zones would not fit between start and goal."
            )

    def sample(self, random: Random) -> tuple[State, State]:
        """Start and goal as for `GoToPose`, then the zones, which cross the way between; seeds rely on this."""
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
        return start, replace(goal, notes=Zones(tuple(zones)))

    def later(self, goal: State, time: Field) -> State:
        """Goal after a time (s): the pose is fixed and the zones move."""
        return replace(goal, notes=Zones(tuple(zone.later(time) for zone in goal.notes.zones)))

    def limits(self, goal: State) -> dict[str, Shape]:
        """The keep-out zones."""
        return {f"zone {k}": zone for k, zone in enumerate(goal.notes.zones, 1)}

    def observation_terms(self, state: State, goal: State) -> tuple[ObservationTerm, ...]:
        """Terms of `GoToPose`, then the zones', the nearest first; agents' files record kinds and order."""
        entries = list(super().observation_terms(state, goal))
        for k, zone in enumerate(nearest_first(goal.notes.zones, state.p), 1):
            offset = zone.centre - state.p
            close = nearness(_outside(zone.gap(state.p)), self.zone_scale)
            towards = offset.scale(close / at_least(offset.norm(), 1e-6))
            entries += zone.entries(f"zone {k}", state)
            meaning = (
                f"direction from the spacecraft to the centre of zone {k}, of length 1 at its surface and "
                f"decreasing as exp(-gap / {self.zone_scale:g} m)"
            )
            entries.append(InformationInW(f"zone {k} near ", "-", towards, meaning=meaning))
        return tuple(entries)

    def reward(self, transition: Transition) -> dict[str, Field]:
        """Terms (fields) of `GoToPose`, and a penalty near zones."""
        terms = super().reward(transition)
        if is_used(self.zone_weight):
            zones = transition.goal.notes.zones
            gaps = (_outside(zone.gap(transition.state.p)) for zone in zones)
            close = sum(nearness(gap, self.zone_scale) for gap in gaps)
            terms["zones"] = close * -self.zone_weight
        return terms


def _across(direction: Vector, along: Vector) -> Vector:
    """Unit vector along the component of a direction at right angles to a unit vector.

    In the plane only the sign of that component is used, because rounding may exceed the component itself.
    """
    if isinstance(along, Vec2):
        left = Vec2(-along.y, along.x)
        side = direction.dot(left)
        unity = side * 0.0 + 1.0
        return left.scale(where(side < 0.0, -unity, unity))
    part = direction - along.scale(direction.dot(along))
    return part.scale(1.0 / sqrt(part.dot(part) + 1e-12))


def _outside(gap: Field) -> Field:
    """Positive part of a distance from a surface: zero inside."""
    return 0.5 * (gap + absolute(gap))
