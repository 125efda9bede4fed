"""Dock at the port of a fixed or rotating target, inside an approach cone."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, ClassVar

from rans.extend import (
    FREE,
    AngularVelocity,
    Ball,
    Cone,
    ConfigError,
    Field,
    Heading,
    InformationInW,
    ObservationTerm,
    Quat,
    Random,
    RelativeRotation,
    Shape,
    SingleTask,
    State,
    Timing,
    Transition,
    Vec2,
    Vec3,
    Vector,
    VectorInW,
    is_used,
    nearness,
    speed,
    step_goal,
)


@dataclass(frozen=True)
class DockPort(SingleTask):
    """Dock at a port of a rotating target: match its pose, velocity and spin inside the approach cone.

    >>> rans.DockPort(port_rate=(0.0, 0.0)).tolerances()["position"]
    0.02

    The centre of the target is the origin of W. The target rotates at a constant rate, in the plane in either
    direction and in space about any axis. The goal is the docked state, which moves with the port: at `standoff`
    from the target's centre, with the spacecraft's x axis towards it. Start: at rest, any bearing and attitude.

    Within `cone_length` of its apex, which lies `cone_depth` behind the docked position, the spacecraft's centre
    must be inside the approach cone. It must never enter the keep-out ball of the target. The mission succeeds at
    the first instant at which position, attitude, velocity and spin relative to the port are within their
    tolerances; this ends the episode.

    Observed task data: relative position (W), rotation, velocity (W) and spin (B) of the docked state, unit vector
    of the cone's axis (W), and margin of the cone.

    Raises:
        ConfigError: the half angle of the cone is not below 90 degrees, the docked position violates a
            constraint, or a setting is out of range (`rans.tasks.settings.check_settings`).
    """

    spawn_distance: tuple[float, float] = (2.0, 4.0)
    """Range of the start's distance from the target's centre, m."""
    port_rate: tuple[float, float] = (0.0, math.radians(3.0))
    """Range of the target's angular rate, rad/s."""
    standoff: ClassVar[float] = 0.65
    """Distance of the docked spacecraft's centre from the target's, m."""
    target_radius: float = 0.5
    """Radius of the keep-out ball around the target's centre, m."""
    cone_half_angle: float = math.radians(30.0)
    """Angle between the approach cone's axis and its surface, rad."""
    cone_length: float = 1.0
    """Distance from the cone's apex below which the spacecraft must be inside, m."""
    cone_depth: ClassVar[float] = 0.1
    """Distance of the cone's apex behind the docked position, m: room for the tolerances there."""
    position_tolerance: float = 0.02
    """Distance from the docked position that counts as docked, m."""
    attitude_tolerance: float = math.radians(2.0)
    """Attitude error that counts as docked, rad."""
    velocity_tolerance: float = 0.05
    """Velocity relative to the port that counts as docked, m/s."""
    spin_tolerance: float = math.radians(9.0)
    """Spin relative to the port that counts as docked, rad/s. One pulse of 0.2 s changes the spin of the floating
    platform by 17.4 degrees/s, so that every rate is within half of that of a reachable one."""
    approach_weight: float = 1.5
    """Weight of a wide position reward, for large distances."""
    approach_scale: ClassVar[float] = 1.5
    """Distance at which the approach reward has fallen to 1/e, m."""
    turn_weight: ClassVar[float] = 0.5
    """Weight of a wide attitude reward, for large errors."""
    turn_scale: ClassVar[float] = 1.0
    """Attitude error at which the turn reward has fallen to 1/e, rad."""
    position_scale: ClassVar[float] = 0.25
    """Error at which the position reward has fallen to 1/e, m."""
    attitude_scale: ClassVar[float] = 0.25
    """Error at which the attitude reward has fallen to 1/e, rad."""
    soft_weight: ClassVar[float] = 0.5
    """Weight of a reward for matching the port's velocity and spin near it."""
    velocity_scale: ClassVar[float] = 0.1
    """Error at which the velocity part of the soft reward has fallen to 1/e, m/s."""
    spin_scale: ClassVar[float] = 0.2
    """Error at which the spin part of the soft reward has fallen to 1/e, rad/s."""
    done_weight: float = 400.0
    """Reward for docking, once: more than the discounted return of waiting at the port (5 a step, gamma 0.985)."""
    violation_weight: float = 20.0
    """Reward lost once when a constraint is violated, which ends the episode."""
    fail_distance: float = 8.0
    """Distance from the port beyond which an episode fails, m."""
    fail_spin: float = 4.0
    """Angular rate beyond which an episode fails, rad/s."""

    optimal_problem = "port"
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
        """Start around the target, and the docked state with the port in any direction."""
        start = random.around(*self.spawn_distance)
        spin = random.turn(self.port_rate)
        return start, self._docked(random.moving(random.origin(), random.attitude(), spin))

    def later(self, goal: State, time: Field) -> State:
        """Docked state after a time (s), rotated with the target."""
        return self._docked(step_goal(goal, FREE, time))

    def limits(self, goal: State) -> dict[str, Shape]:
        """The approach cone, and the keep-out ball of the target."""
        centre = goal.p + _ahead(goal.attitude).scale(self.standoff)
        return {
            "cone": self._cone(goal),
            "target": Ball(centre, goal.v.scale(0.0), self.target_radius),
        }

    done = SingleTask.reached  # the spacecraft is docked: all errors are within their tolerances

    def observation_terms(self, state: State, goal: State) -> tuple[ObservationTerm, ...]:
        """Differences of p, v (W), attitude and spin from the docked state, and the cone, in this order.

        Agents' files record kinds and order.
        """
        cone = self._cone(goal)
        return (
            VectorInW("d", "m", goal.p - state.p),
            RelativeRotation("d", "-", state.attitude.to(goal.attitude)),
            VectorInW("dv_", "m/s", goal.v - state.v),
            AngularVelocity(
                "dw",
                "rad/s",
                _spin_to_gain(state, goal),
                meaning="angular velocity of the docked state minus own, axes of the spacecraft",
            ),
            InformationInW(
                "axis ",
                "-",
                cone.axis,
                meaning="unit vector from the port along the axis of the approach cone, outwards",
            ),
            *cone.entries("cone", state),
        )

    def errors(self, state: State, goal: State) -> dict[str, Field]:
        """Distance, angle, velocity and spin relative to the docked state."""
        return super().errors(state, goal) | {"spin": speed(_spin_to_gain(state, goal))}

    def reward(self, transition: Transition) -> dict[str, Field]:
        """Terms (fields).

        Wide and narrow rewards of position and attitude, and near the port of velocity and spin.

        Names of terms are those of logs; shipped agents were trained with these terms.
        """
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
        """Whether the craft is too far away, or spins too fast."""
        lost = (goal.p - state.p).norm() > self.fail_distance
        return lost | (speed(state.spin()) > self.fail_spin)

    def _docked(self, turned: Any) -> Any:
        """Docked state (W) for the attitude and spin of another state: at the standoff, turning with the target."""
        towards = _ahead(turned.attitude)
        p = towards.scale(-self.standoff)
        if isinstance(turned.attitude, Heading):
            return replace(turned, p=p, v=Vec2(-turned.w * p.y, turned.w * p.x))
        # The spin is in the frame of the docked spacecraft, whose position from the target is along -x.
        v = turned.w.cross(Vec3(-self.standoff, 0.0, 0.0))
        return replace(turned, p=p, v=turned.attitude.rotate(v))

    def _cone(self, goal: State) -> Cone:
        towards = _ahead(goal.attitude)
        apex = goal.p + towards.scale(self.cone_depth)
        return Cone(apex, towards.scale(-1.0), self.cone_half_angle, self.cone_length)


def _ahead(attitude: Any) -> Vector:
    """Unit vector of a body's x axis in W."""
    axis: Any = Vec2(1.0, 0.0) if isinstance(attitude, Heading) else Vec3(1.0, 0.0, 0.0)
    return attitude.rotate(axis)


def _spin_to_gain(state: State, goal: State) -> tuple[Field, ...]:
    """Angular velocity of the goal less that of the spacecraft, in B of the spacecraft, rad/s."""
    turn = state.attitude.to(goal.attitude)
    if isinstance(turn, Quat):
        goal_spin: Any = turn.rotate(goal.w)
        return (goal_spin - state.w).columns()
    return (goal.w - state.w,)
