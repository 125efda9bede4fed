"""Very many flights of any controller, one for each scenario, of which only statistics are kept."""

from __future__ import annotations

from collections.abc import Generator

import numpy as np

from rans.extend import (
    Controller,
    Draws,
    Flight,
    FlightStatistics,
    Setup,
    Workers,
    World,
    fly_draws,
    last_fifth,
    seed_words,
)

_SHARE = 1024
_SLOW_SHARE = 16
"""Number of flights that a process flies at once of a slow controller."""
_MANY = 8192
"""Number of flights from which they are shared with other processes."""


class ControllerFleet:
    """Flies a controller through the scenarios of a seed in float64, as `rans.fast.flights.Flights` does a network.

    Args:
        controller: controller, which can be pickled.
        setup: spacecraft, task with its starts, and timing.
        listed: largest number of failed flights whose numbers are kept.
    """

    def __init__(self, controller: Controller, setup: Setup, listed: int) -> None:
        self._controller = controller
        self._setup = setup
        self._listed = listed

    def parts(self, first: int, count: int, seed: int) -> Generator[FlightStatistics]:
        """Statistics of consecutive scenarios, part by part in the order of their numbers.

        Raises:
            ConfigError: the controller failed, or the seed has more than 64 bits.
        """
        slow = getattr(self._controller, "slow", False)
        size = _SLOW_SHARE if slow else _SHARE
        jobs = [
            (seed, begin, min(size, first + count - begin))
            for begin in range(first, first + count, size)
        ]
        workers = 1 if count < _MANY and not slow else None
        arguments = self._controller, self._setup, self._listed
        yield from Workers(ControllerFleet, arguments, workers, "flew").ordered(
            ControllerFleet.part, jobs
        )

    def part(self, seed: int, first: int, count: int) -> FlightStatistics:
        """Statistics of `count` scenarios from `first` on, flown in this process in float64 by NumPy.

        Parts add up to a whole.
        """
        numbers = np.arange(first, first + count, dtype=np.int32)
        own = Draws(*seed_words(seed), numbers, 0, np.float64)
        with np.errstate(all="ignore"):  # a state that is no longer finite counts as failed
            flight = fly_draws(self._controller, self._setup, own)
        return FlightStatistics.of(
            World(self._setup),
            numbers,
            _outcome(flight),
            _totals(flight),
            self._listed,
            "stepping, NumPy, float64",
        )


def _outcome(flight: Flight) -> list[np.ndarray]:
    """(N,) each: number of a `Failure` or 0, and of the instant at which a solved flight settled."""
    verdict = flight.verdict
    return [np.asarray(x) for x in (verdict.failure(), verdict.settled)]


def _totals(flight: Flight) -> list[np.ndarray]:
    """(N,) each: return, impulse (N s), and open thrusters summed over the last fifth."""
    steps = len(flight.commands)
    forces = np.array([thruster.force for thruster in flight.craft.thrusters])
    earned = np.sum([term.sum(axis=0) for term in flight.rewards().values()], axis=0)
    impulse = flight.timing.control_period * (flight.openings @ forces).sum(axis=0)
    late = flight.openings[-last_fifth(steps) :]
    return [earned, impulse, late.sum(axis=(0, 2))]
