"""Probabilities of events too rare to be counted: subset simulation by independent groups of flights.

The probability of a rare event is the product of conditional ones that are not rare: that of reaching a first level
of a score, of a second one given the first, and so on to the event. Flights beyond a level are made from those that
reached it, by Markov chains that keep the nominal distribution and refuse what falls below (S.-K. Au and J. L.
Beck, Probabilistic Engineering Mechanics 16(4), 2001). No form of the set of failures is assumed, so that several
independent causes are followed at once. Sixteen groups never exchange flights. That they agree is what the
interval stands on, and where they do not there is none.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import t as student

from rans.errors import ConfigError
from rans.model.random import generator
from rans_assurance.assure.bounds import lower, upper

Score = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Function of standard normal numbers (D, N) and episode numbers (N,) int32; from 1 on an event happens, (N,)."""

GROUPS = 16
"""Independent groups of flights: with fewer, Student's distribution makes intervals much longer."""
_BEST = 0.1
"""Part of the flights, with the highest scores, that sets the next level (Au and Beck's)."""
FEWEST = 100 * GROUPS
"""With fewer flights, a group has less than ten to continue from, and often dies out."""
_LEVELS = 40
"""Levels at most; a probability of 1e-12 needs twelve."""
_COUNTABLE = 20
"""Events among the flights as drawn from which on they are counted: to half of the number at 99 %."""
_SAME_NOISE = 0.5
"""Probability that a new flight keeps the noise of its sensors, which follows from its number."""
_ACCEPTED = 0.44
"""Part of the steps of a chain that its length is chosen for (I. Papaioannou and others, Probabilistic
Engineering Mechanics 41, 2015)."""
_LARGEST = 0.4
"""Part of the sum that one group may have. Groups that followed the same causes stay below it, but for one in a
hundred; one that alone met a frequent cause does not."""
_LEVEL = 0.005
"""Probability of being wrong on either side of an interval at 99 %."""


@dataclass(frozen=True)
class Rare:
    """Result of subset simulation."""

    groups: tuple[float, ...]
    """Probability of the event by each of the independent groups; 0 where a group never met it."""
    events: int
    """Events among the last flights of all groups."""
    flights: int
    """All flights."""
    nominal: int
    """Flights as drawn, the first ones."""
    counted: int
    """Events among these."""

    @property
    def is_counted(self) -> bool:
        """Whether the event is frequent enough to be counted, so that groups had nothing to do."""
        return self.counted >= _COUNTABLE

    @property
    def differ(self) -> bool:
        """Whether the groups met different events: some none, or one far more than all others."""
        return min(self.groups) == 0.0 or max(self.groups) > _LARGEST * sum(self.groups)

    @property
    def probability(self) -> float:
        """Estimate; it has no bias, whether the groups agree or not."""
        return float(np.mean(self.groups))

    @property
    def error(self) -> float:
        """Standard error: of the count, or from the differences between groups."""
        if self.is_counted:
            return math.sqrt(self.probability * (1.0 - self.probability) / self.nominal)
        return float(np.std(self.groups, ddof=1) / math.sqrt(len(self.groups)))

    @property
    def interval(self) -> tuple[float, float] | None:
        """Interval at 99 %; None where no event was met, or the groups differ.

        Of events that can be counted it is Clopper and Pearson's. Otherwise the logarithms of the groups'
        estimates are taken as normal, with Cox's interval of their mean (U. Olsson, Journal of Statistics Education
        13(1), 2005), and it is widened to meet what counting the first flights proves. Causes to which no rising
        score leads are in neither.
        """
        low = lower(self.counted, self.nominal, _LEVEL)
        high = upper(self.counted, self.nominal, _LEVEL)
        if self.is_counted:
            return low, high
        if self.differ:
            return None
        logs = np.log(self.groups)
        count = len(logs)
        variance = float(logs.var(ddof=1))
        middle = float(logs.mean()) + 0.5 * variance
        spread = math.sqrt(variance / count + variance**2 / (2.0 * (count - 1)))
        half = float(student.isf(_LEVEL, count - 1)) * spread
        return min(high, math.exp(middle - half)), max(low, min(1.0, math.exp(middle + half)))

    @property
    def summary(self) -> str:
        """Estimate in one sentence."""
        if self.interval is not None:
            low, high = self.interval
            return (
                f"the probability of failure is {self.probability:.3g} ({low:.3g} to {high:.3g}), with a "
                f"gain of {self.gain:.3g} over counting"
            )
        met = sum(p > 0.0 for p in self.groups)
        if not met:
            return (
                f"no failure was met in {self.flights:,} flights that went where errors are larger, so "
                "there is no estimate"
            )
        if met < len(self.groups):
            return (
                f"only {met} of {len(self.groups)} independent groups of flights met a failure, so there is "
                "no estimate; more flights may make them agree"
            )
        return (
            f"independent groups of flights differ ({min(self.groups):.3g} to {max(self.groups):.3g}), as "
            "where there are several causes and few flights, so there is no estimate; more flights may make "
            "them agree"
        )

    def to_json(self) -> dict[str, Any]:
        """Data for `rans.files.write_json`."""
        return asdict(self) | {
            "probability": self.probability,
            "error": self.error,
            "99 %": self.interval,
            "gain": self.gain,
        }

    @property
    def gain(self) -> float:
        """Flights that counting needs for the same error, over those of all groups; NaN without an event."""
        if not self.error:
            return math.nan
        return self.probability * (1.0 - self.probability) / (self.error**2 * self.flights)


