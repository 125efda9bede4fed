"""Base class of missions near a target on a circular orbit, with a deadline and a planned arrival."""

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
"""Number of arrival times that are compared for the plan of an episode, evenly up to its deadline."""
_PENALTY = 10.0
"""Price of a plan that violates a limit, m/s per unit of its margin."""
_INSTANT = 1e-3
"""Time left that counts as none, s: rounding of deadlines after many periods in single precision."""


@dataclass(frozen=True)
class OrbitalMission(SingleTask):
    """Base class of missions to a position near a target on a circular orbit by a deadline.

    W is the Hill frame of the target: x radially outwards, y along the track, z across it. The craft follows the
    Clohessy-Wiltshire equations. Every episode draws a deadline and fails if the mission has not succeeded by it.

    Every episode has a plan, which is an arrival time: among `PLANS` times up to the deadline, the one that a
    single impulse at the start reaches at the least velocity change. Plans that violate a limit at the start, at
    the arrival, or after a third or two thirds of the time have a penalty. The velocity to gain is the velocity
    change now with which the craft coasts to the goal by the planned arrival (Battin, "An Introduction to the
    Mathematics and Methods of Astrodynamics", 1999, chapter 11). The ``notes`` of the goal are the time left until
    the deadline and until the planned arrival, s, and 1 after success.

    Observed task data: vector to the goal, velocity to gain, velocity at the arrival after gaining it, miss
    distance of a coast to the planned arrival (saturated at ten tolerances), both times, and the entries of every
    shape in `scenery`.

    Rewards measure wasted velocity change: impulse has a price, and a decrease of the velocity to gain is
    rewarded by the same price. An impulse to the goal at the start of an episode therefore earns zero.

    Raises:
        ConfigError: the deadline is so late that the velocity to gain has no solution.
    """

    mean_motion: float = 0.001027
    """Mean motion n of the target's orbit, rad/s."""
    deadline: tuple[float, float] = (600.0, 2000.0)
    """Range of the deadline, s."""
    position_tolerance: float = 0.5
    """Distance from the goal at which the mission succeeds, m."""
    velocity_tolerance: float = 0.2
    """Speed at which the mission succeeds, m/s."""
    shortest_aim: float = 10.0
    """Least coasting time of the velocity to gain, s: a control period."""
    impulse_weight: float = 0.1
    """Reward lost per newton-second of thruster impulse."""
    gain_weight: float = 1.2
    """Reward per m/s by which the velocity to gain decreases, summed over the axes; by default the price of 1 m/s
    for 12 kg."""
    most_gain: float = 1.0
    """Upper bound of the velocity to gain in rewards and observations, m/s."""
    fail_distance: float = 1000.0
    """Distance from the goal beyond which an episode fails, m."""
    thrust_weight: float = 0.0
    """Reward lost per step and open thruster; zero because impulse has a price."""

    symmetric = False
    dimensions: ClassVar[tuple[Dimension, ...]] = (3,)
    optimal_problem = "rendezvous"
    brakes: ClassVar[bool] = False
    """Whether plans and rewards include the velocity change of braking at the arrival, and guidance brakes."""

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
        """Clohessy-Wiltshire equations of the target's orbit."""
        return ClohessyWiltshire(self.mean_motion)

    def planned(self, random: Random, start: State, goal: State) -> State:
        """Goal with a drawn deadline and the plan for a start in its notes."""
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
        """Velocity change for an arrival after a time, m/s, with a penalty if the coast to it violates a limit."""
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
        """Goal after a time (s), with less time left; its position is constant."""
        deadline, arrival, won = goal.notes
        return replace(goal, notes=(deadline - time, arrival - time, won))

    def remember(self, goal: State, state: State) -> State:
        """Goal whose notes record whether the mission has succeeded."""
        deadline, arrival, won = goal.notes
        return replace(goal, notes=(deadline, arrival, where(self.done(state, goal), 1.0, won)))

    def scenery(self, goal: State) -> tuple[Shape, ...]:
        """Shapes of the mission's limits."""
        return tuple(self.limits(goal).values())

    def limits(self, goal: State) -> dict[str, Shape]:
        """Shapes whose margins are the constraints of the mission, by name; by default none."""
        return {}

    def constraints(self, state: State, goal: State) -> dict[str, Field]:
        """Margins of the limits, in SI units."""
        return {
            name: shape.gap(state.p, state.v - goal.v) for name, shape in self.limits(goal).items()
        }

    def velocity_to_gain(self, state: Any, goal: Any, left: Field) -> Any:
        """Velocity change in W, m/s, with which the craft coasts to the goal in the time left (s)."""
        time = at_least(left, self.shortest_aim)
        return velocity_to_reach(self.drift, state.p, goal.p, time) - state.v

    def observation_terms(self, state: Any, goal: Any) -> tuple[ObservationTerm, ...]:
        """Vector to the goal, velocity to gain and of arrival, miss distance, times left, and entries of limits."""
        deadline, arrival, _ = goal.notes
        gain = self.velocity_to_gain(state, goal, arrival)
        time = at_least(arrival, self.shortest_aim)
        _, at_goal = self.drift.carry(state.p, state.v + gain, time)
        missed = goal.p - self.drift.carry(state.p, state.v, time)[0]
        # The velocity to gain is unbounded just before an arrival that misses the goal.
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
        """Distance from the goal, m, and speed relative to it, m/s."""
        return {
            "position": (goal.p - state.p).norm(),
            "velocity": (goal.v - state.v).norm(),
        }

    def reward(self, transition: Transition) -> dict[str, Field]:
        """Decrease of the velocity to gain, less the price of impulse."""
        goal = transition.goal
        _, arrival, won = goal.notes
        terms = {}
        if is_used(self.impulse_weight):
            terms["impulse"] = transition.impulse * -self.impulse_weight
        if is_used(self.gain_weight):
            before = transition.state if transition.before is None else transition.before
            past = self._counted(before, goal, arrival + transition.period)
            now = self._counted(transition.state, goal, arrival)
            # After success nothing is left to gain, whatever happens in the rest of the period.
            terms["gain"] = (past - where(won > 0.5, 0.0, now)) * self.gain_weight
        return {**terms, **self.prices(transition)}

    def _counted(self, state: State, goal: State, left: Field) -> Field:
        """Price of the velocity to gain in rewards, m/s, bounded by `most_gain`."""
        gain = self._price(state, goal, left, self.velocity_to_gain(state, goal, left))
        return where(gain < self.most_gain, gain, self.most_gain)

    def _price(self, state: Any, goal: Any, left: Field, gain: Any) -> Field:
        """Velocity change of gaining ``gain`` now, m/s, and of braking at the arrival if the mission brakes."""
        price = _sum_of_sizes(gain)
        if not self.brakes:
            return price
        time = at_least(left, self.shortest_aim)
        return price + _sum_of_sizes(self.drift.carry(state.p, state.v + gain, time)[1] - goal.v)

    def done(self, state: State, goal: State) -> Field:
        """Whether the state is within all tolerances before the deadline."""
        return self.reached(state, goal) & (goal.notes[0] > -_INSTANT)

    def failed(self, state: State, goal: State) -> Field:
        """Whether the craft is too far away, or the deadline has passed."""
        distance = self.errors(state, goal)["position"]
        return (distance > self.fail_distance) | (goal.notes[0] < _INSTANT)


def _sum_of_sizes(v: Vector) -> Field:
    """Sum of the absolute components: the velocity change of thrusters along the axes."""
    return reduce(add, map(absolute, v.columns()))
