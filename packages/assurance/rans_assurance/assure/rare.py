"""Probabilities of events too rare to be counted: subset simulation by independent groups of flights.

The probability of a rare event is the product of conditional ones that are not rare: that of reaching a first
level, of a second one given the first, and so on to the event. Flights beyond a level are made from those that
reached it, by Markov chains that keep the nominal distribution and refuse what falls below (S.-K. Au and J. L.
Beck, Probabilistic Engineering Mechanics 16(4), 2001).

What a level is of decides which causes are followed: a cause whose margin falls late is outlived, at the middle
levels, by a rarer one whose margin falls early, and all groups then agree on the rarer one. Levels are therefore of
the factor by which all errors of a flight would have to grow until it fails. It asks only whether flights fail, so
that no cause is earlier or later than another by how its margin falls.

Sixteen groups never exchange flights. Where they differ there is no estimate, nor where another way to failures, by
the largest error alone or by the margin, meets more. Groups that agree prove nothing: failures that need two or
more large errors at once, beside failures by many small ones, are missed by all of them. An
interval is therefore given of counted events alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

import numpy as np

from rans.extend import ConfigError
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
"""Part of the sum that one group may have; one that alone met a frequent cause has more."""
_FACTOR = 1.25
"""Between two factors at which it is asked whether a flight fails; failures within a narrower range are missed."""
_FACTORS = 10
"""Such steps: up to 9.3 times the errors as drawn. A tenth of the flights has a normal number above 1.28."""
_HALVINGS = 5
"""Of the step at which a flight begins to fail: to 0.7 %, in which a probability of 1e-6 changes by a fifth at most
for one cause."""
_MORE = 3.0
"""Standard errors by which another way must meet more failures to leave no estimate: by chance 1 in 700."""
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
    otherwise: tuple[tuple[float, ...], ...] = ()
    """Probability by each group, of every other way to failures."""

    @property
    def is_counted(self) -> bool:
        """Whether the event is frequent enough to be counted, so that groups had nothing to do."""
        return self.counted >= _COUNTABLE

    @property
    def differ(self) -> bool:
        """Whether the groups met different events: some none, or one far more than all others."""
        return min(self.groups) == 0.0 or max(self.groups) > _LARGEST * sum(self.groups)

    @property
    def missed(self) -> bool:
        """Whether another way to failures met more of them than the groups."""
        return any(
            np.mean(other) - np.mean(self.groups)
            > _MORE * math.hypot(_error(self.groups), _error(other))
            for other in self.otherwise
        )

    @property
    def probability(self) -> float:
        """Estimate; it has no bias, whether the groups agree or not."""
        return float(np.mean(self.groups))

    @property
    def error(self) -> float:
        """Standard error: of the count, or from the differences between groups."""
        if self.is_counted:
            return math.sqrt(self.probability * (1.0 - self.probability) / self.nominal)
        return _error(self.groups)

    @property
    def interval(self) -> tuple[float, float] | None:
        """Interval at 99 % of events that are counted, by Clopper and Pearson; None of others."""
        if not self.is_counted:
            return None
        low = lower(self.counted, self.nominal, _LEVEL)
        return low, upper(self.counted, self.nominal, _LEVEL)

    @property
    def is_estimated(self) -> bool:
        """Whether there is an estimate: counted, or of groups that agree and that no other way contradicts."""
        return self.is_counted or not (self.differ or self.missed)

    @property
    def summary(self) -> str:
        """Estimate in one sentence, which the page and the terminal print; without one it says why."""
        if self.is_estimated:
            within = (
                "{:.3g} to {:.3g} at 99 %".format(*self.interval)
                if self.interval is not None
                else f"{min(self.groups):.3g} to {max(self.groups):.3g} by independent groups, which is no bound"
            )
            return (
                f"the probability of failure is {self.probability:.3g} ({within}), with a gain of {self.gain:.3g} "
                "over counting"
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
        if self.missed and not self.differ:
            more = max(float(np.mean(other)) for other in self.otherwise)
            return (
                f"larger errors lead to failures of a probability of {self.probability:.3g}, and another way to "
                f"{more:.3g}, as where kinds of failure differ in pace, so there is no estimate"
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
    """Probability of an event, by flights of which ``count`` are as drawn.

    Three ways are followed one after the other: all errors grow, the largest grows, and the score. A probability of
    1e-6 takes about 85 times ``count`` flights: a level of the first two has nine tenths of ``count`` flights, each
    with several factors on its errors.

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
    length = round(1.0 / _BEST)
    size = int(_BEST * count / GROUPS), length
    shape = (GROUPS, math.prod(size))
    z = random.standard_normal((dimensions, *shape))
    number = episode_numbers(random, math.prod(shape)).reshape(shape)
    by_score = _ByScore(score)
    drawn = _scored(by_score, z, number, -math.inf)
    happened = drawn.score >= 1.0
    counted = int(happened.sum())
    if counted >= _COUNTABLE:
        counts = tuple(happened.mean(axis=1).tolist())
        return Rare(counts, counted, happened.size, happened.size, counted)
    by_all = _ByErrors(score, _all_larger)
    by_largest = _ByErrors(score, _largest_larger)
    groups, events = _followed(by_all, _scored(by_all, z, number, -math.inf), size, random)
    otherwise = (
        _followed(by_largest, _scored(by_largest, z, number, -math.inf), size, random)[0],
        _followed(by_score, drawn, size, random)[0],
    )
    flown = sum(way.flown for way in (by_score, by_all, by_largest))
    return Rare(groups, events, flown, happened.size, counted, otherwise)


