"""Reach and hold velocities: TrackVelocity, TrackTwist and TrackVelocityHeading."""

from __future__ import annotations

import math
from dataclasses import dataclass

from rans.model.dynamics import State
from rans.model.fields import Field, Vec2, Vec3
from rans.model.random import Random
from rans.tasks.base import SingleTask
from rans.tasks.observation_terms import (
    AngularVelocity,
    ObservationTerm,
    RelativeRotation,
    VectorInW,
)
from rans.tasks.rewards import Transition, is_used, nearness, smooth_within, speed

_SQUARINGS = 3
"""Sharpness of the edge of the reward within the tolerances: at 1.1 times a tolerance 0.32 of it is left."""


@dataclass(frozen=True)
class Tracking(SingleTask):
    """Base class of tasks that track a velocity."""

    within_weight: float = 0.0
    """Weight of a reward for being within all tolerances."""
    fail_spin: float = 6.0
    """Angular rate beyond which an episode fails, rad/s."""

    def within(self, errors: dict[str, Field]) -> dict[str, Field]:
        """Reward term for being within all tolerances, if it has a weight."""
        if not is_used(self.within_weight):
            return {}
        ratios = (errors[name] / bound for name, bound in self.tolerances().items())
        return {"within": smooth_within(*ratios, sharpness=_SQUARINGS) * self.within_weight}

    def failed(self, state: State, goal: State) -> Field:
        """Whether the craft spins too fast."""
        return speed(state.spin()) > self.fail_spin


def _begun(random: Random, speeds: tuple[float, float]) -> tuple[State, Vec2 | Vec3]:
    """Start at rest at the origin, and the velocity of a goal; seeds rely on the order of draws."""
    start = random.at_rest(random.origin(), random.attitude())
    return start, random.direction().scale(random.uniform(*speeds))


@dataclass(frozen=True)
class TrackVelocity(Tracking):
    """Reach a velocity and hold it (TrackXYVelocity, TrackXYZVelocity; paper: Table 1, section 4.2).

    >>> rans.TrackVelocity(target_speed=(0.0, 0.3)).tolerances()
    {'velocity': 0.05}

    Goal: a velocity in any direction, with a speed in a range. Start: at rest at the origin, any attitude.

    Observed task data: v_goal - v in W (2 or 3 columns, m/s).

    With pairs of thrusters that do not rotate it, open for one period of 0.2 s, the floating platform reaches only
    a square lattice of velocities 0.053 m/s apart, whose nearest point is 0.020 m/s away on average (0.38 of
    the spacing). Agents come closer, because they rotate the lattice a little between two pulses.
    """

    target_speed: tuple[float, float] = (0.0, 0.75)
    """Range of the speed to track, m/s (original system)."""
    velocity_scale: float = 0.25
    """Error at which the velocity reward has fallen to 1/e, m/s (original system, 2023)."""
    fine_weight: float = 1.0
    """Weight of a narrower copy of the velocity reward."""
    fine_scale: float = 0.02
    """Error at which the narrower velocity reward has fallen to 1/e, m/s."""
    stillness_weight: float = 0.5
    """Weight of the reward for low spin. With half of it some agents spin permanently with half of their thrusters
    open, because they can then reach every velocity."""
    stillness_scale: float = 0.25
    """Angular speed at which the stillness reward has fallen to 1/e, rad/s."""
    velocity_tolerance: float = 0.05
    """Velocity error that counts as reached, m/s."""

    flag = 2
    symmetric = False

    def sample(self, random: Random) -> tuple[State, State]:
        """Start at rest at the origin, and a goal whose velocity is the target; seeds rely on this order."""
        start, velocity = _begun(random, self.target_speed)
        return start, random.moving(velocity, random.no_rotation())

    def observation_terms(self, state: State, goal: State) -> tuple[ObservationTerm, ...]:
        """The goal's velocity less the craft's, in W; agents' files record kinds and order of terms."""
        return (VectorInW("dv_", "m/s", goal.v - state.v),)

    def errors(self, state: State, goal: State) -> dict[str, Field]:
        """Velocity error, m/s, and angular speed, rad/s."""
        return {"velocity": (goal.v - state.v).norm(), "spin": speed(state.spin())}

    def reward(self, transition: Transition) -> dict[str, Field]:
        """Terms (fields): exp(-error / scale) of the original system, a narrower copy, low spin, and prices."""
        errors = self.errors(transition.state, transition.goal)
        velocity, spin = errors.values()
        return {
            "velocity": nearness(velocity, self.velocity_scale),
            "fine": nearness(velocity, self.fine_scale) * self.fine_weight,
            "stillness": nearness(spin, self.stillness_scale) * self.stillness_weight,
            **self.within(errors),
            **self.prices(transition),
        }


