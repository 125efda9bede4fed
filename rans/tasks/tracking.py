"""Reach velocities and hold them: TrackVelocity, TrackTwist and TrackVelocityHeading."""

from __future__ import annotations

import math
from dataclasses import dataclass

from rans.model.dynamics import State
from rans.model.fields import Field
from rans.model.random import Random
from rans.tasks.base import SingleTask
from rans.tasks.observation_terms import (
    AngularVelocity,
    ObservationTerm,
    RelativeRotation,
    VectorInW,
)
from rans.tasks.rewards import Transition, is_used, nearness, speed, within

_SQUARINGS = 3
"""How sharp the edge is of what is paid within the tolerances: 1.1 times one leaves 0.32."""


@dataclass(frozen=True)
class Tracking(SingleTask):
    """What tasks with moving goals have in common."""

    within_weight: float = 0.0
    """Weight of being within all tolerances: for agents that should not leave them to gain elsewhere."""
    fail_spin: float = 6.0
    """An episode fails beyond this rate, rad/s."""

    def within(self, errors: dict[str, Field]) -> dict[str, Field]:
        """The term of it, if it has a weight."""
        if not is_used(self.within_weight):
            return {}
        shares = (errors[name] / bound for name, bound in self.tolerances().items())
        return {"within": within(*shares, sharpness=_SQUARINGS) * self.within_weight}

    def failed(self, state: State, goal: State) -> Field:
        """Spinning too fast; there is no place to leave."""
        return speed(state.spin()) > self.fail_spin


