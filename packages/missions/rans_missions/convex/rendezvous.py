"""Least impulse of a rendezvous by a deadline, in a linear drift, as a conic program with its proof.

Commands are held for a control period each, positions and velocities are affine in them, and a meeting is a ball of
positions and one of velocities: a second-order cone program (S. Boyd and L. Vandenberghe, "Convex Optimization",
2004, section 4.4). Its dual solution bounds the impulse of every flight that meets at that instant from below,
whatever its commands are, and of other instants too: `proof` checks them all.

Limits that are not convex, such as a speed limit that grows with the distance or a keep-out ball, are left out of
the lower bound. The upper bound, a flight that keeps them at every check, comes from the convex-concave procedure
(T. Lipp and S. Boyd, "Variations and extension of the convex-concave procedure", 2016): what is concave is taken as
its tangent at the flight before. Any change must leave `proof` a lower bound for any multipliers: tests give it
random ones.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from scipy import sparse

from rans.extend import (
    Ball,
    Cone,
    ConfigError,
    Drift,
    Scenario,
    Shape,
    Spacecraft,
    SpeedLimit,
    Timing,
    Vec2,
    Vec3,
    leaves,
    map_leaves,
)
from rans_missions.convex.cone_program import ConeProgram, Rows, SolverFailed
from rans_missions.orbits.linear import held, transition
from rans_missions.tasks.orbital import OrbitalMission, last_check
from rans_missions.vectors import numbers

_ROUNDS = 12
"""Of the convex-concave procedure at most."""
_SLACK = 1e-5
"""By which a flight keeps its limits, m or m/s, so that rounding breaks none."""
_CONVERGED = 1e-3
"""Relative change of the impulse at which rounds end."""
_FARTHER = 0.02
"""Share of its length by which a cone reaches farther where rounds end outside it."""
_WIDEST = 100.0
"""Range of arrivals that share a program at first, s."""


@dataclass(frozen=True)
class Meeting:
    """Rendezvous of a spacecraft without torque: its target position, tolerances and thrusters."""

    drift: Drift
    timing: Timing
    forces: np.ndarray
    """(d, m) full force of each thruster in W, N."""
    mass: float
    """kg"""
    point: np.ndarray
    """(d,) position to meet at, m."""
    position_tolerance: float
    """m"""
    velocity_tolerance: float
    """m/s"""
    limits: tuple[Shape, ...] = ()
    """Kept at every check but the first instant. Fields of shapes that move have a value for each check."""
    every: int = 1
    """Flights thrust in every so many-th control period only, which makes their programs smaller."""

    @classmethod
    def of(cls, craft: Spacecraft, task: OrbitalMission, goal: Any) -> Meeting:
        """The meeting that a mission asks for.

        Raises:
            ConfigError: thrusters turn the craft, so that forces in W are not linear in its commands, or the motion
                changes along the orbit.
        """
        if not task.drift.steady:
            raise ConfigError(
                f"convex bounds are for motion that is the same at all times, and {task.drift.name} changes along "
                "the orbit; fly the mission on a circle."
            )
        return cls(
            task.drift,
            task.timing,
            forces_in_w(craft),
            craft.mass,
            np.array([float(np.squeeze(x)) for x in leaves(goal.p)]),
            task.position_tolerance,
            task.velocity_tolerance,
            tuple(task.limits(goal).values()),
        )

    @property
    def price(self) -> np.ndarray:
        """(m,) impulse of each thruster open for a whole period, N s."""
        return np.linalg.norm(self.forces, axis=0) * self.timing.control_period

    @property
    def interval(self) -> float:
        """Time between two checks, s."""
        return self.timing.control_period / self.timing.checks

    @cached_property
    def _tables(self) -> tuple[np.ndarray, np.ndarray]:
        """Free motion (L, 2 d, 2 d), and effect (L, 2 d, m) of a command, by its age in checks.

        A command that began so many checks ago has been held until now, or for its whole period.
        """
        size = len(self.point)
        times = self.interval * np.arange(self.timing.checks * self.timing.episode_steps + 1)
        free = transition(self.drift, times, size)
        effect = held(self.drift, times, size)
        per_period = self.timing.checks
        late = np.arange(per_period, len(times))
        effect[late] = free[late - per_period] @ effect[per_period]
        return free, effect @ (self.forces / self.mass)

    def free(self, start: np.ndarray, checks: np.ndarray) -> np.ndarray:
        """States (L, 2 d) after so many checks without thrust, of a state (2 d,) at the start."""
        return self.transition(checks) @ start

    def missed(self, start: np.ndarray, checks: np.ndarray) -> np.ndarray:
        """States (L, 2 d) relative to the point after so many checks without thrust, of a state at the start."""
        away = self.free(start, checks)
        away[:, : len(self.point)] -= self.point
        return away

    def transition(self, checks: int | np.ndarray) -> np.ndarray:
        """(2 d, 2 d), or (L, 2 d, 2 d): what a difference of states becomes in so many checks without thrust."""
        return self._tables[0][checks]

    def effect(self, check: int, periods: int) -> np.ndarray:
        """(2 d, periods m): what the commands of the first periods have done by a check."""
        _, effect = self._tables
        ages = np.maximum(check - self.timing.checks * np.arange(periods), 0)
        return np.moveaxis(effect[ages], 0, 1).reshape(effect.shape[1], -1)

    def response(self, period: int, last: int) -> np.ndarray:
        """(L, 2 d, m): what the command of a period has done by each check from its beginning to the last one."""
        return self._tables[1][: last + 1 - period * self.timing.checks]

    def saved(self, multiplier: np.ndarray, last: int) -> np.ndarray:
        """(last + 1,) what commands may save in `proof`'s bounds by a multiplier (2 d,), N s, at most zero.

        `proof` adds it to a bound: a number that is too low weakens the bound, and one that is too high makes it
        wrong.
        """
        _, effect = self._tables
        # What commands of each age may save, added up over all that began before each check.
        saved = np.minimum(self.price + multiplier @ effect[: last + 1], 0.0).sum(axis=1)
        saved[0] = 0.0
        per_period = self.timing.checks
        padded = np.zeros(-(-(last + 1) // per_period) * per_period)
        padded[: last + 1] = saved
        return padded.reshape(-1, per_period).cumsum(axis=0).ravel()[: last + 1]

    def periods(self, check: int) -> int:
        """Control periods that have begun before a check."""
        return -(-check // self.timing.checks)


def forces_in_w(craft: Spacecraft) -> np.ndarray:
    """(d, m) full force of each thruster in W, N, of a craft whose axes are those of W.

    Raises:
        ConfigError: thrusters turn the craft, so that forces in W are not linear in its commands.
    """
    if craft.can_turn:
        raise ConfigError(
            f"convex bounds are for craft whose thrusters pass through the centre of mass, and those of "
            f"{craft.name} turn it; fly one such as afrl-deputy."
        )
    directions = np.array([thruster.direction for thruster in craft.thrusters]).T
    sizes = np.array([thruster.force for thruster in craft.thrusters])
    return directions[: craft.dimension] * sizes


@dataclass(frozen=True)
class MeetingTransfer:
    """A flight that meets at one check."""

    check: int
    """Check of the meeting, from the start."""
    commands: np.ndarray
    """(periods, m), 0 to 1."""
    impulse: float
    """N s"""
    multiplier: np.ndarray
    """(2 d,) what the impulse falls by if the free motion to the meeting ends farther along each axis, N s per m
    and per m/s; see `proof`."""


@dataclass(frozen=True)
class Answer:
    """Least impulse of a meeting by a deadline, from both sides."""

    lower: float
    """N s: no flight that meets at any check up to the deadline uses less, with or without limits."""
    transfer: MeetingTransfer | None
    """The cheapest flight found that keeps every limit at every check; None: none was found."""
    free: MeetingTransfer
    """The cheapest flight found without limits."""


def state_of(scenario: Scenario) -> np.ndarray:
    """(2 d,) position, m, and velocity, m/s, of the start of an episode."""
    start: Any = scenario.start
    return np.concatenate([numbers(start.p), numbers(start.v)])


def least_impulse(
    meeting: Meeting,
    start: np.ndarray,
    last: int,
    limits: Sequence[Shape] = (),
    reference: np.ndarray | None = None,
    first: int | None = None,
) -> MeetingTransfer | None:
    """The flight of least impulse that meets at every check from one to another; None: there is none.

    Args:
        meeting: what is to be done.
        start: (2 d,) position (m) and velocity (m/s) in W.
        last: check of the meeting, the last one of a stay.
        limits: kept at every check from the first one of the flight to the last.
        reference: (last + 1, 2 d) states at which concave limits are taken as tangents; needed with limits.
        first: check of the arrival; None: that of the meeting, without a stay.

    Raises:
        SolverFailed: Clarabel ends neither with a solution nor with a proof that there is none.
    """
    first = last if first is None else first
    flights = Flights(meeting, start, last)
    count = 2 + int((last - first) * meeting.interval / _APART)
    within = {int(k) for k in np.linspace(last, first, count)}
    for k in within:
        flights.be_within(k)
    watched: set[int] = set()
    limits_at = at_checks(limits)
    while True:
        result = flights.cheapest()
        if result is None or (first == last and not limits):
            return result
        # Checks at which tolerances or limits are broken join those that are watched.
        states = trajectory(meeting, start, result)
        left = [k for k in range(first, last) if k not in within and _misses(meeting, states[k])]
        fresh: list[int] = []
        if reference is not None:
            pairs = enumerate(zip(states[1:], reference[1:], strict=True), 1)
            fresh = [
                k
                for k, (state, other) in pairs
                if k not in watched and _tangent_margin(limits_at(k), state, other) < 0.0
            ]
        if not left and not fresh:
            return result
        # Where a stay is left in many checks, the outermost and every tenth tell of all others.
        for k in left if len(left) < _FEW else left[:: len(left) // _FEW]:
            within.add(k)
            flights.be_within(k)
        if len(fresh) > _AT_ONCE:
            fresh = fresh[:: len(fresh) // _AT_ONCE]
        watched.update(fresh)
        if reference is not None:
            for k in fresh:
                for limit in limits_at(k):
                    flights.keep(limit, k, reference[k])


_APART = 30.0
"""Time between two checks of a stay that a program has at first, s; those that its flight breaks join them."""
_FEW = 8
"""Checks of a stay that join a program at once, about."""
_AT_ONCE = 24
"""Checks with broken limits that join a program at once, about: of hundreds in a cone most are alike."""


def _misses(meeting: Meeting, state: np.ndarray) -> bool:
    """Whether a state (2 d,) is outside the tolerances of the meeting."""
    size = len(meeting.point)
    away = np.linalg.norm(state[:size] - meeting.point)
    speed = np.linalg.norm(state[size:])
    return bool(away > meeting.position_tolerance or speed > meeting.velocity_tolerance)


def trajectory(meeting: Meeting, start: np.ndarray, transfer: MeetingTransfer) -> np.ndarray:
    """States (check + 1, 2 d) of a transfer at every check from the start to the meeting."""
    states = meeting.free(start, np.arange(transfer.check + 1))
    # What every command does from the check at which it begins.
    for period, command in enumerate(transfer.commands):
        first = period * meeting.timing.checks
        if command.any():
            states[first:] += meeting.response(period, transfer.check) @ command
    return states


def proof(meeting: Meeting, start: np.ndarray, last: int, multiplier: np.ndarray) -> np.ndarray:
    """Lower bounds (last + 1,) of the impulse of meeting at each check, N s, by weak duality.

    For any multiplier y of the state x at the meeting, the impulse of a flight that meets at a check is at least

        y . x_free - r |y_p| - s |y_v| - sum over commands of max(0, -(price + y . effect)),

    with r and s the radii of the meeting's balls. Whatever the multiplier is, the bounds hold; that of the cheapest
    flight at a check makes them tight nearby.

    Args:
        meeting: what is to be done.
        start: (2 d,) state.
        last: last check.
        multiplier: (2 d,), N s per m and per m/s.
    """
    size = len(meeting.point)
    away = meeting.missed(start, np.arange(last + 1))
    constant = meeting.position_tolerance * np.linalg.norm(multiplier[:size])
    constant += meeting.velocity_tolerance * np.linalg.norm(multiplier[size:])
    return away @ multiplier - constant + meeting.saved(multiplier, last)


def _sharpen(
    bounds: np.ndarray, meeting: Meeting, start: np.ndarray, check: int
) -> MeetingTransfer | None:
    """Raise the bounds of all instants by the cheapest flight at one, which is returned.

    None: there is none; where that is proved for the whole tolerances, the bound is infinite.
    """
    try:
        found = least_impulse(meeting, start, check)
    except SolverFailed:
        return None
    if found is None:
        # Flights leave a spare part of the tolerances, and a proof has to have all of them.
        whole = Flights(meeting, start, check, spare=0.0)
        whole.be_within(check)
        bounds[check] = max(bounds[check], whole.least())
        return None
    np.maximum(bounds, proof(meeting, start, len(bounds) - 1, found.multiplier), out=bounds)
    return found


def instant_bounds(
    meeting: Meeting, start: np.ndarray, last: int
) -> tuple[np.ndarray, dict[int, MeetingTransfer]]:
    """Lower bounds (last + 1,) of the impulse of meeting at each check, N s, and the flights at 24 of them.

    Bounds are sharp at these.
    """
    bounds = np.zeros(last + 1)
    bounds[0] = np.inf
    checks = np.unique(np.linspace(1, last, 24).astype(int)).tolist()
    found = {check: _sharpen(bounds, meeting, start, check) for check in checks}
    return bounds, {check: flight for check, flight in found.items() if flight is not None}


def least_over_arrivals(
    meeting: Meeting,
    start: np.ndarray,
    last: int,
    bound_of: Callable[[int, int], float],
    narrowest: float,
) -> tuple[float, int]:
    """Impulse below which no flight arrives by a check, N s, and the last check of the cheapest range of arrivals.

    Branch and bound over ranges of arrivals; an arrival is a meeting too, whose bound is known for every check.

    Args:
        meeting: what is to be done.
        start: (2 d,) position (m) and velocity (m/s) in W.
        last: last check of an arrival.
        bound_of: bound of the arrivals from one check to another, N s; infinite: there are none.
        narrowest: range below which none is divided, s.
    """
    instants, _ = instant_bounds(meeting, start, last)

    def asked(first: int, end: int, least: float = 0.0) -> tuple[float, bool, int, int]:
        return max(least, float(instants[first : end + 1].min())), False, first, end

    # Lower bound, whether a program has made it, and the first and last check of the arrival.
    ranges = [asked(*one) for one in ranges_of_arrivals(last, meeting.interval)]
    heapq.heapify(ranges)
    while True:
        bound, is_sharp, first, end = heapq.heappop(ranges)
        if not is_sharp and np.isfinite(bound):
            heapq.heappush(ranges, (max(bound, bound_of(first, end)), True, first, end))
        elif not np.isfinite(bound) or (end - first) * meeting.interval < narrowest:
            return bound, end
        else:
            middle = (first + end) // 2
            for half in (first, middle), (middle + 1, end):
                heapq.heappush(ranges, asked(*half, bound))


def ranges_of_arrivals(last: int, interval: float) -> list[tuple[int, int]]:
    """Ranges of arrivals that share a program at first: the first and the last check of each, from 1 to ``last``.

    Together they have every check once; bounds rely on it.

    Args:
        last: number of the last check.
        interval: time between two checks, s.
    """
    edges = np.linspace(1, last + 1, 1 + max(1, round(last * interval / _WIDEST)))
    return [(first, end - 1) for first, end in pairwise(np.unique(edges.astype(int)).tolist())]


_WITHIN = 0.002
"""Relative distance between the lower bound and a flight without limits at which a search ends."""
_INSTANTS = 300
"""Instants at which the bound is sharpened at most."""


def least_to_meet(
    meeting: Meeting, start: np.ndarray, deadline: float
) -> tuple[float, list[MeetingTransfer]]:
    """Impulse below which no flight meets by a deadline, N s, and nearly the cheapest without limits, by impulse.

    Branch and bound over the instants of the meeting: multipliers bound all of them at once, and where the bound
    is lowest it is sharpened, until it is close to the impulse of a flight. Infinite: it is proved that nothing
    meets.

    Args:
        meeting: what is to be done.
        start: (2 d,) position and velocity in W.
        deadline: s.
    """
    last = last_check(deadline, meeting.interval)
    last = min(last, meeting.timing.checks * meeting.timing.episode_steps)
    bounds, flights = instant_bounds(meeting, start, last)
    for _ in range(_INSTANTS):
        cheapest = min((flight.impulse for flight in flights.values()), default=np.inf)
        weakest = int(np.argmin(bounds))
        if weakest in flights or bounds[weakest] >= (1.0 - _WITHIN) * cheapest:
            break
        found = _sharpen(bounds, meeting, start, weakest)
        if found is not None:
            flights[weakest] = found
        elif np.isfinite(bounds[weakest]):
            break
    order = sorted(flights.values(), key=lambda flight: flight.impulse)
    near = [one for one in order if one.impulse <= (1.0 + _WITHIN) * order[0].impulse]
    return float(np.min(bounds)), near


def rendezvous(meeting: Meeting, start: np.ndarray, deadline: float) -> Answer:
    """Least impulse with which a spacecraft meets by a deadline, bounded from both sides.

    Args:
        meeting: what is to be done.
        start: (2 d,) position and velocity in W.
        deadline: s.

    Raises:
        SolverFailed: no meeting by the deadline is possible.
    """
    lower, near = least_to_meet(meeting, start, deadline)
    if not near:
        raise SolverFailed("no meeting by the deadline is possible: the thrusters are too weak.")
    transfer = cheapest_within_limits(meeting, start, [(one, one.check) for one in near])
    return Answer(lower, transfer, near[0])


def cheapest_within_limits(
    meeting: Meeting, start: np.ndarray, begun: Sequence[tuple[MeetingTransfer, int]]
) -> MeetingTransfer | None:
    """The cheapest flight found that keeps every limit at every check; None: none was found.

    Args:
        meeting: what is to be done.
        start: (2 d,) position (m) and velocity (m/s) in W.
        begun: flights without limits from which rounds begin, and the check of the arrival of each, after which it
            stays until its meeting.
    """
    best: MeetingTransfer | None = None
    for flight, first in sorted(begun, key=lambda one: one[0].impulse):
        # Limits make no flight cheaper.
        if best is not None and flight.impulse >= best.impulse:
            break
        states = trajectory(meeting, start, flight)
        found: MeetingTransfer | None = flight
        if least_margin(meeting.limits, states) < 0.0:
            found = successive(meeting, start, flight.check, meeting.limits, states, first)
        if found is not None and (best is None or found.impulse < best.impulse):
            best = found
    return best


def successive(
    meeting: Meeting,
    start: np.ndarray,
    last: int,
    limits: tuple[Shape, ...],
    states: np.ndarray,
    first: int | None = None,
) -> MeetingTransfer | None:
    """The last flight of successive programs that keeps the meeting's limits; None: no program had one.

    The tangents of a round are at the flight of the round before. Where the solver fails, the flights until then
    count. A cone applies near its apex only: rounds constrain the checks at which the flight before was near. Where
    they end with a flight that comes near earlier, outside the cone, more rounds follow in which the cone reaches a
    little farther.

    Args:
        meeting: what is to be done.
        start: (2 d,) position (m) and velocity (m/s) in W.
        last: see `least_impulse`, also for `first`.
        limits: that the programs have.
        states: (last + 1, 2 d) where the first round has its tangents.
        first: see above.
    """
    result: MeetingTransfer | None = None
    cost = np.inf
    is_final = not any(isinstance(limit, Cone) for limit in limits)
    for _ in range(_ROUNDS):
        try:
            trial = least_impulse(meeting, start, last, limits, states, first)
        except SolverFailed:
            return result
        if trial is None:
            return result
        states = trajectory(meeting, start, trial)
        if least_margin(meeting.limits, states) >= 0.0:
            result = trial
        if abs(cost - trial.impulse) < _CONVERGED * trial.impulse:
            if result is not None or is_final:
                break
            limits = tuple(_farther(limit) for limit in limits)
            is_final = True
        cost = trial.impulse
    return result


def _farther(limit: Shape) -> Shape:
    """A cone that is a little longer; other limits as they are."""
    if isinstance(limit, Cone):
        return replace(limit, length=limit.length * (1.0 + _FARTHER))
    return limit


def at_checks(limits: Sequence[Shape]) -> Callable[[Any], Sequence[Shape]]:
    """Limits by the check, or a slice of checks; those that do not move are the same at all."""
    if all(np.size(x) == 1 for x in leaves(tuple(limits))):
        return lambda check: limits
    return lambda check: map_leaves(lambda x: x[check] if np.size(x) > 1 else x, tuple(limits))


def least_margin(limits: Sequence[Shape], states: np.ndarray) -> float:
    """The least margin of any limit at any state (L, 2 d) after the start.

    A gap below 0 is a violation at a check, as the engine's own constraint has it; the start is not judged.
    """
    return min(
        (
            float(np.min(_gap(limit, states[1:])))
            for limit in at_checks(limits)(slice(1, len(states)))
        ),
        default=np.inf,
    )


def _gap(limit: Shape, states: np.ndarray) -> np.ndarray:
    size = states.shape[1] // 2
    vector: Any = Vec2 if size == 2 else Vec3
    return limit.gap(vector(*states[:, :size].T), vector(*states[:, size:].T))


def _tangent_margin(limits: Sequence[Shape], state: np.ndarray, reference: np.ndarray) -> float:
    """The least margin of limits at a state (2 d,), with what is concave in them tangent at the reference."""
    margins = []
    for limit in limits:
        cone = cone_rows(limit, reference)
        head = cone.row @ state + cone.constant
        tail = cone.matrix @ state + cone.vector
        margins.append(head - np.linalg.norm(tail) - 0.5 * _SLACK)
    return min(margins)


class ConeRows(NamedTuple):
    """|matrix x + vector| <= row x + constant, for a state x."""

    row: np.ndarray
    constant: float
    matrix: np.ndarray
    vector: np.ndarray


def cone_rows(limit: Shape, reference: np.ndarray) -> ConeRows:
    """A limit as a second-order cone, tangent at a reference state (2 d,) where it is not convex.

    Raises:
        ConfigError: the kind of limit is unknown.
    """
    size = len(reference) // 2
    position, velocity = np.split(np.eye(2 * size), 2)
    at = reference[:size]

    def away(point: np.ndarray) -> tuple[np.ndarray, float]:
        """The distance from a point, at least its component along the reference's: a row and a constant."""
        offset = at - point
        unit = offset / max(float(np.linalg.norm(offset)), 1e-9)
        return unit @ position, -float(unit @ point)

    # |v| <= base + slope |p - at|.
    if isinstance(limit, SpeedLimit):
        row, constant = away(numbers(limit.at))
        slope = float(limit.slope)
        return ConeRows(slope * row, float(limit.base) + slope * constant, velocity, np.zeros(size))
    # A ball to keep out of: the half space beyond the tangent plane that faces the reference.
    if isinstance(limit, Ball):
        row, constant = away(numbers(limit.centre))
        return ConeRows(row, constant - float(limit.radius), position[:0], np.zeros(0))
    # A cone around an axis is convex; far from its apex it does not apply.
    if isinstance(limit, Cone):
        apex, axis = numbers(limit.apex), numbers(limit.axis)
        if np.linalg.norm(at - apex) > float(limit.length):
            return ConeRows(0.0 * position[0], 1.0, position[:0], np.zeros(0))
        tangent = np.tan(float(limit.half_angle))
        across = position - np.outer(axis, axis @ position)
        return ConeRows(
            tangent * axis @ position,
            -tangent * float(axis @ apex),
            across,
            -across[:, :size] @ apex,
        )
    raise ConfigError(f"convex bounds know balls, cones and speed limits, got {limit!r}.")


