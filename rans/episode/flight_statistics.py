"""Counts and sums over very many flights, whose trajectories are not stored."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from rans.episode.step import World
from rans.episode.verdict import Failure, last_fifth


@dataclass(frozen=True)
class Sums:
    """Number, sum and sum of squares of one quantity over many flights."""

    total: float = 0.0
    squares: float = 0.0
    """Sum of the squares."""
    count: int = 0

    def __add__(self, other: Sums) -> Sums:
        return Sums(
            self.total + other.total, self.squares + other.squares, self.count + other.count
        )

    @classmethod
    def of(cls, values: np.ndarray) -> Sums:
        """Sums of values (N,)."""
        values = values.astype(np.float64)
        return cls(float(values.sum()), float(np.square(values).sum()), len(values))

    @property
    def mean(self) -> float:
        """Mean; NaN without flights."""
        return self.total / self.count if self.count else math.nan

    @property
    def error(self) -> float:
        """Standard error of the mean; NaN for fewer than two flights."""
        if self.count < 2:
            return math.nan
        spread = max(0.0, self.squares / self.count - self.mean**2) * self.count / (self.count - 1)
        return math.sqrt(spread / self.count)


QUANTITIES = ("return", "impulse", "duty at rest")
"""Quantities that are summed: return; impulse, N s; mean share of open thrusters in the last fifth. Those of failed
flights end at their failure."""


@dataclass(frozen=True)
class FlightStatistics:
    """Counts of solved and failed flights with times and kinds; those of different scenarios can be added."""

    flights: int
    steps: int
    """Steps of each flight, T."""
    settled_at: np.ndarray
    """Number of solved flights that settled at each instant (`rans.episode.verdict`), (T + 1,) int64."""
    failures: dict[Failure, int]
    """Number of flights that did not solve their task, by the kind of failure."""
    numbers: np.ndarray
    """Scenario numbers of the first unsolved flights, ascending, at most ``listed``, (M,) int64."""
    kinds: np.ndarray
    """`Failure` of each listed flight, (M,) uint8."""
    sums: dict[str, Sums]
    """Sums of the `QUANTITIES`."""
    listed: int = 100_000
    """Largest number of unsolved flights that are listed."""
    ways: frozenset[str] = field(default_factory=frozenset)
    """Devices and precisions that computed the flights, such as "CPU, float32"."""

    @property
    def unsolved(self) -> int:
        """Number of flights that did not solve their task, of all kinds."""
        return sum(self.failures.values())

    def settling_step(self, fraction: float = 0.5) -> float:
        """Instant by which a share of all flights has settled; infinite if fewer settle."""
        reached = np.flatnonzero(np.cumsum(self.settled_at) >= fraction * self.flights)
        return float(reached[0]) if len(reached) and self.flights else math.inf

    def __add__(self, other: FlightStatistics) -> FlightStatistics:
        """Statistics of both, as of one batch in any order: lists are sorted by number and cut at the shorter."""
        numbers, kinds = (
            np.concatenate(pair)
            for pair in ((self.numbers, other.numbers), (self.kinds, other.kinds))
        )
        first = np.argsort(numbers, kind="stable")
        listed = min(self.listed, other.listed)
        return FlightStatistics(
            self.flights + other.flights,
            self.steps,
            self.settled_at + other.settled_at,
            {kind: self.failures[kind] + other.failures[kind] for kind in Failure},
            numbers[first][:listed],
            kinds[first][:listed],
            {name: self.sums[name] + other.sums[name] for name in QUANTITIES},
            listed,
            self.ways | other.ways,
        )

    @classmethod
    def none(cls, steps: int, listed: int = 100_000) -> FlightStatistics:
        """Statistics of no flight, to which those of parts are added; lists at most ``listed`` failures."""
        return cls(
            0,
            steps,
            np.zeros(steps + 1, np.int64),
            dict.fromkeys(Failure, 0),
            np.zeros(0, np.int64),
            np.zeros(0, np.uint8),
            dict.fromkeys(QUANTITIES, Sums()),
            listed,
        )

    @classmethod
    def of(
        cls,
        world: World,
        numbers: np.ndarray,
        outcome: Sequence[np.ndarray],
        totals: Sequence[np.ndarray],
        listed: int,
        way: str,
    ) -> FlightStatistics:
        """Statistics of N flights that have ended.

        Args:
            world: setup of the flights.
            numbers: numbers of the scenarios, (N,).
            outcome: number of a `Failure` or 0, and of the instant at which a solved flight settled; (N,) each.
            totals: return, impulse, and open thrusters summed over the last fifth; (N,) each.
            listed: largest number of unsolved flights that are listed.
            way: device and precision that computed the flights.
        """
        steps = world.timing.episode_steps
        failure, settled = outcome
        failed = np.flatnonzero(failure)[:listed]
        values = zip(QUANTITIES, totals, _scales(world), strict=True)
        counts = np.bincount(failure, minlength=len(Failure) + 1)[1:].tolist()
        return cls(
            len(failure),
            steps,
            np.bincount(settled[failure == 0], minlength=steps + 1),
            dict(zip(Failure, counts, strict=True)),
            numbers[failed].astype(np.int64),
            failure[failed].astype(np.uint8),
            {name: Sums.of(x * scale) for name, x, scale in values},
            listed,
            frozenset({way}),
        )

    @classmethod
    def summed(
        cls,
        world: World,
        flights: int,
        ended: np.ndarray,
        numbers: np.ndarray,
        kinds: np.ndarray,
        totals: np.ndarray,
        listed: int,
        way: str,
    ) -> FlightStatistics:
        """Statistics of flights that were counted and summed where they flew.

        Args:
            world: setup of the flights.
            flights: number of flights.
            ended: number of flights by kind of failure, then of solved ones by the instant at which they settled.
            numbers: scenario numbers of the listed unsolved flights, ascending, (M,).
            kinds: their kinds of failure, (M,) uint8.
            totals: sums and sums of squares (3, 2) of return, impulse, and open thrusters in the last fifth.
            listed: largest number of unsolved flights that are listed.
            way: device and precision that computed the flights.
        """
        kinds_of_failure = len(Failure)
        values = zip(QUANTITIES, totals.tolist(), _scales(world), strict=True)
        return cls(
            flights,
            world.timing.episode_steps,
            ended[kinds_of_failure:],
            dict(zip(Failure, ended[:kinds_of_failure].tolist(), strict=True)),
            numbers.astype(np.int64),
            kinds,
            {
                name: Sums(total * scale, squares * scale**2, flights)
                for name, (total, squares), scale in values
            },
            listed,
            frozenset({way}),
        )


def _scales(world: World) -> tuple[float, float, float]:
    """Factors of the totals: over the slots of the last fifth of an episode, open thrusters are a duty cycle."""
    slots = last_fifth(world.timing.episode_steps) * world.craft.thruster_count
    return 1.0, 1.0, 1.0 / slots