class _Flights(NamedTuple):
    """Flights of all groups, G x N."""

    z: np.ndarray
    """(D, G, N)."""
    number: np.ndarray
    """(G, N) int32."""
    score: np.ndarray
    """(G, N)."""

    def chosen(self, index: np.ndarray) -> _Flights:
        """The flights that an index (G, M) selects in each group."""
        return _Flights(
            np.take_along_axis(self.z, index[None], axis=2),
            np.take_along_axis(self.number, index, axis=1),
            np.take_along_axis(self.score, index, axis=1),
        )


def check_rare_count(name: str, count: int) -> None:
    """Raise a `ConfigError` that names a number of flights which is too small for `rare`."""
    if count < FEWEST:
        raise ConfigError(
            f"{name} must be at least {FEWEST:,}, {FEWEST // GROUPS} flights for each of {GROUPS} independent "
            f"groups, got {count:,}."
        )


def rare(score: Score, dimensions: int, count: int, seed: int) -> Rare:
    """Probability of an event, by flights of which ``count`` are as drawn, and nine tenths of that a level.

    A probability of 1e-3 takes about 3 times ``count`` flights, 1e-6 about 6 times.

    Args:
        score: of flights.
        dimensions: D of the score.
        count: of flights as drawn; rounded down to equal groups.
        seed: of all random numbers.

    Raises:
        ConfigError: ``count`` is below `FEWEST`.
    """
    check_rare_count("count", count)
    random = generator(seed)
    best = int(_BEST * count / GROUPS)
    length = round(1.0 / _BEST)
    shape = (GROUPS, best * length)
    z = random.standard_normal((dimensions, *shape))
    flights = _scored(score, z, episode_numbers(random, math.prod(shape)).reshape(shape))
    counted = int((flights.score >= 1.0).sum())
    flown = nominal = math.prod(shape)
    groups = np.ones(GROUPS)
    level = -math.inf
    step = 0.6
    for _ in range(_LEVELS):
        # One level for all groups, from those that have not died out: of levels that a group sets for itself the
        # product of its parts is biased.
        alive = groups > 0.0
        scores = np.sort(flights.score[alive], axis=None)
        next_level = min(1.0, float(scores[-best * int(alive.sum())]))
        if counted >= _COUNTABLE:
            next_level = 1.0
        if next_level <= level:
            # More than a tenth have the same score, and none to follow.
            groups[:] = 0.0
            break
        level = next_level
        beyond = flights.score >= level
        groups *= beyond.mean(axis=1)
        if level >= 1.0 or not groups.any():
            break
        flights, step = _continued(score, flights, beyond, level, (best, length), step, random)
        flown += (length - 1) * GROUPS * best
    events = int((flights.score >= 1.0)[groups > 0.0].sum())
    return Rare(tuple(groups.tolist()), events, flown, nominal, counted)


def _continued(
    score: Score,
    flights: _Flights,
    beyond: np.ndarray,
    level: float,
    size: tuple[int, int],
    step: float,
    random: np.random.Generator,
) -> tuple[_Flights, float]:
    """Flights beyond a level, by chains from those that reached it; and the length of the chains' steps.

    Args:
        score: of flights.
        flights: of all groups.
        beyond: (G, N) which of them reached the level.
        level: of the score.
        size: chains of a group, and flights of a chain.
        step: length to begin with, from 0 (stay) to 1 (draw anew).
        random: numbers.
    """
    chains, length = size
    # Each flight that reached the level starts as many chains on average; a group without any stays as it is.
    rank = beyond.cumsum(axis=1)
    total = np.maximum(rank[:, -1:], 1)
    ranks = (np.arange(chains) + random.random((GROUPS, chains))) / chains * total
    starts = np.stack(
        [np.searchsorted(*row, side="right") for row in zip(rank, ranks, strict=True)]
    )
    now = flights.chosen(np.minimum(starts, beyond.shape[1] - 1))
    alive = beyond.any(axis=1)
    states = [now]
    for turn in range(1, length):
        # This keeps the normal distribution, as z and the new numbers are independent and normal.
        z = math.sqrt(1.0 - step**2) * now.z + step * random.standard_normal(now.z.shape)
        fresh = episode_numbers(random, now.number.size).reshape(now.number.shape)
        number = np.where(random.random(fresh.shape) < _SAME_NOISE, now.number, fresh)
        new = _scored(score, z, number)
        accepted = new.score >= level
        now = _Flights(
            np.where(accepted, new.z, now.z),
            np.where(accepted, new.number, now.number),
            np.where(accepted, new.score, now.score),
        )
        states.append(now)
        rate = float(accepted[alive].mean())
        step = min(1.0, max(0.05, step * math.exp((rate - _ACCEPTED) / math.sqrt(turn))))
    joined = (np.concatenate(part, axis=-1) for part in zip(*states, strict=True))
    return _Flights(*joined), step


def _scored(score: Score, z: np.ndarray, number: np.ndarray) -> _Flights:
    scores = score(z.reshape(len(z), -1), number.ravel())
    return _Flights(z, number, np.asarray(scores).reshape(number.shape))


def episode_numbers(random: np.random.Generator, count: int) -> np.ndarray:
    """Numbers of episodes that no campaign flies, (N,) int32."""
    return random.integers(2**31, size=count, dtype=np.int32)