class _ByScore:
    """Levels of a score as it is; counts its flights."""

    def __init__(self, score: Score) -> None:
        self._score = score
        self.flown = 0

    def __call__(self, z: np.ndarray, number: np.ndarray, level: float) -> np.ndarray:
        """(N,) scores of normal numbers (D, N) and episodes (N,); `level` is not used."""
        del level
        self.flown += len(number)
        return np.asarray(self._score(z, number))


Larger = Callable[[np.ndarray, Any], np.ndarray]
"""Function of normal numbers (D, N) and a factor, a number or (N,): the numbers with larger errors, (D, N)."""


def _all_larger(z: np.ndarray, factor: Any) -> np.ndarray:
    return factor * z


def _largest_larger(z: np.ndarray, factor: Any) -> np.ndarray:
    sizes = np.abs(z)
    return np.where(sizes == sizes.max(axis=0), factor * z, z)


class _ByErrors:
    """Levels of one over the least factor on a flight's errors with which it fails; counts its flights.

    The factor is 1 where the flight fails as it is, and infinite where it fails with none of those that are tried.
    """

    def __init__(self, score: Score, larger: Larger) -> None:
        self._score = score
        self._larger = larger
        self.flown = 0

    def _fails(self, z: np.ndarray, number: np.ndarray, power: Any) -> np.ndarray:
        """Whether flights fail with a power of `_FACTOR` on their errors, (N,)."""
        self.flown += len(number)
        if not len(number):
            return np.zeros(0, dtype=bool)
        return np.asarray(self._score(self._larger(z, _FACTOR**power), number)) >= 1.0

    def __call__(self, z: np.ndarray, number: np.ndarray, level: float) -> np.ndarray:
        """(N,) scores of normal numbers (D, N) and episodes (N,); 0 for some that are below a level.

        Bisects the factor on the errors at which a flight begins to fail; a flight costs one look a halving.
        """
        least = np.full(len(number), np.inf)
        open_ones = np.arange(len(number))
        # The factors are always the same, so that a flight's score does not depend on the level.
        last = _FACTORS
        if level > 0.0:
            last = min(last, math.ceil(-math.log(level) / math.log(_FACTOR) - 1e-9))
        for power in range(last + 1):
            fails = self._fails(z[:, open_ones], number[open_ones], power)
            least[open_ones[fails]] = power
            open_ones = open_ones[~fails]
        begun = np.flatnonzero(np.isfinite(least) & (least > 0.0))
        high = least[begun]
        low = high - 1.0
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            fails = self._fails(z[:, begun], number[begun], middle)
            high = np.where(fails, middle, high)
            low = np.where(fails, low, middle)
        least[begun] = high
        return _FACTOR**-least


Way = Callable[[np.ndarray, np.ndarray, float], np.ndarray]
"""Function of normal numbers (D, N), episodes (N,) and a level: scores (N,), from 1 on an event happens."""


def _followed(
    way: Way, flights: _Flights, size: tuple[int, int], random: np.random.Generator
) -> tuple[tuple[float, ...], int]:
    """Probability of the event by every group, and the events among the last flights.

    Args:
        way: to the event.
        flights: as drawn.
        size: chains of a group, and flights of a chain.
        random: numbers.
    """
    best, _ = size
    groups = np.ones(GROUPS)
    level = -math.inf
    step = 0.6
    for _ in range(_LEVELS):
        # One level for all groups, from those that have not died out: of levels that a group sets for itself the
        # product of its parts is biased.
        alive = groups > 0.0
        scores = np.sort(flights.score[alive], axis=None)
        next_level = min(1.0, float(scores[-best * int(alive.sum())]))
        if next_level <= level or (next_level == 0.0 and scores[-1] > 0.0):
            # More than a tenth have the same score: those with a higher one go on, if any.
            higher = scores[scores > max(level, 0.0)]
            if not len(higher):
                groups[:] = 0.0
                break
            next_level = min(1.0, float(higher[0]))
        level = next_level
        beyond = flights.score >= level
        groups *= beyond.mean(axis=1)
        if level >= 1.0 or not groups.any():
            break
        flights, step = _continued(way, flights, beyond, level, size, step, random)
    events = int((flights.score >= 1.0)[groups > 0.0].sum())
    return tuple(groups.tolist()), events


def _continued(
    way: Way,
    flights: _Flights,
    beyond: np.ndarray,
    level: float,
    size: tuple[int, int],
    step: float,
    random: np.random.Generator,
) -> tuple[_Flights, float]:
    """Flights beyond a level, by chains from those that reached it; and the length of the chains' steps.

    Args:
        way: to the event.
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
        new = _scored(way, z, number, level)
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


def _scored(way: Way, z: np.ndarray, number: np.ndarray, level: float) -> _Flights:
    scores = way(z.reshape(len(z), -1), number.ravel(), level)
    return _Flights(z, number, scores.reshape(number.shape))


def _error(groups: tuple[float, ...]) -> float:
    """Standard error of the mean of groups."""
    return float(np.std(groups, ddof=1) / math.sqrt(len(groups)))


def episode_numbers(random: np.random.Generator, count: int) -> np.ndarray:
    """Numbers of episodes that no campaign flies, (N,) int32."""
    return random.integers(2**31, size=count, dtype=np.int32)
