"""Approach a hold point behind a target on a circular orbit from any side, around a keep-out ball."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Any, ClassVar

from rans.extend import (
    Ball,
    Field,
    Information,
    ObservationTerm,
    Random,
    Shape,
    State,
    Timing,
    at_least,
    map_leaves,
    where,
)
from rans_missions.guidance.arrival import TIME_ROUNDING
from rans_missions.passive_safety import CoastZone
from rans_missions.tasks.orbital import OrbitalMission, Plan

_NOT_HELD = -1.0
"""Time held outside the tolerances, s: any number below zero."""
_LATE_DISTANCE = 2.0
"""Position tolerances within which a craft that comes too late goes to the goal by the law with which it stays."""


@dataclass(frozen=True)
class HoldPlan(Plan):
    """What a goal of `Hold` notes."""

    held: Field = _NOT_HELD
    """Time for which the craft has been within the tolerances, s; -1 outside them."""


@dataclass(frozen=True)
class Hold(OrbitalMission):
    """Reach a hold point behind a target on a circular orbit by a deadline and stay there, outside a keep-out ball.

    >>> rans.load_task("hold").hold_distance
    100.0

    Goal: at rest 100 m behind the target, on its orbit. Success: within 5 m at 0.05 m/s or less at every check of
    `hold_seconds`, 600 s, from an arrival before the deadline on. An episode fails after the deadline if it is not
    within them, or has come too late. Constraint: at least 50 m from the target, at every check.

    Start: at rest in the Hill frame of the target, 150 to 300 m from the target in a uniform direction, and no
    nearer to the goal than the goal is to the ball.

    Source: hold point, keep-out ball, tolerances and dwell time of the scenario approach-vbar of the benchmark
    V-BAR (2026), with its craft `vbar-chaser` at 500 km. The ranges of starts and deadlines are our choice.
    """

    mean_motion: float = 0.0011068
    """Mean motion n of an orbit 500 km above the Earth (mu = 3.986004e14 m^3/s^2, radius 6,378.137 km), rad/s."""
    spawn_distance: tuple[float, float] = (150.0, 300.0)
    """Range of the start's distance from the target, m."""
    hold_distance: float = 100.0
    """Distance of the hold point behind the target, m."""
    keep_out: float = 50.0
    """Radius of the keep-out ball around the target, m."""
    position_tolerance: float = 5.0
    """Distance from the hold point that counts as reached, m."""
    velocity_tolerance: float = 0.05
    """Speed that counts as at rest, m/s."""
    hold_seconds: float = 600.0
    """Time within both tolerances that counts as held, s."""
    shortest_aim: float = 10.0
    """Least coasting time of the velocity to gain, s: a control period."""
    braking_time: float = 10.0
    done_weight: float = 1.0
    violation_weight: float = 1.0
    impulse_weight: float = 0.002
    """Reward lost per newton-second of thruster impulse."""
    gain_weight: float = 1.0
    """Reward per m/s by which the velocity to gain decreases; by default the price of 1 m/s for 500 kg."""

    flag = 9
    goal_notes = HoldPlan
    brakes: ClassVar[bool] = True
    stays: ClassVar[bool] = True
    few_burns: ClassVar[bool] = True
    spacecraft: ClassVar[str | None] = "vbar-chaser"
    timing: ClassVar[Timing] = Timing(control_period=10.0, episode_steps=260, checks=10)

    @property
    def coast_zone(self) -> CoastZone | None:
        """The keep-out ball, always; none where motion changes along the orbit."""
        return CoastZone(self.keep_out) if self.orbit.is_steady else None

    @property
    def stay_seconds(self) -> float:
        """See `OrbitalMission.stay_seconds`."""
        return self.hold_seconds

    def limits(self, goal: State) -> dict[str, Shape]:
        """The keep-out ball around the target at the origin."""
        origin = goal.p.scale(0.0)
        return {"keep-out": Ball(origin, origin, self.keep_out)}

    def plan(self, start: State, goal: State, deadline: Field) -> State:
        """Goal with a deadline, s, the plan for a start, and no time held in its notes."""
        planned = super().plan(start, goal, deadline)
        return replace(planned, notes=replace(planned.notes, held=deadline * 0.0 + _NOT_HELD))

    def later(self, goal: State, time: Field) -> State:
        """Goal after a time (s), with less time left and more time held."""
        held = goal.notes.held
        after = super().later(goal, time)
        held = where(held < 0.0, held, held + time)
        return replace(after, notes=replace(after.notes, held=held))

    def remember(self, goal: State, state: State) -> State:
        """Goal whose notes record for how long the state has been within the tolerances, and success."""
        held = where(self.reached(state, goal), at_least(goal.notes.held, 0.0), _NOT_HELD)
        return super().remember(replace(goal, notes=replace(goal.notes, held=held)), state)

    def recommended(self, state: Any, goal: Any, left: Field) -> Any:
        """Velocity in W, m/s: see `OrbitalMission`, and `staying` once the craft has arrived."""
        velocity = super().recommended(state, goal, left)
        near = (goal.p - state.p).norm() < self.position_tolerance * _LATE_DISTANCE
        stays = self.reached(state, goal) | ((goal.notes.deadline < TIME_ROUNDING) & near)
        return map_leaves(partial(where, stays), self.staying(state, goal), velocity)

    def observation_terms(self, state: Any, goal: Any) -> tuple[ObservationTerm, ...]:
        """Terms of `OrbitalMission`, then the time (s) for which the craft has been within the tolerances."""
        held = Information(
            "time held",
            "s",
            at_least(goal.notes.held, 0.0),
            meaning="time for which the craft has been within the tolerances",
        )
        return (*super().observation_terms(state, goal), held)

    def done(self, state: State, goal: State) -> Field:
        """Whether the craft has stayed for the time to hold since an arrival before the deadline."""
        return self._arrived_in_time(goal) & (goal.notes.held > self.hold_seconds - TIME_ROUNDING)

    def failed(self, state: State, goal: State) -> Field:
        """Whether the craft is too far away, or not within the tolerances since an arrival before the deadline."""
        distance = self.errors(state, goal)["position"]
        late = (goal.notes.deadline < TIME_ROUNDING) & ~self._arrived_in_time(goal)
        return (distance > self.fail_distance) | late

    def _arrived_in_time(self, goal: State) -> Field:
        """Whether the craft is within the tolerances, since before the deadline."""
        deadline, held = goal.notes.deadline, goal.notes.held
        return (held > -TIME_ROUNDING) & (deadline + held > -TIME_ROUNDING)

    def sample(self, random: Random) -> tuple[State, State]:
        """Start around the target and goal behind it; the notes of the goal have a deadline and a plan."""
        position = random.direction().scale(random.uniform(*self.spawn_distance))
        rest = random.at_rest(random.origin(), random.no_rotation())
        behind = replace(rest.p, y=-self.hold_distance)
        start = replace(rest, p=position)
        return start, self.planned(random, start, replace(rest, p=behind))
