"""Reach a velocity and hold it, in the plane (TrackXYVelocity) or in space (TrackXYZVelocity)."""

from __future__ import annotations

from dataclasses import dataclass

from rans.model.dynamics import State
from rans.model.fields import Field
from rans.model.random import Random
from rans.tasks.base import SingleTask
from rans.tasks.rewards import Transition, nearness, speed
from rans.tasks.sight import Entry, VectorInW


@dataclass(frozen=True)
class TrackVelocity(SingleTask):
    """Reach a velocity and hold it (paper: Table 1, rows "Track velocity"; section 4.2).

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
    fail_spin: float = 6.0
    """An episode fails beyond this rate, rad/s."""

    flag = 2
    symmetric = False

    def sample(self, random: Random) -> tuple[State, State]:
        """At rest at the origin; the goal moves."""
        start = random.at_rest(random.origin(), random.attitude())
        velocity = random.direction().scale(random.uniform(*self.target_speed))
        return start, random.moving(velocity, random.no_rotation())

    def sight(self, state: State, goal: State) -> tuple[Entry, ...]:
        """The velocity still to gain."""
        return (VectorInW("dv_", "m/s", goal.v - state.v),)

    def errors(self, state: State, goal: State) -> dict[str, Field]:
        """Velocity error, and angular speed."""
        return {"velocity": (goal.v - state.v).norm(), "spin": speed(state.spin())}

    def tolerances(self) -> dict[str, float]:
        """See the settings."""
        return {"velocity": self.velocity_tolerance}

    def reward(self, transition: Transition) -> dict[str, Field]:
        """exp(-error / scale), as the original system; a narrower copy; stillness; thrust."""
        velocity, spin = self.errors(transition.state, transition.goal).values()
        return {
            "velocity": nearness(velocity, self.velocity_scale),
            "fine": nearness(velocity, self.fine_scale) * self.fine_weight,
            "stillness": nearness(spin, self.stillness_scale) * self.stillness_weight,
            **self.prices(transition),
        }

    def failed(self, state: State, goal: State) -> Field:
        """Spinning too fast; there is no place to leave."""
        return speed(state.spin()) > self.fail_spin
