"""What became of many flights, told while they last: a few numbers each, and for all of them counts and sums.

A flight is solved if it keeps within all tolerances at every step of its last fifth, as in
`rans.evaluation.measure.metrics`. Every other one failed, in one way of `Failure`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from functools import reduce
from operator import add

import numpy as np

from rans.episode import Episode, Outcome, World
from rans.model.dynamics import thrust
from rans.model.fields import Field, finite, leaves, where


class Failure(IntEnum):
    """How a flight failed; the first of these that fits."""

    NOT_FINITE = 1
    """A number of the state became NaN or infinite; the flight ends there."""
    TERMINATED = 2
    """The task declared it failed; the flight ends there."""
    LEFT = 3
    """It was within all tolerances and left them at a step of the last fifth."""
    UNSETTLED = 4
    """It is outside at every step of the last fifth."""
    LATE = 5
    """It entered for good, but only in the last fifth."""

    @property
    def meaning(self) -> str:
        """For tables."""
        return _MEANINGS[self]


_MEANINGS = {
    Failure.NOT_FINITE: "its state became NaN or infinite",
    Failure.TERMINATED: "the task declared it failed",
    Failure.LEFT: "left the tolerances in the last fifth",
    Failure.UNSETTLED: "outside the tolerances all of the last fifth",
    Failure.LATE: "within the tolerances for good only in the last fifth",
}


@dataclass(frozen=True)
class Tally:
    """What is known so far of N flights; pure functions over fields (`rans.model.fields`)."""

    going: Field
    """Whether the task has not failed."""
    lost: Field
    """Whether its state is no longer finite."""
    inside: Field
    """Whether it is within all tolerances."""
    missed: Field
    """Whether it was not at a step of the last fifth."""
    left: Field
    """Whether it left them at a step of the last fifth."""
    settled: Field
    """Number of the first instant since which it is inside, int; the start's is 0."""
    gained: Field
    """Return."""
    impulse: Field
    """Force times time summed over thrusters, N s."""
    opened: Field
    """Open thrusters summed over the steps of the last fifth."""

    @classmethod
    def of(cls, world: World, episode: Episode) -> Tally:
        """Of flights that begin."""
        never = episode.clock < 0
        zero = episode.clock * 0.0
        inside = world.task.reached(episode.state, episode.goal) | never
        return cls(
            ~never,
            never,
            inside,
            never,
            never,
            where(inside, episode.clock * 0, 1),
            zero,
            zero,
            zero,
        )

    def after(self, world: World, outcome: Outcome) -> Tally:
        """After one more step; flights that ended are left as they were."""
        craft = world.craft
        going = self.going
        step = world.timing.step(outcome.episode.clock)
        late = step > world.timing.episode_steps - last_fifth(world.timing.episode_steps)
        lost = going & ~finite(*leaves(outcome.episode.state))
        inside = outcome.reached & going & ~outcome.terminated
        forces = [
            share * t.force
            for share, t in zip(thrust(craft, outcome.command), craft.thrusters, strict=True)
        ]
        zero = self.gained * 0.0

        def when(condition: Field, amount: Field) -> Field:
            return where(condition, amount, zero)

        return Tally(
            going=going & ~outcome.terminated,
            lost=self.lost | lost,
            inside=inside,
            missed=self.missed | (late & ~inside),
            left=self.left | (late & self.inside & ~inside),
            settled=where(inside, self.settled, step + 1),
            gained=self.gained + when(going & ~lost, outcome.reward),
            impulse=self.impulse + when(going, reduce(add, forces)) * world.timing.control_period,
            opened=self.opened + when(going & late, reduce(add, outcome.command)),
        )

    def failure(self) -> Field:
        """The number of a `Failure`, int, 0 where there is none, of flights that are over."""
        kind = where(self.missed, where(self.left, 3, where(self.inside, 5, 4)), 0)
        return where(self.lost, 1, where(self.going, kind, 2))


def last_fifth(steps: int) -> int:
    """How many steps belong to the last fifth of so many."""
    return max(1, steps // 5)


@dataclass(frozen=True)
class Sums:
    """Of one quantity over many flights."""

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
        """Of (N,) values."""
        values = values.astype(np.float64)
        return cls(float(values.sum()), float(np.square(values).sum()), len(values))

    @property
    def mean(self) -> float:
        """NaN of none."""
        return self.total / self.count if self.count else math.nan

    @property
    def error(self) -> float:
        """Standard error of the mean; NaN of fewer than two."""
        if self.count < 2:
            return math.nan
        spread = max(0.0, self.squares / self.count - self.mean**2) * self.count / (self.count - 1)
        return math.sqrt(spread / self.count)


QUANTITIES = ("return", "impulse", "duty at rest")
"""Of every flight, with failed ones as far as they came: sum of rewards; N s; mean share of thrusters open in
the last fifth."""


@dataclass(frozen=True)
class Verdicts:
    """What became of many flights; add up those of other scenarios of the same seed."""

    flights: int
    steps: int
    """Of each flight, T."""
    settled_at: np.ndarray
    """(T + 1,) int64: how many entered all tolerances for good at each instant, failed ones left out."""
    failures: dict[Failure, int]
    """How many, of every kind."""
    numbers: np.ndarray
    """(M,) int64: scenario numbers of failed flights, rising; of many only the first that were met."""
    kinds: np.ndarray
    """(M,) uint8: the `Failure` of each."""
    sums: dict[str, Sums]
    """Of the `QUANTITIES`."""
    listed: int = 100_000
    """At most so many failed flights are listed."""
    ways: frozenset[str] = field(default_factory=frozenset)
    """What computed them."""

    @property
    def failed(self) -> int:
        """Of all kinds."""
        return sum(self.failures.values())

    @property
    def settled(self) -> int:
        """How many entered all tolerances for good, however late."""
        return int(self.settled_at.sum())

    def settling_step(self, share: float = 0.5) -> float:
        """Instant by which this share of all flights is settled; infinite if so many never are."""
        reached = np.flatnonzero(np.cumsum(self.settled_at) >= share * self.flights)
        return float(reached[0]) if len(reached) and self.flights else math.inf

    def __add__(self, other: Verdicts) -> Verdicts:
        numbers, kinds = (
            np.concatenate(pair)
            for pair in ((self.numbers, other.numbers), (self.kinds, other.kinds))
        )
        first = np.argsort(numbers, kind="stable")
        listed = min(self.listed, other.listed)
        return Verdicts(
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
    def none(cls, steps: int, listed: int = 100_000) -> Verdicts:
        """Of no flight."""
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
    ) -> Verdicts:
        """Of flights (N,) that are over, with these scenario numbers.

        Their outcome is the number of a `Failure` or 0, whether they settled, and when; totals are return,
        impulse, and open thrusters summed over the last fifth.
        """
        steps = world.timing.episode_steps
        (failure, settles, settled) = outcome
        places = np.flatnonzero(failure)[:listed]
        slots = last_fifth(steps) * len(world.craft.thrusters)
        values = zip(QUANTITIES, totals, (1.0, 1.0, 1.0 / slots), strict=True)
        return cls(
            len(failure),
            steps,
            np.bincount(settled[settles], minlength=steps + 1),
            dict(zip(Failure, np.bincount(failure, minlength=6)[1:].tolist(), strict=True)),
            numbers[places].astype(np.int64),
            failure[places].astype(np.uint8),
            {name: Sums.of(x * scale) for name, x, scale in values},
            listed,
            frozenset({way}),
        )
