"""Least impulse of a final approach, from both sides: a certified bound, and a flight within the corridor.

Where the port is at every check does not depend on the flight, and nor does its corridor. The bound follows from
second-order cone programs, one for each range of arrivals, by weak duality as in `rans_missions.convex.rendezvous`.
The corridor is in it: a craft that keeps the speed limit has been near the port for a while when it arrives, and
near the port it must be inside the cone. Bounds hold whatever the solver says: tests compare them with flights of
the engine and of guidance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from rans.extend import Ball, Cone, Spacecraft, SpeedLimit, Timing, leaves, map_leaves
from rans_missions.convex.rendezvous import (
    Flights,
    Meeting,
    MeetingTransfer,
    at_checks,
    forces_in_w,
    least_over_arrivals,
    successive,
)
from rans_missions.tasks.final_approach import FinalApproach

_INSTANTS = (0.0, 0.02, 0.06, 0.12, 0.2, 0.32, 0.45, 0.6, 0.8, 1.0)
"""Instants at which a bound has the cone, as parts of the time for which a craft must have been inside of it."""
_NARROWEST = 7.0
"""Range of arrivals below which none is divided, s: a craft may be a metre from the port at its beginning."""
_COMMANDS = 60
"""Control periods with thrust of a flight within the corridor, about: more take minutes."""
_TRIED = ((1200.0, 1000.0), (2400.0, 1600.0))
"""Arrivals of flights, and times before them at which they enter the cone, s."""
_BEYOND = 0.5
"""Distance from the end of the cone before that, m."""


@dataclass(frozen=True)
class PortMeeting(Meeting):
    """Meeting with a port whose path does not depend on the flight, within its corridor."""

    path: np.ndarray = field(kw_only=True)
    """(L, 6) position, m, and velocity, m/s, of the port in W at every check."""
    away: np.ndarray = field(kw_only=True)
    """(J,) largest distance from the port, m, so many checks before the arrival; at all of them a craft is inside
    the cone."""
    hurry: np.ndarray = field(kw_only=True)
    """(J,) largest speed relative to the port then, m/s."""

    @classmethod
    def at_port(
        cls, craft: Spacecraft, task: FinalApproach, timing: Timing, goal: Any
    ) -> PortMeeting:
        """The meeting with the port of one episode.

        Raises:
            ConfigError: see `rans_missions.convex.rendezvous.forces_in_w`.
        """
        interval = timing.control_period / timing.checks
        checks = np.arange(timing.checks * timing.episode_steps + 1)
        goal = map_leaves(lambda x: float(np.squeeze(x)), goal)
        port = task.later(goal, interval * checks)
        columns = [np.broadcast_to(x, len(checks)) for x in (*leaves(port.p), *leaves(port.v))]
        path = np.stack(columns, axis=1)
        forces = forces_in_w(craft)
        most = float(np.linalg.norm(np.abs(forces).sum(axis=1))) / craft.mass
        away, hurry = before_arrival(task, goal, interval, most)
        return cls(
            task.drift,
            timing,
            forces,
            craft.mass,
            np.zeros(3),
            task.position_tolerance,
            task.velocity_tolerance,
            task.scenery(port),
            path=path,
            away=away,
            hurry=hurry,
        )

    def missed(self, start: np.ndarray, checks: np.ndarray) -> np.ndarray:
        """See `Meeting.missed`."""
        return self.free(start, checks) - self.path[checks]

    @cached_property
    def cone(self) -> Cone:
        """The cone, whose fields have a value for each check."""
        return next(x for x in self.limits if isinstance(x, Cone))

    @cached_property
    def corridor(self) -> tuple[np.ndarray, np.ndarray]:
        """Apex, m, and axis of the cone at every check, (L, 3) each."""
        apex, axis = (np.stack(leaves(x), axis=1) for x in (self.cone.apex, self.cone.axis))
        return apex, axis


def before_arrival(
    task: FinalApproach, goal: Any, interval: float, most: float
) -> tuple[np.ndarray, np.ndarray]:
    """How far from the port, m, and how fast, m/s, a craft was so many checks before its arrival, (J,) each.

    At its arrival it is within the tolerances. A check earlier it was farther away by at most the interval times
    its largest speed relative to the port between the two. That is the speed limit at the distance of the earlier
    check, the speed of the port, and what thrust and orbit change in half of the interval. J ends where the craft
    may have been outside of the cone.

    Args:
        task: the final approach.
        goal: the port at any instant, in floats.
        interval: time between two checks, s.
        most: largest acceleration by thrust along all axes at once, m/s^2.
    """
    cone = next(x for x in task.scenery(goal) if isinstance(x, Cone))
    limit = next(x for x in task.scenery(goal) if isinstance(x, SpeedLimit))
    slope = float(limit.slope)
    # At the port itself: the limit, and the port's own speed.
    base = float(limit.base) + slope * task.standoff + math.hypot(*leaves(goal.v))
    farthest = float(cone.length) - math.dist(leaves(cone.apex), leaves(goal.p))
    # Accelerations of the orbit where they are largest: 3 n^2 r and 2 n v.
    n = task.mean_motion
    pulled = 3.0 * n**2 * (farthest + task.standoff) + 2.0 * n * (base + slope * farthest)
    gained = 0.5 * interval * (most + pulled)
    away, hurry = [task.position_tolerance], [task.velocity_tolerance]
    while True:
        earlier = (away[-1] + interval * (base + gained)) / (1.0 - interval * slope)
        if earlier > farthest:
            return np.array(away), np.array(hurry)
        away.append(earlier)
        hurry.append(base + slope * earlier)


def least_to_approach(meeting: PortMeeting, start: np.ndarray) -> tuple[float, int]:
    """Impulse below which no flight docks by the end of the episode, N s, and the last check of its arrivals.

    Branch and bound over ranges of arrivals.

    Args:
        meeting: the port and its corridor.
        start: (6,) position (m) and velocity (m/s) in W.
    """
    return least_over_arrivals(
        meeting,
        start,
        len(meeting.path) - 1,
        lambda first, end: bound_of_range(meeting, start, first, end),
        _NARROWEST,
    )


def bound_of_range(meeting: PortMeeting, start: np.ndarray, first: int, end: int) -> float:
    """Impulse below which no flight docks at a check between two, N s, by weak duality (`ConeProgram.bound`).

    A flight that docks at one of them is near the port at the first of them, and inside the cone at checks before;
    infinite: nothing docks there.

    Args:
        meeting: the port and its corridor.
        start: (6,) position (m) and velocity (m/s) in W.
        first: the first arrival, in checks.
        end: the last arrival.
    """
    ahead = end - first
    inside = len(meeting.away) - 1 - ahead
    if inside < 0:
        return 0.0
    flights = Flights(meeting, start, first, spare=0.0)
    # Near the port at the first check, in balls that are as large as it was far away then.
    flights.be_within(first, (float(meeting.away[ahead]), float(meeting.hurry[ahead])))
    # Inside the cone at the first check and before.
    instants = np.unique(first - np.round(inside * np.array(_INSTANTS)).astype(int))
    for at in instants[instants > 0].tolist():
        (cone,) = at_checks((meeting.cone,))(at)
        flights.keep(cone, at, meeting.path[at])
    return max(0.0, flights.least())


def flight_to_port(meeting: PortMeeting, start: np.ndarray) -> MeetingTransfer | None:
    """The cheapest flight found that docks and keeps every limit at every check; None: none was found.

    It stays outside the cone's length until some time before its arrival, and inside the cone from then on. Some
    arrivals and entries are tried. The first round of each has its tangents at a craft on the port's axis, each
    other at the flight of the round before.

    Args:
        meeting: the port and its corridor.
        start: (6,) position (m) and velocity (m/s) in W.
    """
    last = len(meeting.path) - 1
    best: MeetingTransfer | None = None
    for arrival, inside in _TRIED:
        check = min(last, round(arrival / meeting.interval))
        entry = max(1, check - round(inside / meeting.interval))
        found = flight_entering(meeting, start, check, entry)
        if found is not None and (best is None or found.impulse < best.impulse):
            best = found
    return best


def flight_entering(
    meeting: PortMeeting, start: np.ndarray, check: int, entry: int
) -> MeetingTransfer | None:
    """The flight of `flight_to_port` that enters the cone at a check and docks at another; None: there is none.

    The start is (6,), m and m/s in W, and both checks are numbers from the start.
    """
    meeting = replace(meeting, every=-(-meeting.periods(check) // _COMMANDS))
    apex, axis = meeting.corridor
    length = float(meeting.cone.length)
    is_outside = np.arange(len(apex)) < entry
    # Before the entry a ball of the cone's length is kept out of; from it on the cone has no end.
    others = tuple(limit for limit in meeting.limits if limit is not meeting.cone)
    cone = replace(meeting.cone, length=np.where(is_outside, 0.0, np.inf))
    outside = Ball(cone.apex, cone.apex, np.where(is_outside, length + _BEYOND, 0.0))
    limits = (cone, outside, *others)
    # Along the axis: as far as at the start, then evenly to the port.
    far = max(float(np.linalg.norm(start[:3])), length + _BEYOND)
    port = float(np.linalg.norm(meeting.path[0, :3]))
    along = np.interp(np.arange(check + 1), [0, entry, check], [far, length, port])
    states = np.hstack([axis[: check + 1] * along[:, None], np.zeros((check + 1, 3))])
    return successive(meeting, start, check, limits, states)