class Flights:
    """Flights of a meeting as a cone program of the commands (in [0, 1]) in the periods that may push.

    Commands are in the order of periods, then of thrusters. Demands are added one after the other.

    Args:
        meeting: what is to be done.
        start: (2 d,) position (m) and velocity (m/s) in W.
        check: the last one at which anything is asked.
        spare: part of limits and tolerances that flights leave, m or m/s; 0 for bounds.
    """

    def __init__(
        self, meeting: Meeting, start: np.ndarray, check: int, spare: float = _SLACK
    ) -> None:
        self._meeting = meeting
        self._start = start
        self._check = check
        self._spare = spare
        self._periods = meeting.periods(check)
        used = np.arange(self._periods) % meeting.every == 0
        self._used = np.repeat(used, meeting.forces.shape[1])
        count = int(self._used.sum())
        unit = sparse.eye(count)
        self._rows = Rows(count)
        self._rows.keep_above_zero(unit, np.zeros(count))
        self._rows.keep_above_zero(-unit, np.ones(count))

    def be_within(self, check: int, radii: tuple[float, float] | None = None) -> None:
        """Be at the point at a check, within radii (m, m/s); None: the tolerances."""
        meeting = self._meeting
        state = np.eye(2 * len(meeting.point))
        target = self._free(check) - meeting.missed(self._start, np.array([check]))[0]
        for part, radius in zip(
            np.split(state, 2),
            radii or (meeting.position_tolerance, meeting.velocity_tolerance),
            strict=True,
        ):
            self._ask(ConeRows(0.0 * state[0], radius, part, -part @ target), check)

    def keep(self, limit: Shape, check: int, reference: np.ndarray) -> None:
        """Keep a limit at a check, whose concave part is its tangent at a reference (2 d,).

        The tangent keeps less than the limit leaves: what keeps the row at a check keeps the limit there.
        """
        self._ask(cone_rows(limit, reference), check)

    def _free(self, check: int) -> np.ndarray:
        return self._meeting.free(self._start, np.array([check]))[0]

    def _ask(self, cone: ConeRows, check: int) -> None:
        """Have the state at a check in a cone."""
        effect = self._meeting.effect(check, self._periods)[:, self._used]
        free = self._free(check)
        self._rows.keep_in_cones(
            (cone.row @ effect)[None],
            np.array([cone.row @ free + cone.constant - self._spare]),
            cone.matrix @ effect,
            cone.matrix @ free + cone.vector,
        )

    def program(self) -> ConeProgram:
        """The program of the commands with the least impulse, N s."""
        prices = np.tile(self._meeting.price, self._periods)[self._used]
        return self._rows.program(prices, np.zeros(len(prices)), np.ones(len(prices)))

    def cheapest(self) -> MeetingTransfer | None:
        """The flight of least impulse; None: it is proved that there is none.

        Its multiplier is that of the first check at which it was to be at the point.

        Raises:
            SolverFailed: Clarabel ends neither with a solution nor with a proof that there is none.
        """
        program = self.program()
        result = program.solve(f"a meeting at {self._check * self._meeting.interval:g} s")
        if result is None:
            return None
        commands = np.zeros(len(self._used))
        commands[self._used] = np.clip(np.array(result.x), 0.0, 1.0)
        impulse = float(program.cost @ commands[self._used])
        size = len(self._meeting.point)
        first = np.array(result.z)[program.inequalities :][: 2 * size + 2]
        multiplier = -first.reshape(2, -1)[:, 1:].ravel()
        return MeetingTransfer(
            self._check, commands.reshape(self._periods, -1), impulse, multiplier
        )

    def least(self) -> float:
        """Impulse below which no flight does what is asked, N s; infinite: none does."""
        return self.program().least()
