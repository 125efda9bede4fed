"""Least impulse of reaching a point by a deadline and staying there, by conic programs: its bound, and a flight.

A flight that arrives at any check between two, and stays for a time, is within the tolerances at all checks from
the later of the two to the earlier one plus that time. The flight of least impulse that is so at some of these
checks follows from a second-order cone program, whose multipliers bound the impulse of all flights by weak duality
(`rans_missions.convex.cone_program`). The bound is computed from them: it holds for any multipliers.

A flight drifts through the tolerances for most of the stay: its program keeps them at every check of the stay, and
limits that are not convex by their tangents at the flight before. `rans_missions.bounds` prints its bounds and
`ConvexGuidance` flies its flights.
"""

from __future__ import annotations

import numpy as np

from rans_missions.convex.rendezvous import (
    Flights,
    Meeting,
    MeetingTransfer,
    cheapest_within_limits,
    least_impulse,
    least_over_arrivals,
    least_to_meet,
)
from rans_missions.tasks.orbital import last_check

_SPACING = 30.0
"""Time between two checks of the stay at which a program keeps the tolerances, s: at hold's speed tolerance a craft
moves by less than a third of its position tolerance between them. Fewer checks make the bound lower, not wrong."""
_NARROWEST = 60.0
"""Range of arrivals below which none is divided, s: that of 15 s raises hold's bound by 0.1 % more."""

_ARRIVALS = (1.0, 0.95, 0.9, 0.8, 0.7, 0.6)
"""Parts of the time until the deadline at which arrivals are compared. Most starts are cheapest at the deadline."""


def flight_that_holds(
    meeting: Meeting, start: np.ndarray, deadline: float, seconds: float
) -> MeetingTransfer | None:
    """A flight that arrives by a deadline, stays within the tolerances, and keeps every limit at every check.

    It is the cheapest that the rounds find from some arrivals, and the end of its stay is its meeting. None: no
    arrival had one.

    Args:
        meeting: the point, its tolerances, and the limits.
        start: (2 d,) position (m) and velocity (m/s) in W.
        deadline: of the arrival, s.
        seconds: for which the craft stays, s.

    Raises:
        SolverFailed: Clarabel ends neither with a solution nor with a proof that there is none.
    """
    interval = meeting.interval
    stay = last_check(seconds, interval)
    longest = meeting.timing.checks * meeting.timing.episode_steps
    last = min(last_check(deadline, interval), longest - stay)
    arrivals = sorted({max(1, round(part * last)) for part in _ARRIVALS}) if last > 0 else []
    # Without the limits first.
    free = [(least_impulse(meeting, start, first + stay, first=first), first) for first in arrivals]
    begun = [(one, first) for one, first in free if one is not None]
    return cheapest_within_limits(meeting, start, begun)


def least_of_mission(meeting: Meeting, start: np.ndarray, deadline: float, seconds: float) -> float:
    """Impulse below which no flight meets by a deadline (s), and stays for so many seconds if it is to, N s."""
    if seconds:
        return least_to_hold(meeting, start, deadline, seconds)
    return least_to_meet(meeting, start, deadline)[0]


def least_to_hold(meeting: Meeting, start: np.ndarray, deadline: float, seconds: float) -> float:
    """Impulse below which no flight arrives by a deadline and stays within the tolerances, N s.

    Branch and bound over ranges of arrivals. Limits such as a keep-out ball are left out.

    Args:
        meeting: the point and its tolerances.
        start: (2 d,) position (m) and velocity (m/s) in W.
        deadline: of the arrival, s.
        seconds: for which the craft stays, s.
    """
    interval = meeting.interval
    last = min(last_check(deadline, interval), meeting.timing.checks * meeting.timing.episode_steps)
    stay = last_check(seconds, interval)

    def bound_of(first: int, end: int) -> float:
        over = first + stay
        if over < end:  # stays from both arrivals have no check in common
            return 0.0
        flights = Flights(meeting, start, over, spare=0.0)
        for check in np.unique(
            np.linspace(end, over, 2 + int((over - end) * interval / _SPACING)).astype(int)
        ):
            flights.be_within(int(check))
        return flights.least()

    return least_over_arrivals(meeting, start, last, bound_of, _NARROWEST)[0]