@dataclass(frozen=True)
class TrackVelocity(Tracking):
    """Reach a velocity and hold it (TrackXYVelocity, TrackXYZVelocity; paper: Table 1, section 4.2).

    >>> rans.TrackVelocity(target_speed=(0.0, 0.3)).tolerances()
    {'velocity': 0.05}

    Goal: any direction, up to the highest speed. Start: at rest at the origin, any attitude.

    Observed task data: v_goal - v in W (2 or 3 columns, m/s).

    The floating platform, open in pairs that do not turn it for one period of 0.2 s, reaches a square
    lattice of velocities 0.053 m/s apart only, whose nearest point is 0.020 m/s away on average (0.38 of
    the spacing). Agents come closer: between two pulses they turn a little, and the lattice with them.
    """

    target_speed: tuple[float, float] = (0.0, 0.75)
    """Range of the speed to track, m/s (original system)."""
    velocity_scale: float = 0.25
    """Error at which the velocity reward has fallen to 1/e, m/s (original system, 2023)."""
    fine_weight: float = 1.0
    """Weight of a narrower copy of the velocity reward."""
    fine_scale: float = 0.02
    """Error at which that copy has fallen to 1/e, m/s."""
    stillness_weight: float = 0.5
    """Weight of the reward for not spinning: with half of it some agents spin for good and open half of
    their thrusters, as that way they hit every velocity."""
    stillness_scale: float = 0.25
    """Angular speed at which the stillness reward has fallen to 1/e, rad/s."""
    velocity_tolerance: float = 0.05
    """Velocity error that counts as reached, m/s."""

    flag = 2
    symmetric = False

    def sample(self, random: Random) -> tuple[State, State]:
        """At rest at the origin; the goal moves."""
        start = random.at_rest(random.origin(), random.attitude())
        velocity = random.direction().scale(random.uniform(*self.target_speed))
        return start, random.moving(velocity, random.no_rotation())

    def observation_terms(self, state: State, goal: State) -> tuple[ObservationTerm, ...]:
        """The velocity still to gain."""
        return (VectorInW("dv_", "m/s", goal.v - state.v),)

    def errors(self, state: State, goal: State) -> dict[str, Field]:
        """Velocity error, and angular speed."""
        return {"velocity": (goal.v - state.v).norm(), "spin": speed(state.spin())}

    def reward(self, transition: Transition) -> dict[str, Field]:
        """exp(-error / scale), as the original system; a narrower copy; stillness; thrust."""
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

    Goal: a velocity in any direction; in the plane a rate of either sign, in space a rate about any
    axis of the body. Start: at rest at the origin, any attitude.

    Observed task data: v_goal - v in W (2 or 3 columns, m/s), then w_goal - w (plane: 1 column; space:
    3 columns in B; rad/s).

    On/off thrusters reach a lattice of spins only: one nozzle of the floating platform that is open for
    one period of 0.2 s changes its spin by q = 1 N * 0.31 m * 0.2 s / 0.2045 kg m^2 = 0.303 rad/s, as
    one of the free flyer does about one of three axes. So the nearest spin within reach of a craft that
    started at rest is off by up to q / 2 = 0.152 rad/s in the plane and sqrt(3) / 2 q = 0.263 rad/s in
    space; over the targets below, by 0.081 and 0.127 rad/s on average. No mean error can be smaller:
    changing between two spins of the lattice meets a target in the mean, but is farther off in absolute
    value. A higher control rate makes q smaller, and thrust that its open thrusters share, since then k of
    them turn the craft by q / k each: agents hold both velocities within 0.02 (docs/agents.md).
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
    """Error at which that copy has fallen to 1/e, m/s."""
    fine_spin_weight: float = 0.0
    """Weight of a narrower copy of the rotation reward; without shared thrust no spin is that near."""
    fine_spin_scale: float = 0.02
    """Error at which that copy has fallen to 1/e, rad/s."""
    velocity_tolerance: float = 0.1
    """Velocity error that counts as reached, m/s."""
    spin_tolerance: float = 0.35
    """Spin error that counts as reached, rad/s: more than q, so that a single pulse may correct the
    velocity (original system's evaluations: 0.3)."""

    flag = 3
    symmetric = False

    def sample(self, random: Random) -> tuple[State, State]:
        """At rest at the origin; the goal moves and turns."""
        start = random.at_rest(random.origin(), random.attitude())
        velocity = random.direction().scale(random.uniform(*self.target_speed))
        return start, random.moving(velocity, random.no_rotation(), random.spin(self.target_spin))

    def observation_terms(self, state: State, goal: State) -> tuple[ObservationTerm, ...]:
        """The velocities still to gain."""
        return (
            VectorInW("dv_", "m/s", goal.v - state.v),
            AngularVelocity("dw", "rad/s", spin_difference(state, goal)),
        )

    def errors(self, state: State, goal: State) -> dict[str, Field]:
        """Lengths of both differences."""
        return {"velocity": (goal.v - state.v).norm(), "spin": speed(spin_difference(state, goal))}

    def reward(self, transition: Transition) -> dict[str, Field]:
        """exp(-error / scale) of both velocities; narrower copies."""
        errors = self.errors(transition.state, transition.goal)
        velocity, spin = errors.values()
        return {
            "velocity": nearness(velocity, self.velocity_scale),
            "rotation": nearness(spin, self.spin_scale),
            "fine": nearness(velocity, self.fine_scale) * self.fine_weight,
            **(
                {"fine rotation": nearness(spin, self.fine_spin_scale) * self.fine_spin_weight}
                if is_used(self.fine_spin_weight)
                else {}
            ),
            **self.within(errors),
            **self.prices(transition),
        }


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
    """Error at which that copy has fallen to 1/e, m/s."""
    turn_weight: float = 0.5
    """Weight of a wider copy of the attitude reward, felt with any attitude."""
    turn_scale: float = 1.0
    """Error at which that copy has fallen to 1/e, rad."""
    thrust_weight: float = 0.05
    """Reward lost per step and fully open thruster; at 0.02 agents never rest: they chase the last
    centimetre per second with pulses that turn them by more than 5 degrees now and then."""
    velocity_tolerance: float = 0.1
    """Velocity error that counts as reached, m/s."""
    attitude_tolerance: float = math.radians(5.0)
    """Attitude error that counts as reached, rad."""

    flag = 4

    def sample(self, random: Random) -> tuple[State, State]:
        """At rest at the origin; the goal moves and does not turn."""
        start = random.at_rest(random.origin(), random.attitude())
        velocity = random.direction().scale(random.uniform(*self.target_speed))
        return start, random.moving(velocity, random.attitude())

    def observation_terms(self, state: State, goal: State) -> tuple[ObservationTerm, ...]:
        """The velocity still to gain and the rotation still to make."""
        return (
            VectorInW("dv_", "m/s", goal.v - state.v),
            RelativeRotation("d", "-", state.attitude.to(goal.attitude)),
        )

    def errors(self, state: State, goal: State) -> dict[str, Field]:
        """Velocity error, and angle to the goal's attitude."""
        angle = state.attitude.to(goal.attitude).magnitude()
        return {"velocity": (goal.v - state.v).norm(), "attitude": angle}

    def reward(self, transition: Transition) -> dict[str, Field]:
        """exp(-error / scale) of both, as the original system; a narrower and a wider copy; thrust."""
        errors = self.errors(transition.state, transition.goal)
        velocity, angle = errors.values()
        return {
            "velocity": nearness(velocity, self.velocity_scale),
            "attitude": nearness(angle, self.attitude_scale),
            "fine": nearness(velocity, self.fine_scale) * self.fine_weight,
            "turn": nearness(angle, self.turn_scale) * self.turn_weight,
            **self.within(errors),
            **self.prices(transition),
        }


def spin_difference(state: State, goal: State) -> tuple[Field, ...]:
    """Goal's less own angular velocity, rad/s: about z in the plane, in B in space."""
    return tuple(wanted - w for wanted, w in zip(goal.spin(), state.spin(), strict=True))
