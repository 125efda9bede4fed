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
"""Share of a round, with the highest scores, to which the next round's distribution is fitted."""
_ROUNDS = 10
_FEWEST = 1000
_LEAST_RISE = 0.05
"""Least increase of the score in a round, as a share of what is missing, for another round."""
_KEPT = 0.3
"""Weight of the last round's distribution in the next; without it small samples diverge."""
_NARROWEST = 0.3
"""Least standard deviation."""
_AS_DRAWN = 0.3
"""Share of the sample from the nominal distribution; its inverse bounds the weights."""
NORMAL_99 = 2.5758
"""99.5 % quantile of the standard normal distribution."""


@dataclass(frozen=True)
class Tilt:
    """Independent normal distributions, under which events are more likely than under the nominal one."""

    mean: np.ndarray
    spread: np.ndarray

    def sample(self, random: np.random.Generator, count: int) -> np.ndarray:
        """Sample (D, N), a share of which is from the nominal distribution."""
        z = random.standard_normal((len(self.mean), count))
        usual = random.random(count) < _AS_DRAWN
        return np.where(usual, z, self.mean + self.spread * z)

    def weight(self, z: np.ndarray) -> np.ndarray:
        """Likelihood ratios (N,) of the nominal distribution to that of `sample`."""
        here = -0.5 * ((z - self.mean) / self.spread) ** 2 - np.log(self.spread)
        likelier = np.exp(np.minimum((here + 0.5 * z**2).sum(axis=0), 700.0))
        return 1.0 / (_AS_DRAWN + (1.0 - _AS_DRAWN) * likelier)


@dataclass(frozen=True)
class Rare:
    """Result of importance sampling."""

    probability: float
    error: float
    """Standard error."""
    events: int
    """Number of events in the sample."""
    sample: int
    """Number of flights in the sample."""
    learning: int
    """Number of flights before it, from which the distribution was learnt."""

    @property
    def interval(self) -> tuple[float, float] | None:
        """Interval at 99 % by the central limit theorem, an estimate and no proof; None without an event."""
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
        """Data for `rans.files.write_json`."""
        return asdict(self) | {"99 %": self.interval, "gain": self.gain}

    @property
    def gain(self) -> float:
        """Flights that counting needs for the same error, over those of the sample; NaN without an event."""
        if not self.error:
            return float("nan")
        return self.probability * (1.0 - self.probability) / (self.error**2 * self.sample)


def rare(score: Score, dimensions: int, count: int, seed: int) -> Rare:
    """Probability of an event from a sample of ``count``, after rounds of a tenth of that."""
    random = generator(seed)
    tilt, learning = learnt(score, dimensions, max(_FEWEST, count // 10), random)
    return estimated(score, tilt, count, learning, random)


def learnt(
    score: Score, dimensions: int, count: int, random: np.random.Generator
) -> tuple[Tilt, int]:
    """Learn a distribution under which events are likely; returns the number of scores too.

    The cross-entropy method (Rubinstein and Kroese, 2004, section 3.2): the distribution of the next round is
    fitted to the tenth of a sample with the highest scores, weighted by likelihood ratios, until a tenth are
    events, or until scores no longer increase.
    """
    tilt = Tilt(np.zeros((dimensions, 1)), np.ones((dimensions, 1)))
    before = -np.inf
    for number in range(1, _ROUNDS + 1):
        z = tilt.sample(random, count)
        scores = score(z, numbers(random, count))
        level = min(1.0, float(np.quantile(scores, 1.0 - _SHARE, method="higher")))
        if level < before + _LEAST_RISE * (1.0 - before):
            return tilt, number * count
        best = scores >= level
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
    """Probability of an event; the distribution of the sample changes its standard error only."""
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
    """Numbers of episodes that no campaign flies, (N,) int32."""
    return random.integers(2**31, size=count, dtype=np.int32)
