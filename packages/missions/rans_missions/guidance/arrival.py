"""Plans of arrivals: the arrival time with the least price, among times up to a latest one."""

from __future__ import annotations

from collections.abc import Callable

from rans.extend import Field, at_least, floor, where

PLANS = 24
"""Number of arrival times that are compared, evenly up to the latest one; refinement halves their distance."""
REFINEMENTS = 3
"""Number of times that the distance between arrival times is halved around the best one: to an eighth of it, which
is a few control periods."""
TIME_ROUNDING = 1e-3
"""Time left that counts as none, s: rounding of deadlines after many periods in single precision."""
_WHOLE_TOLERANCE = 1e-3
"""Part of a control period by which a time may be short of a whole number of them: rounding in single precision."""


def whole_periods(time: Field, period: float) -> Field:
    """A time rounded down to whole control periods, s, because commands change only there."""
    return floor(time * (1.0 / period) + _WHOLE_TOLERANCE) * period


def best_arrival(
    price: Callable[[Field], Field], latest: Field, period: float, plans: int = PLANS
) -> Field:
    """Time of the arrival with the least price, s: a whole number of control periods.

    All are fields; the order of comparisons decides recorded flights.

    Args:
        price: of an arrival after a time, s.
        latest: latest arrival, s, a whole number of control periods.
        period: control period, s.
        plans: number of times that are compared before refinement.
    """
    arrival = latest
    least = price(arrival)

    def compared(time: Field, arrival: Field, least: Field) -> tuple[Field, Field]:
        """The cheaper of a new arrival time and the best one so far, with its price."""
        whole = at_least(whole_periods(time, period), period)
        new = price(whole)
        better = new < least
        return where(better, whole, arrival), where(better, new, least)

    step = latest * (1.0 / plans)
    for k in range(1, plans):
        arrival, least = compared(latest * (1.0 - k / plans), arrival, least)
    # Between the best of them and its neighbours.
    for k in range(1, REFINEMENTS + 1):
        width = step * 0.5**k
        middle = arrival
        for time in (middle - width, middle + width):
            bounded = where(time < latest, time, latest)
            arrival, least = compared(bounded, arrival, least)
    return arrival
