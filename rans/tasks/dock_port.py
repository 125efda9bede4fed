"""Dock at the port of a target that stands still or turns, inside an approach cone."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, ClassVar

from rans.errors import ConfigError
from rans.model.drift import FREE, step_goal
from rans.model.dynamics import State
from rans.model.fields import Field, Heading, Quat, Vec2, Vec3, Vector
from rans.model.random import Random
from rans.model.timing import Timing
from rans.tasks.base import SingleTask
from rans.tasks.observation_terms import (
    AngularVelocity,
    InformationInW,
    ObservationTerm,
    RelativeRotation,
    VectorInW,
)
from rans.tasks.rewards import Transition, is_used, nearness, speed
from rans.tasks.shapes import Ball, Cone, Shape


@dataclass(frozen=True)
class DockPort(SingleTask):
    """Dock at a port: arrive slowly, aligned and turning with it, inside its approach cone.

    >>> rans.DockPort(port_rate=(0.0, 0.0)).tolerances()["position"]
    0.02

    The target's centre is the origin of W, where it turns at a constant rate: in the plane either way, in
    space about any axis. The goal is the docked state, at `standoff` from the target's centre, with the
    spacecraft's x axis towards it; it moves with the port. Start: at rest, any bearing and attitude.

    Nearer to the port than `cone_length` the spacecraft's centre must be inside the approach cone, whose apex
    lies `cone_depth` behind the docked position, and it must never enter the target's keep-out ball. The
    mission is won at the first instant at which position, attitude, velocity and spin relative to the port
    are within their tolerances; that ends the episode.

    Observed task data: way to the docked position (W), rotation to go, velocity to gain (W), spin to gain (B),
    unit vector of the cone's axis (W), and the margin of the cone.

    Raises:
        ConfigError: the cone is not below 90 degrees, or the docked position violates a constraint; and see
            `rans.tasks.settings.check_settings`.
    """

    spawn_distance: tuple[float, float] = (2.0, 4.0)
    """Range of the start's distance from the target's centre, m."""
    port_rate: tuple[float, float] = (0.0, math.radians(3.0))
    """Range of the target's rate, rad/s."""
    standoff: float = 0.65
    """Distance of the docked spacecraft's centre from the target's, m."""
    target_radius: float = 0.5
    """Radius of the keep-out ball around the target's centre, m."""
    cone_half_angle: float = math.radians(30.0)
    """Angle between the approach cone's axis and its surface, rad."""
    cone_length: float = 1.0
    """Distance from the cone's apex below which the spacecraft must be inside, m."""
    cone_depth: float = 0.1
    """Distance of the cone's apex behind the docked position, m: room for the tolerances there."""
    position_tolerance: float = 0.02
    """Distance from the docked position that counts as docked, m."""
    attitude_tolerance: float = math.radians(2.0)
    """Attitude error that counts as docked, rad."""
    velocity_tolerance: float = 0.05
    """Velocity relative to the port that counts as docked, m/s."""
    spin_tolerance: float = math.radians(9.0)
    """Spin relative to the port that counts as docked, rad/s. One pulse of 0.2 s of the floating platform
    changes its spin by 17.4 degrees/s: every rate is within half of that of one that it reaches."""
    approach_weight: float = 1.5
    """Weight of nearness that is felt from afar."""
    approach_scale: float = 1.5
    """Distance at which the approach reward has fallen to 1/e, m."""
    turn_weight: float = 0.5
    """Weight of an attitude reward that is felt from afar."""
    turn_scale: float = 1.0
    """Attitude error at which the turn reward has fallen to 1/e, rad."""
    position_scale: float = 0.25
    """Error at which the position reward has fallen to 1/e, m."""
    attitude_scale: float = 0.25
    """Error at which the attitude reward has fallen to 1/e, rad."""
    soft_weight: float = 0.5
    """Weight of velocity and spin like the port's, near it."""
    velocity_scale: float = 0.1
    """Error at which the velocity part of that has fallen to 1/e, m/s."""
    spin_scale: float = 0.2
    """Error at which the spin part of that has fallen to 1/e, rad/s."""
    done_weight: float = 400.0
    """Reward for docking, once: more than waiting at the port earns, 5 a step, discounted by 0.985."""
    violation_weight: float = 20.0
    """Reward lost once when the cone is left or the target touched, which ends the episode."""
    fail_distance: float = 8.0
    """An episode fails beyond this distance from the port, m."""
    fail_spin: float = 4.0
    """An episode fails beyond this rate, rad/s."""

    timing: ClassVar[Timing] = Timing(control_period=0.2, episode_steps=200, checks=4)

    def __post_init__(self) -> None:
        super().__post_init__()
        angle = self.cone_half_angle
        if isinstance(angle, float) and angle >= math.pi / 2:
            raise ConfigError(
                f"cone_half_angle must be below 90 degrees, got {math.degrees(angle):g} degrees."
            )
        if isinstance(self.target_radius, float) and self.target_radius >= self.standoff:
            raise ConfigError(
                f"target_radius must be below the standoff, {self.standoff} m, got "
                f"{self.target_radius}: a docked spacecraft would be inside the keep-out ball."
            )

    def sample(self, random: Random) -> tuple[State, State]:
        """Start around the target; the docked state with the port in any direction."""
        start = random.around(*self.spawn_distance)
        spin = random.turn(self.port_rate)
        return start, self._docked(random.moving(random.origin(), random.attitude(), spin))

    def later(self, goal: State, time: Field) -> State:
        """The docked state turns with the target."""
        return self._docked(step_goal(goal, FREE, time))

    def scenery(self, goal: State) -> tuple[Shape, ...]:
        """The approach cone, and the keep-out ball around the target."""
        return self._cone(goal), self._target(goal)

    def constraints(self, state: State, goal: State) -> dict[str, Field]:
        """Margins of the approach cone and of the keep-out ball, m."""
        return {
            "cone": self._cone(goal).gap(state.p),
            "target": self._target(goal).gap(state.p),
        }

    def done(self, state: State, goal: State) -> Field:
        """Whether the spacecraft is docked: all errors are within their tolerances."""
        return self.reached(state, goal)

    def observation_terms(self, state: State, goal: State) -> tuple[ObservationTerm, ...]:
        """Position, attitude, velocity and spin still to go, and the cone."""
        cone = self._cone(goal)
        return (
            VectorInW("d", "m", goal.p - state.p),
            RelativeRotation("d", "-", state.attitude.to(goal.attitude)),
            VectorInW("dv_", "m/s", goal.v - state.v),
            AngularVelocity("dw", "rad/s", _spin_to_gain(state, goal)),
            InformationInW("axis ", "-", cone.axis),
            *cone.entries("cone", state),
        )

    def errors(self, state: State, goal: State) -> dict[str, Field]:
        """Distance, angle, velocity and spin relative to the docked state."""
        return {
            "position": (goal.p - state.p).norm(),
            "attitude": state.attitude.to(goal.attitude).magnitude(),
            "velocity": (goal.v - state.v).norm(),
            "spin": speed(_spin_to_gain(state, goal)),
        }

    def reward(self, transition: Transition) -> dict[str, Field]:
        """Nearness of position and attitude, wide and narrow; near the port, of velocity and spin."""
        distance, angle, rush, twist = self.errors(transition.state, transition.goal).values()
        near = nearness(distance, self.position_scale)
        terms = {
            "position": near,
            "attitude": nearness(angle, self.attitude_scale),
            "approach": nearness(distance, self.approach_scale) * self.approach_weight,
            "turn": nearness(angle, self.turn_scale) * self.turn_weight,
        }
        if is_used(self.soft_weight):
            matched = nearness(rush, self.velocity_scale) + nearness(twist, self.spin_scale)
            terms["soft"] = near * matched * self.soft_weight
        return terms | self.prices(transition)

    def failed(self, state: State, goal: State) -> Field:
        """Too far away, or spinning too fast."""
        lost = (goal.p - state.p).norm() > self.fail_distance
        return lost | (speed(state.spin()) > self.fail_spin)

    def _docked(self, turned: Any) -> Any:
        """The docked state with the attitude and the spin of another."""
        towards = _ahead(turned.attitude)
        p = towards.scale(-self.standoff)
        if isinstance(turned.attitude, Heading):
            return replace(turned, p=p, v=Vec2(-turned.w * p.y, turned.w * p.x))
        # The spin is in the frame of the docked spacecraft, where its way from the target is along -x.
        v = turned.w.cross(Vec3(-self.standoff, 0.0, 0.0))
        return replace(turned, p=p, v=turned.attitude.rotate(v))

    def _cone(self, goal: State) -> Cone:
        towards = _ahead(goal.attitude)
        apex = goal.p + towards.scale(self.cone_depth)
        return Cone(apex, towards.scale(-1.0), self.cone_half_angle, self.cone_length)

    def _target(self, goal: State) -> Ball:
        centre = goal.p + _ahead(goal.attitude).scale(self.standoff)
        return Ball(centre, goal.v.scale(0.0), self.target_radius)


def _ahead(attitude: Any) -> Vector:
    """Unit vector of a body's x axis in W."""
    axis: Any = Vec2(1.0, 0.0) if isinstance(attitude, Heading) else Vec3(1.0, 0.0, 0.0)
    return attitude.rotate(axis)


def _spin_to_gain(state: State, goal: State) -> tuple[Field, ...]:
    """Angular velocity of the goal less the spacecraft's, in the spacecraft's frame, rad/s."""
    turn = state.attitude.to(goal.attitude)
    if isinstance(turn, Quat):
        wanted: Any = turn.rotate(goal.w)  # pyright: ignore[reportArgumentType]
        return (wanted - state.w).columns()
    return (goal.w - state.w,)