@dataclass(frozen=True)
class TrackTwist(Tracking):
    """Hold a linear and an angular velocity (TrackXYOVelocity, TrackXYZOVelocity; paper: Table 1).

    >>> rans.TrackTwist(target_spin=0.2).tolerances()
    {'velocity': 0.1, 'spin': 0.35}

    Goal: a velocity in any direction, and an angular velocity: in the plane of either sign, in space about any
    axis of the body. Start: at rest at the origin, any attitude.

    Observed task data: v_goal - v in W (2 or 3 columns, m/s), then w_goal - w (plane: 1 column; space:
    3 columns in B; rad/s).

    On/off thrusters reach only a lattice of spins. One nozzle of the floating platform that is open for one
    period of 0.2 s changes its spin by q = 1 N * 0.31 m * 0.2 s / 0.2045 kg m^2 = 0.303 rad/s, and one of the free
    flyer does so about one of three axes. The nearest reachable spin from rest thus has an error of up to
    q / 2 = 0.152 rad/s in the plane and sqrt(3) / 2 q = 0.263 rad/s in space; over the goals of this task the
    mean is 0.081 and 0.127 rad/s. No mean absolute error can be smaller: alternating between two spins of the
    lattice has the right mean but a larger mean absolute error. A higher control rate reduces q. A shared supply
    does too, because k open thrusters then change the spin by q / k each: agents keep both velocities within 0.02
    (docs/agents.md).
    """

    target_speed: tuple[float, float] = (0.0, 0.5)
    """Range of the speed to track, m/s (original system: each component up to 0.5)."""
    target_spin: float = 0.5
    """Highest rate to track, rad/s (original system)."""
    velocity_scale: float = 0.25
    """Error at which the velocity reward has fallen to 1/e, m/s (original system, 2023)."""
    spin_scale: float = 0.25
    """Error at which the rotation reward has fallen to 1/e, rad/s."""
    fine_weight: float = 0.5
    """Weight of a narrower copy of the velocity reward."""
    fine_scale: float = 0.05
    """Error at which the narrower velocity reward has fallen to 1/e, m/s."""
    fine_spin_weight: float = 0.0
    """Weight of a narrower copy of the rotation reward; without a shared supply no reachable spin is that near."""
    fine_spin_scale: float = 0.02
    """Error at which the narrower rotation reward has fallen to 1/e, rad/s."""
    velocity_tolerance: float = 0.1
    """Velocity error that counts as reached, m/s."""
    spin_tolerance: float = 0.35
    """Spin error that counts as reached, rad/s: above q, so that a single pulse may correct the velocity (0.3 in
    evaluations of the original system)."""

    flag = 3
    symmetric = False

    def sample(self, random: Random) -> tuple[State, State]:
        """Start at rest at the origin, and a goal that moves and rotates; seeds rely on the order of draws."""
        start, velocity = _begun(random, self.target_speed)
        return start, random.moving(velocity, random.no_rotation(), random.spin(self.target_spin))

    def observation_terms(self, state: State, goal: State) -> tuple[ObservationTerm, ...]:
        """Differences of velocity (W) and spin (B); agents' files record kinds and order of terms."""
        return (
            VectorInW("dv_", "m/s", goal.v - state.v),
            AngularVelocity("dw", "rad/s", spin_difference(state, goal)),
        )

    def errors(self, state: State, goal: State) -> dict[str, Field]:
        """Velocity error, m/s, and spin error, rad/s."""
        return super().errors(state, goal) | {"spin": speed(spin_difference(state, goal))}

    def reward(self, transition: Transition) -> dict[str, Field]:
        """Terms (fields) exp(-error / scale) of both velocities, narrower copies, and prices."""
        errors = self.errors(transition.state, transition.goal)
        velocity, spin, *_ = errors.values()
        terms = {
            "velocity": nearness(velocity, self.velocity_scale),
            "rotation": nearness(spin, self.spin_scale),
            "fine": nearness(velocity, self.fine_scale) * self.fine_weight,
        }
        if is_used(self.fine_spin_weight):
            terms["fine rotation"] = nearness(spin, self.fine_spin_scale) * self.fine_spin_weight
        return {**terms, **self.within(errors), **self.prices(transition)}


