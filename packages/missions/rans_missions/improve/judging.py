"""The cheapest flights of a search, and what a flight is worth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rans.evaluation.measure.metrics import impulses, won
from rans.extend import Flight

COPIES = 256
"""Changed copies of the flights of each start in a round: a step of one flight takes as long as that of some
hundred."""


@dataclass
class Best:
    """The cheapest flights that solve their task, from each start."""

    commands: np.ndarray
    """(T, N, thrusters), 0 or 1."""
    cost: np.ndarray
    """(N,) N s; infinite: there is none."""
    flown: int = 0
    """Flights that were judged."""
    rounds: int = 0
    """Rounds of the search."""

    @staticmethod
    def coasts(steps: int, count: int, thrusters: int) -> Best:
        """Before any flight solves its task."""
        return Best(np.zeros((steps, count, thrusters)), np.full(count, np.inf))

    def take(
        self, start: int, commands: np.ndarray, cost: float, flight: Flight, number: int
    ) -> None:
        """Take a cheaper flight from a start, (T, thrusters), which is one of those that were flown.

        `commands` and `cost` are changed in place; whether it is cheaper is the caller's to ask.
        """
        steps = len(commands) if flight.lengths is None else int(flight.lengths[number])
        self.commands[:, start] = 0.0
        self.commands[:steps, start] = commands[:steps]
        self.cost[start] = cost


def judged(flight: Flight) -> np.ndarray:
    """Impulse of each flight, (N,) N s; infinite where it does not solve its task, by the engine's own checks."""
    return np.where(won(flight) & ~flight.failed(), impulses(flight), np.inf)
