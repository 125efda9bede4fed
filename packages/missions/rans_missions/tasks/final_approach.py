"""Fly through the corridor of a port of a target on an orbit; the target may turn."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, ClassVar

from rans.extend import (
    FREE,
    Ball,
    ClohessyWiltshire,
    Cone,
    ConfigError,
    Dimension,
    Drift,
    Field,
    InformationInW,
    ObservationTerm,
    Random,
    Shape,
    SingleTask,
    SpeedLimit,
    State,
    Timing,
    Transition,
    Vec3,
    Vector,
    VectorInW,
    nearness,
    step_goal,
)


@dataclass(frozen=True)
class FinalApproach(SingleTask):
    """Fly through the approach corridor into the port of a target on a circular orbit, below a speed limit.

    >>> rans.FinalApproach(port_rate=(0.0, 0.0)).cone_length
    50.0

    W is the Hill frame of the target, whose centre is the origin. Its port is 2 m from there, in any direction, and
    turns about the centre at a constant rate about any axis: by default at up to the mean motion, which is the rate
    of a target that points at a star. The goal is the port with its velocity.

    Within `cone_length` of the apex the craft must be inside a cone of 10 degrees half angle about the port's axis.
    The apex is so far behind the port that the cone is as wide there as the tolerance. The craft stays out of a
    ball around the target, and its speed is at most `velocity_tolerance` + 4 n r at a distance r from the target's
    centre. All of this holds at every check. The mission succeeds at the port within both tolerances; this ends the
    episode.

    Start: at rest, `spawn_distance` from the target, within 8 degrees of the port's axis.

    Source: corridor, tolerance, speed limit and craft of the scenarios docking and inertial-target of the benchmark
    V-BAR (2026), whose ports point along the orbit at the start, and whose contact asks for 5 to 10 cm/s.
    """

    mean_motion: float = 0.0011068
    """Mean motion n of an orbit 500 km above the Earth, rad/s."""
    port_rate: tuple[float, float] = (0.0, 0.0011068)
    """Range of the rate at which the target turns relative to its Hill frame, rad/s."""
    spawn_distance: tuple[float, float] = (60.0, 150.0)
    """Range of the start's distance from the target's centre along the port's axis, m."""
    cone_length: float = 50.0
    """Distance from the cone's apex within which the craft must be inside, m."""
    position_tolerance: float = 0.1
    """Distance from the port that counts as docked, m."""
    velocity_tolerance: float = 0.1
    """Speed relative to the port that counts as docked, m/s."""
    approach_scale: ClassVar[float] = 50.0
    """Distance at which the reward for coming nearer has fallen to 1/e, m."""
    port_scale: ClassVar[float] = 2.0
    """Distance at which the reward for the last metres has fallen to 1/e, m."""
    done_weight: float = 100.0
    """Reward for docking, once."""
    violation_weight: float = 20.0
    """Reward lost once when a constraint is violated, which ends the episode."""
    fail_distance: float = 500.0
    """Distance from the port beyond which an episode fails, m."""

    flag = 12
    optimal_problem = "approach"
    symmetric: ClassVar[bool] = False
    dimensions: ClassVar[tuple[Dimension, ...]] = (3,)
    spacecraft: ClassVar[str | None] = "vbar-chaser"
    timing: ClassVar[Timing] = Timing(control_period=5.0, episode_steps=600, checks=10)
    standoff: ClassVar[float] = 2.0
    """Distance of the port from the target's centre, m."""
    cone_degrees: ClassVar[float] = 10.0
    """Half angle of the cone, degrees."""
    spawn_degrees: ClassVar[float] = 8.0
    """Angle from the port's axis within which episodes start, degrees."""

    def __post_init__(self) -> None:
        super().__post_init__()
        tolerance = self.position_tolerance
        if isinstance(tolerance, int | float) and tolerance >= self.standoff:
            raise ConfigError(
                f"position_tolerance must be below {self.standoff} m, the distance of the port from the target's "
                f"centre, got {tolerance!r}: a docked craft could be anywhere around it."
            )

    @property
    def drift(self) -> Drift:
        """The Clohessy-Wiltshire equations of the target's orbit."""
        return ClohessyWiltshire(self.mean_motion)

    def sample(self, random: Random) -> tuple[State, State]:
        """Start near the axis of a port in any direction, and the docked state.

        The order of draws is part of every start.
        """
        target = random.moving(random.origin(), random.attitude(), random.turn(self.port_rate))
        goal = self._port(target)
        axis = self.axis(goal)
        distance = random.uniform(*self.spawn_distance)
        anywhere: Any = random.direction()
        across = anywhere - axis.scale(anywhere.dot(axis))
        widest = math.tan(math.radians(self.spawn_degrees))
        place = axis.scale(distance) + across.scale(distance * random.uniform(0.0, widest))
        return random.at_rest(place, random.no_rotation()), goal

    def later(self, goal: State, time: Field) -> State:
        """The port after a time (s), turned with the target."""
        return self._port(step_goal(goal, FREE, time))

    def axis(self, goal: State) -> Vector:
        """Unit vector in W from the target's centre through its port."""
        return goal.p.scale(1.0 / self.standoff)

    def limits(self, goal: State) -> dict[str, Shape]:
        """The cone of the corridor, the ball around the target and the speed limit, at the goal's time."""
        depth = self.position_tolerance / math.tan(math.radians(self.cone_degrees))
        axis, centre = self.axis(goal), goal.p.scale(0.0)
        apex = goal.p - axis.scale(depth)
        return {
            "cone": Cone(apex, axis, math.radians(self.cone_degrees), self.cone_length),
            "target": Ball(centre, centre, self.standoff - self.position_tolerance),
            "speed": SpeedLimit(centre, self.velocity_tolerance, 4.0 * self.mean_motion),
        }

    done = SingleTask.reached  # the craft is docked: both errors are within their tolerances

    def observation_terms(self, state: State, goal: State) -> tuple[ObservationTerm, ...]:
        """Position and velocity of the port relative to the craft, its axis, and the margins' shapes.

        Agents' files record kinds and order.
        """
        cone, _, speed = self.scenery(goal)
        return (
            VectorInW("d", "m", goal.p - state.p),
            VectorInW("dv_", "m/s", goal.v - state.v),
            InformationInW(
                "axis ",
                "-",
                self.axis(goal),
                meaning="unit vector from the target's centre through its port",
            ),
            *cone.entries("cone", state),
            *speed.entries("speed", state),
        )

    def reward(self, transition: Transition) -> dict[str, Field]:
        """Wide and narrow rewards of the distance from the port."""
        distance = self.errors(transition.state, transition.goal)["position"]
        return {
            "approach": nearness(distance, self.approach_scale),
            "position": nearness(distance, self.port_scale),
            **self.prices(transition),
        }

    def failed(self, state: State, goal: State) -> Field:
        """Whether the craft is too far away."""
        return (goal.p - state.p).norm() > self.fail_distance

    def _port(self, target: Any) -> Any:
        """State of the port of a target with an attitude and a spin: on the x axis of the target's body."""
        arm = Vec3(self.standoff, 0.0, 0.0)
        turn = target.attitude
        return replace(target, p=turn.rotate(arm), v=turn.rotate(target.w.cross(arm)))
