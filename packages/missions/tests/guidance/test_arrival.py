"""Plans of arrivals: the least of a price, at whole control periods."""

import numpy as np
from rans_missions.guidance.arrival import best_arrival, whole_periods


def test_times_are_rounded_down_to_whole_periods():
    """A time that rounding has left a thousandth of a period short is whole."""
    times = whole_periods(np.array([39.9999, 39.9, 40.0, 49.0]), 10.0)
    assert times.tolist() == [40.0, 30.0, 40.0, 40.0]


def test_the_arrival_is_the_least_of_a_parabola():
    """The best of 24 times in 2,400 s, and three halvings, leave 12.5 s; at whole periods of 10 s another 10 s."""
    best = np.array([105.0, 777.0, 1530.0, 2400.0, 9000.0])
    found = best_arrival(lambda time: (time - best) ** 2, np.full(5, 2400.0), 10.0)
    assert np.all(np.abs(found - np.minimum(best, 2400.0)) < 22.5)
    assert np.all(found % 10.0 == 0.0)


def test_of_two_least_prices_the_later_arrival_is_taken():
    """A price that is the same everywhere leaves the latest arrival, with the most time."""
    assert best_arrival(lambda time: time * 0.0, np.array([600.0]), 10.0).tolist() == [600.0]
