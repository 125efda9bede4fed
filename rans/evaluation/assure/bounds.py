"""Exact bounds on the probability of an event from counts, and the flights that a wanted bound needs."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple

from scipy.stats import beta, binom

from rans.errors import ConfigError

Decision = Literal["below", "above", "open"]
"""Whether a probability is below or above the wanted bound; open: neither is certain yet."""

_LOOKS = 5
"""At which failures may be found to be rare enough: twice as many flights at each as at the one before."""
_MOST = 2**31 - 1
"""Flights that a seed has numbers for."""
_COUNTABLE = 2**62
"""Flights up to which SciPy's binomial distribution takes a number."""
_EARLY = 0.1
"""Share of the chance of error that looks before these have."""
_FIRST = 1024
"""Flights before the first look that may find them too frequent."""


def upper(events: int, flights: int, level: float) -> float:
    """Below which the probability lies, but for a chance of ``level``.

    Clopper and Pearson, Biometrika 26, 1934: the probability at which so few events have this chance.
    """
    return 1.0 if events >= flights else float(beta.isf(level, events + 1, flights - events))


def lower(events: int, flights: int, level: float) -> float:
    """Above which the probability lies, but for a chance of ``level``; see `upper`."""
    return 0.0 if events <= 0 else float(beta.ppf(level, events, flights - events + 1))


class Bound(NamedTuple):
    """What is known of the probability of one event."""

    events: int
    flights: int
    low: float
    high: float

    @property
    def rate(self) -> float:
        """Share of the flights; NaN of none."""
        return self.events / self.flights if self.flights else math.nan


def flights_needed(below: float, level: float, events: int = 0) -> int:
    """The fewest flights after which so few events put `upper` at most at ``below``, or `_COUNTABLE`."""
    few = 0
    many = 1
    while many < _COUNTABLE and binom.cdf(events, many, below) > level:
        few = many
        many = 2 * many
    while many - few > 1:
        middle = (few + many) // 2
        few, many = (middle, many) if binom.cdf(events, middle, below) > level else (few, middle)
    return many


@dataclass(frozen=True)
class Look:
    """A moment, fixed before the first flight, at which the counts may end the campaign."""

    flights: int
    high_level: float
    """Chance that an `upper` bound stated here is wrong."""
    low_level: float
    """Chance that a `lower` bound stated here is wrong."""


@dataclass(frozen=True)
class Plan:
    """When to look. However often that is, all statements of one kind together fail with one chance.

    Looking often and stopping when it suits would make bounds too good. So each look has a part of the
    allowed chance of error for itself, and the parts add up to the whole (Bonferroni): whichever look ends a
    campaign, its bounds hold. Of the chance for upper bounds, a tenth is shared by the early looks, which
    can only find failures too frequent; of the rest, half is for the first look that can find them rare
    enough, half of what is left for the next, and so on. That for lower bounds all looks share evenly.
    """

    looks: tuple[Look, ...]
    confidence: float
    """Probability that all upper bounds hold, and that all lower ones do."""
    below: float | None = None
    """The bound wanted of the probability of failure; None: there is none, and one look at the end."""

    @property
    def flights(self) -> int:
        """The most that are flown."""
        return self.looks[-1].flights

    def look(self, flights: int) -> Look:
        """The first that is not before so many flights, whose levels also serve an interrupted campaign."""
        return next((look for look in self.looks if look.flights >= flights), self.looks[-1])

    def decision(self, failures: int, flights: int) -> Decision:
        """What so many failures at a look mean."""
        look = self.look(flights)
        if self.below is None:
            return "open"
        if upper(failures, flights, look.high_level) <= self.below:
            return "below"
        return "above" if lower(failures, flights, look.low_level) > self.below else "open"

    def allowed(self, look: Look) -> int:
        """The most failures that are rare enough at a look; -1: not even none."""
        if self.below is None:
            return -1
        most = int(binom.ppf(look.high_level, look.flights, self.below))
        return most if binom.cdf(most, look.flights, self.below) <= look.high_level else most - 1


def plan(confidence: float, episodes: int | None, below: float | None = None) -> Plan:
    """When to look, for a number of flights, or a bound wanted of the probability of failure.

    Args:
        confidence: of every bound.
        episodes: the most to fly; None: as many as the wanted bound may need.
        below: the bound wanted; None: none, and all episodes are flown.

    Raises:
        ConfigError: confidence or bound is no probability, or the bound needs more episodes.
    """
    for name, value in (("--confidence", confidence), ("--failure-below", below)):
        if value is not None and not 0.0 < value < 1.0:
            raise ConfigError(f"{name} must be a probability, > 0 and < 1, got {value}.")
    error = 1.0 - confidence
    if below is None:
        if episodes is None:
            raise ConfigError("say how many episodes to fly, or which bound is wanted.")
        return Plan((Look(episodes, error, error),), confidence)
    least, first = (flights_needed(below, error * (1.0 - _EARLY) * share) for share in (1.0, 0.5))
    most = min(first * 2 ** (_LOOKS - 1), _MOST) if episodes is None else episodes
    if most < least:
        raise ConfigError(
            f"{most:,} flights cannot show a probability below {below:g} at a confidence of "
            f"{confidence:.6g}: that takes at least {least:,} without a failure."
        )
    late = [first * 2**k for k in range(_LOOKS) if first * 2**k < most] + [most]
    early = [n for k in range(40, 0, -1) if (n := first // 2**k) >= _FIRST and n < late[0]]
    shares = [2.0 ** -min(k, len(late) - 1) for k in range(1, len(late) + 1)]
    high = [error * _EARLY / len(early) for _ in early]
    high += [(error - sum(high)) * share for share in shares]
    low = error / len(high)
    return Plan(
        tuple(Look(n, level, low) for n, level in zip(early + late, high, strict=True)),
        confidence,
        below,
    )
