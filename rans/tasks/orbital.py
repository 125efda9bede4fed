"""What missions near a target on a circular orbit have in common: a deadline, and the velocity to gain by it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import reduce
from operator import add
from typing import Any

from rans.errors import ConfigError
from rans.model.drift import ClohessyWiltshire, Drift, velocity_to_reach
from rans.model.dynamics import State
from rans.model.fields import Field, Vector, absolute, at_least
from rans.model.random import Random
from rans.tasks.base import SingleTask
from rans.tasks.observation_terms import Information, ObservationTerm, VectorInW
from rans.tasks.rewards import Transition, is_used
from rans.tasks.shapes import Shape

_INSTANT = 1e-3
"""Time left that counts as none, s: what is left of deadlines after many periods in single precision."""


@dataclass(frozen=True)
class OrbitalMission(SingleTask):
    """A mission to a place near a target on a circular orbit, by a deadline that every episode draws.

    W is the target's Hill frame: x radial outwards, y along the track, z across. The craft moves by the
    equations of Clohessy and Wiltshire. The goal's ``notes`` are the time left until the deadline, s; an episode
    that is not won by then has failed.

    The policy observes the way to the goal, the velocity to gain, the time left, and the margin of every shape
    in `scenery`. The velocity to gain is the change of velocity, now, with which the craft coasts to the goal by
    the deadline (Battin, "An Introduction to the Mathematics and Methods of Astrodynamics", 1999, chapter 11).

    Rewards are in velocity that thrust has wasted: every newton-second costs, and what it takes off the
    velocity to gain is paid back. A single impulse to the goal at the start of an episode earns zero.

    Raises:
        ConfigError: the deadline is so late that the velocity to gain has no solution.
    """

    mean_motion: float = 0.001027
    """n of the target's orbit, rad/s."""
    deadline: tuple[float, float] = (600.0, 2000.0)
    """Range of the time that an episode has, s."""
    shortest_aim: float = 10.0
    """The velocity to gain is at least for so long a time, s, however little is left: a control period."""
    impulse_weight: float = 0.1
    """Reward lost per newton-second of the thrusters."""
    gain_weight: float = 1.2
    """Reward for each m/s by which the velocity to gain falls, summed over the axes: by default the price of
    1 m/s for 12 kg."""
    fail_distance: float = 1000.0
    """An episode fails farther than this from the goal, m."""
    thrust_weight: float = 0.0
    """Reward lost per step and open thruster: impulse is priced instead."""

    symmetric = False

    def __post_init__(self) -> None:
        super().__post_init__()
        latest = self.deadline[1]
        if isinstance(latest, int | float) and latest * self.mean_motion >= 0.95 * math.pi:
            raise ConfigError(
                f"deadline must be < {0.95 * math.pi / self.mean_motion:.0f} s, 0.475 of the orbit's period, got "
                f"{self.deadline!r}: after half a period the velocity to gain has no solution."
            )

    @property
    def drift(self) -> Drift:
        """The equations of Clohessy and Wiltshire."""
        return ClohessyWiltshire(self.mean_motion)

    def sample_deadline(self, random: Random, goal: State) -> State:
        """The goal with the time left in its notes."""
        return replace(goal, notes=(random.uniform(*self.deadline),))

    def later(self, goal: State, time: Field) -> State:
        """The goal stands still, and the deadline comes nearer."""
        return replace(goal, notes=(goal.notes[0] - time,))

    def scenery(self, goal: State) -> tuple[Shape, ...]:
        """Limits of the mission."""
        return tuple(self.limits(goal).values())

    def limits(self, goal: State) -> dict[str, Shape]:
        """The shapes whose margins are the mission's constraints, by name: by default none."""
        return {}

    def constraints(self, state: State, goal: State) -> dict[str, Field]:
        """Margins of the limits, in SI units."""
        return {
            name: shape.gap(state.p, state.v - goal.v) for name, shape in self.limits(goal).items()
        }

    def velocity_to_gain(self, state: Any, goal: Any, left: Field) -> Any:
        """Change of velocity in W, m/s, with which a coasting craft is at the goal after the time left, s."""
        time = at_least(left, self.shortest_aim)
        return velocity_to_reach(self.drift, state.p, goal.p, time) - state.v

    def observation_terms(self, state: State, goal: State) -> tuple[ObservationTerm, ...]:
        """The way to go, the velocity to gain, the time left, and the margin of every limit."""
        (left,) = goal.notes
        gain = self.velocity_to_gain(state, goal, left)
        return (
            VectorInW("d", "m", goal.p - state.p),
            VectorInW("gain_", "m/s", gain),
            Information("time left", "s", left),
            *(
                entry
                for name, shape in self.limits(goal).items()
                for entry in shape.entries(name, state)
            ),
        )

    def errors(self, state: State, goal: State) -> dict[str, Field]:
        """Distance to the goal, and speed against it."""
        return {
            "position": (goal.p - state.p).norm(),
            "velocity": (goal.v - state.v).norm(),
        }

    def reward(self, transition: Transition) -> dict[str, Field]:
        """The fall of the velocity to gain, less the price of what was thrust for it."""
        goal = transition.goal
        (left,) = goal.notes
        terms = {}
        if is_used(self.impulse_weight):
            terms["impulse"] = transition.impulse * -self.impulse_weight
        if is_used(self.gain_weight):
            before = transition.state if transition.before is None else transition.before
            past = self.velocity_to_gain(before, goal, left + transition.period)
            now = self.velocity_to_gain(transition.state, goal, left)
            terms["gain"] = (_sum_of_sizes(past) - _sum_of_sizes(now)) * self.gain_weight
        return {**terms, **self.prices(transition)}

    def done(self, state: State, goal: State) -> Field:
        """Within every tolerance, and no later than the deadline."""
        return self.reached(state, goal) & (goal.notes[0] > -_INSTANT)

    def failed(self, state: State, goal: State) -> Field:
        """Too far away, or too late."""
        distance = self.errors(state, goal)["position"]
        return (distance > self.fail_distance) | (goal.notes[0] < _INSTANT)


def _sum_of_sizes(v: Vector) -> Field:
    """Sum of the absolute components, which is what thrusters along the axes pay for."""
    return reduce(add, map(absolute, v.columns()))
