"""Least impulse of reaching a point by a deadline and staying there, by conic programs: its bound, and a flight.

A flight that arrives at any check between two, and stays for a time, is within the tolerances at all checks from
the later of the two to the earlier one plus that time. The flight of least impulse that is so at some of these
checks follows from a second-order cone program, whose multipliers bound the impulse of all flights by weak duality
(`rans_missions.convex.demands`). The bound is computed from them: it holds for any multipliers.

A flight drifts through the tolerances for most of the stay: its program keeps them at every check of the stay, and
limits that are not convex by their tangents at the flight before. `rans_missions.bounds` prints its bounds and
`ConvexGuidance` flies its flights.
"""

from __future__ import annotations

import math

import numpy as np

from rans_missions.convex.rendezvous import (
    Meeting,
    MeetingTransfer,
    instant_bounds,
    least_impulse,
    ranges_of_arrivals,
    within_limits,
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
    # Without the limits first: arrivals in the order of what they cost.
    free = [(least_impulse(meeting, start, first + stay, first=first), first) for first in arrivals]
    order = sorted((one.impulse, first, one) for one, first in free if one is not None)
    best: MeetingTransfer | None = None
    for cost, first, one in order:
        if best is not None and cost >= best.impulse:
            break
        found = within_limits(meeting, start, one, first)
        if found is not None and (best is None or found.impulse < best.impulse):
            best = found
    return best


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
    instants = instant_bounds(meeting, start, last)
    ranges = ranges_of_arrivals(last, interval)
    # Lower bound, whether a program has made it, and the first and last check of the arrival.
    open_ranges = [(float(instants[a : b + 1].min()), False, a, b) for a, b in ranges]
    while True:
        lowest = min(open_ranges)
        bound, is_sharp, first, end = lowest
        narrow = (end - first) * interval < _NARROWEST
        if not np.isfinite(bound) or (is_sharp and narrow):
            return bound
        open_ranges.remove(lowest)
        if is_sharp:
            middle = (first + end) // 2
            halves = (first, middle), (middle + 1, end)
        else:
            halves = ((first, end),)
        for a, b in halves:
            before = max(bound, float(instants[a : b + 1].min()))
            sharp = _of_range(meeting, start, a, b, stay)
            open_ranges.append((max(before, sharp), True, a, b))


def _of_range(meeting: Meeting, start: np.ndarray, first: int, end: int, stay: int) -> float:
    """Bound of flights that arrive at a check between these two and stay for so many checks, N s."""
    over = max(end, first + stay)
    count = 2 + int((over - end) * meeting.interval / _SPACING)
    checks = np.unique(np.linspace(end, over, count).astype(int))
    demands = meeting.demands(start, checks)
    multipliers = demands.multipliers(limited=True)
    return math.inf if multipliers is None else demands.bound(multipliers)