@dataclass(frozen=True)
class TrackVelocityHeading(Tracking):
    """Hold a velocity and an attitude (TrackXYVelocityHeading, TrackXYZVelocityAttitude; paper: future work).

    >>> rans.TrackVelocityHeading(velocity_tolerance=0.05).tolerances()["velocity"]
    0.05

    Goal: a velocity in any direction, and any attitude. Start: at rest at the origin, any attitude.

    Observed task data, plane: v_goal - v in W (2 columns, m/s), cos and sin of goal heading - heading.
    Space: v_goal - v in W (3 columns, m/s), first two rows of R_WB^T R_WGoal (6 columns).
    """

    target_speed: tuple[float, float] = (0.0, 0.75)
    """Range of the speed to track, m/s (original system)."""
    velocity_scale: float = 0.25
    """Error at which the velocity reward has fallen to 1/e, m/s (original system)."""
    attitude_scale: float = 0.25
    """Error at which the attitude reward has fallen to 1/e, rad (original system)."""
    fine_weight: float = 0.5
    """Weight of a narrower copy of the velocity reward."""
    fine_scale: float = 0.05
    """Error at which the narrower velocity reward has fallen to 1/e, m/s."""
    turn_weight: float = 0.5
    """Weight of a wider copy of the attitude reward, for large errors."""
    turn_scale: float = 1.0
    """Error at which the wider attitude reward has fallen to 1/e, rad."""
    thrust_weight: float = 0.05
    """Reward lost per step and fully open thruster. At 0.02 agents never come to rest: they correct the last
    centimetre per second with pulses that sometimes rotate them by more than 5 degrees."""
    velocity_tolerance: float = 0.1
    """Velocity error that counts as reached, m/s."""
    attitude_tolerance: float = math.radians(5.0)
    """Attitude error that counts as reached, rad."""

    flag = 4

    def sample(self, random: Random) -> tuple[State, State]:
        """Start at rest at the origin, and a goal that moves without spin; seeds rely on the order of draws."""
        start, velocity = _begun(random, self.target_speed)
        return start, random.moving(velocity, random.attitude())

    def observation_terms(self, state: State, goal: State) -> tuple[ObservationTerm, ...]:
        """Difference of velocity (W), rotation to the goal; agents' files record kinds and order of terms."""
        return (
            VectorInW("dv_", "m/s", goal.v - state.v),
            RelativeRotation("d", "-", state.attitude.to(goal.attitude)),
        )

    def reward(self, transition: Transition) -> dict[str, Field]:
        """Terms (fields): exp(-error / scale) of both, a narrower and a wider copy, and prices."""
        errors = self.errors(transition.state, transition.goal)
        velocity, angle, *_ = errors.values()
        return {
            "velocity": nearness(velocity, self.velocity_scale),
            "attitude": nearness(angle, self.attitude_scale),
            "fine": nearness(velocity, self.fine_scale) * self.fine_weight,
            "turn": nearness(angle, self.turn_scale) * self.turn_weight,
            **self.within(errors),
            **self.prices(transition),
        }


def spin_difference(state: State, goal: State) -> tuple[Field, ...]:
    """Angular velocity of the goal less that of the craft, rad/s: about z in the plane, in B in space."""
    return tuple(goal_spin - w for goal_spin, w in zip(goal.spin(), state.spin(), strict=True))
