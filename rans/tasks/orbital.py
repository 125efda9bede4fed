"""What missions near a target on a circular orbit have in common: a deadline, and the velocity to gain by it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import reduce
from operator import add
from typing import Any, ClassVar

from rans.errors import ConfigError
from rans.model.drift import ClohessyWiltshire, Drift, velocity_to_reach
from rans.model.dynamics import State
from rans.model.fields import Field, Vector, absolute, at_least, where
from rans.model.random import Random
from rans.tasks.base import SingleTask
from rans.tasks.observation_terms import (
    Dimension,
    Information,
    InformationInW,
    ObservationTerm,
    VectorInW,
)
from rans.tasks.rewards import Transition, is_used
from rans.tasks.shapes import Shape

PLANS = 24
"""Times of arrival that are compared for the plan of an episode, evenly up to its deadline."""
_PENALTY = 10.0
"""Price of a plan that breaks a limit, m/s for every unit of its margin."""
_INSTANT = 1e-3
"""Time left that counts as none, s: what is left of deadlines after many periods in single precision."""


@dataclass(frozen=True)
class OrbitalMission(SingleTask):
    """A mission to a place near a target on a circular orbit, by a deadline that every episode draws.

    W is the target's Hill frame: x radial outwards, y along the track, z across. The craft moves by the
    equations of Clohessy and Wiltshire. An episode that is not won by its deadline has failed.

    Every episode has a plan, which is a time of arrival: of `PLANS` times up to the deadline the one to which a
    single impulse from the start is cheapest, those last that break a limit at the start, at the arrival or after
    a third or two of the way. The velocity to gain is the change of velocity, now, with which the craft coasts to
    the goal by that time (Battin, "An Introduction to the Mathematics and Methods of
    Astrodynamics", 1999, chapter 11). The goal's ``notes`` are the time left until the deadline and until the
    planned arrival, s, and 1 once the mission is won.

    The policy observes the way to the goal, the velocity to gain, the velocity of arrival with it, by how much the
    coast to the planned arrival misses the goal (squashed to ten tolerances), both times, and the margins of every
    shape in `scenery`.

    Rewards are in velocity that thrust has wasted: every newton-second costs, and what it takes off the
    velocity to gain is paid back. An impulse to the goal at the start of an episode earns zero.

    Raises:
        ConfigError: the deadline is so late that the velocity to gain has no solution.
    """

    mean_motion: float = 0.001027
    """n of the target's orbit, rad/s."""
    deadline: tuple[float, float] = (600.0, 2000.0)
    """Range of the time that an episode has, s."""
    position_tolerance: float = 0.5
    """Distance from the goal at which the mission is won, m."""
    velocity_tolerance: float = 0.2
    """Speed at which it is won there, m/s."""
    shortest_aim: float = 10.0
    """The velocity to gain is at least for so long a time, s, however little is left: a control period."""
    impulse_weight: float = 0.1
    """Reward lost per newton-second of the thrusters."""
    gain_weight: float = 1.2
    """Reward for each m/s by which the velocity to gain falls, summed over the axes: by default the price of
    1 m/s for 12 kg."""
    most_gain: float = 1.0
    """Velocity to gain from which on more does not count and is not observed, m/s."""
    fail_distance: float = 1000.0
    """An episode fails farther than this from the goal, m."""
    thrust_weight: float = 0.0
    """Reward lost per step and open thruster: impulse is priced instead."""

    symmetric = False
    dimensions: ClassVar[tuple[Dimension, ...]] = (3,)
    optimal_problem = "rendezvous"
    brakes: ClassVar[bool] = False
    """Whether plans and rewards count the braking at the arrival too, and guidance brakes."""

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

    def planned(self, random: Random, start: State, goal: State) -> State:
        """The goal with a deadline that is drawn, and the plan for this start, in its notes."""
        deadline = random.uniform(*self.deadline)
        arrival = deadline
        cheapest = self._planned_price(start, goal, arrival)
        for k in range(1, PLANS):
            earlier = deadline * (1.0 - k / PLANS)
            price = self._planned_price(start, goal, earlier)
            better = price < cheapest
            arrival = where(better, earlier, arrival)
            cheapest = where(better, price, cheapest)
        return replace(goal, notes=(deadline, arrival, deadline * 0.0))

    def _planned_price(self, start: Any, goal: Any, time: Field) -> Field:
        """Velocity that an arrival after this time costs, m/s; more where the coast to it is beyond a limit."""
        gain = self.velocity_to_gain(start, goal, time)
        begun = start.v + gain
        price = self._price(start, goal, time, gain)
        for share in (0.0, 1 / 3, 2 / 3, 1.0):
            p, v = self.drift.carry(start.p, begun, at_least(time, self.shortest_aim) * share)
            for limit in self.limits(goal).values():
                price = price + at_least(0.0 - limit.gap(p, v), 0.0) * _PENALTY
        return price

    def arrival(self, goal: State) -> Field:
        """Time until the planned arrival, s."""
        return goal.notes[1]

    def later(self, goal: State, time: Field) -> State:
        """The goal stands still, and its times come nearer."""
        deadline, arrival, won = goal.notes
        return replace(goal, notes=(deadline - time, arrival - time, won))

    def remember(self, goal: State, state: State) -> State:
        """Whether the mission has been won."""
        deadline, arrival, won = goal.notes
        return replace(goal, notes=(deadline, arrival, where(self.done(state, goal), 1.0, won)))

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

    def observation_terms(self, state: Any, goal: Any) -> tuple[ObservationTerm, ...]:
        """Way to go, velocity to gain and of arrival, miss, times left, and what is observed of every limit."""
        deadline, arrival, _ = goal.notes
        gain = self.velocity_to_gain(state, goal, arrival)
        time = at_least(arrival, self.shortest_aim)
        _, at_goal = self.drift.carry(state.p, state.v + gain, time)
        missed = goal.p - self.drift.carry(state.p, state.v, time)[0]
        # Just before an arrival that misses it the velocity to gain has no bound.
        nearby = 0.1 / self.position_tolerance
        scale = 1.0 / at_least(gain.norm() * (1.0 / self.most_gain), 1.0)
        return (
            VectorInW("d", "m", goal.p - state.p),
            VectorInW("gain_", "m/s", gain.scale(scale)),
            InformationInW("arrival_v_", "m/s", at_goal.scale(scale)),
            InformationInW("miss_", "m", missed.scale(1.0 / (1.0 + missed.norm() * nearby))),
            Information("time left", "s", deadline),
            Information("time to arrival", "s", arrival),
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
        _, arrival, won = goal.notes
        terms = {}
        if is_used(self.impulse_weight):
            terms["impulse"] = transition.impulse * -self.impulse_weight
        if is_used(self.gain_weight):
            before = transition.state if transition.before is None else transition.before
            past = self._counted(before, goal, arrival + transition.period)
            now = self._counted(transition.state, goal, arrival)
            # Nothing is left to gain once the mission is won, wherever the rest of the period leads.
            terms["gain"] = (past - where(won > 0.5, 0.0, now)) * self.gain_weight
        return {**terms, **self.prices(transition)}

    def _counted(self, state: State, goal: State, left: Field) -> Field:
        """Velocity to gain as rewards count it, m/s."""
        gain = self._price(state, goal, left, self.velocity_to_gain(state, goal, left))
        return where(gain < self.most_gain, gain, self.most_gain)

    def _price(self, state: Any, goal: Any, left: Field, gain: Any) -> Field:
        """Velocity that gaining this now costs, m/s, with that of arrival where it must be braked."""
        price = _sum_of_sizes(gain)
        if not self.brakes:
            return price
        time = at_least(left, self.shortest_aim)
        return price + _sum_of_sizes(self.drift.carry(state.p, state.v + gain, time)[1] - goal.v)

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
