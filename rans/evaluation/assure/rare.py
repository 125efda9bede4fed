"""Probabilities of events too rare to be counted: importance sampling, learnt by cross-entropy."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from rans.model.random import generator

Score = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Function of standard normal numbers (D, N) and episode numbers (N,) int32; from 1 on an event happens, (N,)."""

_SHARE = 0.1
"""Share of a round, nearest to the event, that the next round's distribution is fitted to."""
_ROUNDS = 10
_FEWEST = 1000
_LEAST_RISE = 0.05
"""Part of the way to an event by which a round must come closer to be worth another."""
_KEPT = 0.3
"""How much of the last round's distribution is kept; without it small samples run away."""
_NARROWEST = 0.3
"""Standard deviation."""
_AS_DRAWN = 0.3
"""Share of the sample that is drawn as usual, by which no weight is larger than its inverse."""
NORMAL_99 = 2.5758
"""99.5 % quantile of the standard normal distribution."""


@dataclass(frozen=True)
class Tilt:
    """Independent normal distributions, (D, 1) each: what leads to events more often than chance does."""

    mean: np.ndarray
    spread: np.ndarray

    def sample(self, random: np.random.Generator, count: int) -> np.ndarray:
        """(D, N), a share of which is drawn as usual."""
        z = random.standard_normal((len(self.mean), count))
        usual = random.random(count) < _AS_DRAWN
        return np.where(usual, z, self.mean + self.spread * z)

    def weight(self, z: np.ndarray) -> np.ndarray:
        """How much likelier each is as usual than in `sample`, (N,), at most the inverse of that share."""
        here = -0.5 * ((z - self.mean) / self.spread) ** 2 - np.log(self.spread)
        likelier = np.exp(np.minimum((here + 0.5 * z**2).sum(axis=0), 700.0))
        return 1.0 / (_AS_DRAWN + (1.0 - _AS_DRAWN) * likelier)


@dataclass(frozen=True)
class Rare:
    """What importance sampling found."""

    probability: float
    error: float
    """Standard error."""
    events: int
    """Met in the sample."""
    sample: int
    """Flights of it."""
    learning: int
    """Flights before it, that chose where to look."""

    @property
    def interval(self) -> tuple[float, float] | None:
        """At 99 %, by the central limit theorem: an estimate, no proof; none without an event."""
        if not self.events:
            return None
        half = NORMAL_99 * self.error
        return max(0.0, self.probability - half), self.probability + half

    @property
    def summary(self) -> str:
        """Estimate in one sentence."""
        if self.interval is None:
            return (
                f"no failure was met in {self.sample:,} flights, after {self.learning:,} that chose "
                "where to look, so there is no estimate"
            )
        low, high = self.interval
        return (
            f"the probability of failure is {self.probability:.3g} ({low:.3g} to {high:.3g}), with a "
            f"gain of {self.gain:.3g} over counting"
        )

    def to_json(self) -> dict[str, Any]:
        """For `rans.files.write_json`."""
        return asdict(self) | {"99 %": self.interval, "gain": self.gain}

    @property
    def gain(self) -> float:
        """How many times as many flights counting would need for an error as small; NaN without an event."""
        if not self.error:
            return float("nan")
        return self.probability * (1.0 - self.probability) / (self.error**2 * self.sample)


def rare(score: Score, dimensions: int, count: int, seed: int) -> Rare:
    """The probability of an event by a sample of so many, and a tenth as many in each round before it."""
    random = generator(seed)
    tilt, learning = learnt(score, dimensions, max(_FEWEST, count // 10), random)
    return estimated(score, tilt, count, learning, random)


def learnt(
    score: Score, dimensions: int, count: int, random: np.random.Generator
) -> tuple[Tilt, int]:
    """Where events are likely, and how many scores that took.

    The cross-entropy method (Rubinstein and Kroese, 2004, section 3.2): the tenth of a sample that scores
    most moves the distribution of the next, weighted by how likely each is as usual, until a tenth are
    events, or until that no longer helps.
    """
    tilt = Tilt(np.zeros((dimensions, 1)), np.ones((dimensions, 1)))
    before = -np.inf
    for number in range(1, _ROUNDS + 1):
        z = tilt.sample(random, count)
        found = score(z, numbers(random, count))
        level = min(1.0, float(np.quantile(found, 1.0 - _SHARE, method="higher")))
        if level < before + _LEAST_RISE * (1.0 - before):
            return tilt, number * count
        best = found >= level
        before = level
        weight = tilt.weight(z)[best]
        weight /= weight.sum()
        mean = (z[:, best] * weight).sum(axis=1, keepdims=True)
        spread = np.sqrt(((z[:, best] - mean) ** 2 * weight).sum(axis=1, keepdims=True))
        tilt = Tilt(
            _KEPT * tilt.mean + (1.0 - _KEPT) * mean,
            np.maximum(_NARROWEST, _KEPT * tilt.spread + (1.0 - _KEPT) * spread),
        )
        if level >= 1.0:
            return tilt, number * count
    return tilt, _ROUNDS * count


def estimated(
    score: Score, tilt: Tilt, count: int, learning: int, random: np.random.Generator
) -> Rare:
    """The probability of an event, which does not depend on where one looks, but its error does."""
    z = tilt.sample(random, count)
    events = score(z, numbers(random, count)) >= 1.0
    values = np.where(events, tilt.weight(z), 0.0)
    return Rare(
        float(values.mean()),
        float(values.std(ddof=1) / np.sqrt(count)),
        int(events.sum()),
        count,
        learning,
    )


def numbers(random: np.random.Generator, count: int) -> np.ndarray:
    """Numbers of episodes that nobody flew before, (N,) int32."""
    return random.integers(2**31, size=count, dtype=np.int32)
