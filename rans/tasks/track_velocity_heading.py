"""Hold a velocity and an attitude (TrackXYVelocityHeading in the plane, TrackXYZVelocityAttitude)."""

from __future__ import annotations

import math
from dataclasses import dataclass

from rans.model.dynamics import State
from rans.model.fields import Field
from rans.model.random import Random
from rans.tasks.base import SingleTask
from rans.tasks.rewards import Transition, nearness, speed
from rans.tasks.sight import Entry, Turn, VectorInW


@dataclass(frozen=True)
class TrackVelocityHeading(SingleTask):
    """Reach a velocity and an attitude and hold both (paper: future work).

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
    fail_spin: float = 6.0
    """An episode fails beyond this rate, rad/s."""

    flag = 4

    def sample(self, random: Random) -> tuple[State, State]:
        """At rest at the origin; the goal moves and does not turn."""
        start = random.at_rest(random.origin(), random.attitude())
        velocity = random.direction().scale(random.uniform(*self.target_speed))
        return start, random.moving(velocity, random.attitude())

    def sight(self, state: State, goal: State) -> tuple[Entry, ...]:
        """The velocity still to gain and the rotation still to make."""
        return (VectorInW("dv_", "m/s", goal.v - state.v), Turn("d", "-", state.attitude.to(goal.attitude)))

    def errors(self, state: State, goal: State) -> dict[str, Field]:
        """Velocity error, and angle to the goal's attitude."""
        return {
            "velocity": (goal.v - state.v).norm(),
            "attitude": state.attitude.to(goal.attitude).magnitude(),
        }

    def tolerances(self) -> dict[str, float]:
        """See the settings."""
        return {"velocity": self.velocity_tolerance, "attitude": self.attitude_tolerance}

    def reward(self, transition: Transition) -> dict[str, Field]:
        """exp(-error / scale) of both, as the original system; a narrower and a wider copy; thrust."""
        velocity, angle = self.errors(transition.state, transition.goal).values()
        return {
            "velocity": nearness(velocity, self.velocity_scale),
            "attitude": nearness(angle, self.attitude_scale),
            "fine": nearness(velocity, self.fine_scale) * self.fine_weight,
            "turn": nearness(angle, self.turn_scale) * self.turn_weight,
            **self.prices(transition),
        }

    def failed(self, state: State, goal: State) -> Field:
        """Spinning too fast; there is no place to leave."""
        return speed(state.spin()) > self.fail_spin
