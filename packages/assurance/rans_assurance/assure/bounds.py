"""Exact bounds on the probability of an event from counts, and the number of flights for a wanted bound."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple

from scipy.stats import beta

from rans.extend import ConfigError

Decision = Literal["below", "above", "open"]
"""Whether a probability is below or above the wanted bound; open: neither is certain."""

_LOOKS = 5
"""Number of looks at which failures may be rare enough; each has twice as many flights as the one before."""
_MOST = 2**31 - 1
"""Largest number of flights of a seed."""
_COUNTABLE = 2**62
"""Number of flights that stands for more than can be flown."""
_EARLY = 0.1
"""Share of the error probability for looks before these."""
_FIRST = 1024
"""Number of flights at the first look, at which failures may be too frequent."""


def upper(events: int, flights: int, level: float) -> float:
    """Upper confidence bound of a probability, which is wrong with a probability of ``level``.

    It is the probability of an event at which so few events are as likely as ``level`` (Clopper and Pearson,
    Biometrika 26, 1934).
    """
    return 1.0 if events >= flights else float(beta.isf(level, events + 1, flights - events))


def lower(events: int, flights: int, level: float) -> float:
    """Lower confidence bound of a probability, which is wrong with a probability of ``level``; see `upper`."""
    return 0.0 if events <= 0 else float(beta.ppf(level, events, flights - events + 1))


class ProbabilityBound(NamedTuple):
    """Number of events of one kind, with a confidence interval of its probability."""

    events: int
    flights: int
    low: float
    high: float

    @property
    def rate(self) -> float:
        """Share of flights with the event; NaN without flights."""
        return self.events / self.flights if self.flights else math.nan


def flights_needed(below: float, level: float) -> int:
    """Least number of flights without a failure with which `upper` is at most ``below``, or `_COUNTABLE`."""
    return math.ceil(min(math.log(level) / math.log1p(-below), _COUNTABLE))


@dataclass(frozen=True)
class Look:
    """Number of flights, fixed before the first one, at which the counts may end the campaign."""

    flights: int
    high_level: float
    """Probability that an `upper` bound of this look is wrong."""
    low_level: float
    """Probability that a `lower` bound of this look is wrong."""


@dataclass(frozen=True)
class CampaignPlan:
    """Looks of a campaign, whose bounds of one kind are all right with the confidence of the plan.

    A campaign that could end at any look would have bounds that are too good. So each look has a part of the
    allowed error probability, and the parts add up to the whole (Bonferroni): whichever look ends a campaign, its
    bounds hold. Of the error probability of upper bounds, a tenth is shared by the early looks, at which failures
    can only be too frequent. Of the rest, half is for the first look at which they can be rare enough, half of the
    remainder for the next, and so on. That of lower bounds is shared evenly by all looks.
    """

    looks: tuple[Look, ...]
    confidence: float
    """Probability that all upper bounds hold, and that all lower ones do."""
    below: float | None = None
    """Wanted bound of the probability of failure; None: there is none, and the only look is at the end."""

    @property
    def flights(self) -> int:
        """Largest number of flights."""
        return self.looks[-1].flights

    def look(self, flights: int) -> Look:
        """First look at or after a number of flights, whose levels are also those of an interrupted campaign."""
        return next((stage for stage in self.looks if stage.flights >= flights), self.looks[-1])

    def decision(self, failures: int, flights: int) -> Decision:
        """Decision from the number of failures at a look."""
        stage = self.look(flights)
        if self.below is None:
            return "open"
        if upper(failures, flights, stage.high_level) <= self.below:
            return "below"
        return "above" if lower(failures, flights, stage.low_level) > self.below else "open"


def plan(confidence: float, episodes: int | None, below: float | None = None) -> CampaignPlan:
    """Plan for a number of flights, or for a wanted bound of the probability of failure.

    Args:
        confidence: confidence of every bound.
        episodes: largest number of flights; None: as many as the wanted bound may need.
        below: wanted bound; None: there is none, and all episodes are flown.

    Raises:
        ConfigError: confidence or bound is no probability, or the bound needs more episodes.
    """
    if not 0.5 <= confidence < 1.0:
        percent = f" (did you mean {confidence / 100:g}?)" if 50.0 <= confidence < 100.0 else ""
        raise ConfigError(
            f"confidence must be at least 0.5 and below 1, such as 0.99, got {confidence:g}{percent}: it is the "
            "probability that a bound holds, not that it fails."
        )
    if below is not None and not 0.0 < below < 1.0:
        raise ConfigError(f"--failure-below must be a probability, > 0 and < 1, got {below}.")
    # A fixed number of flights: one stage, which has all of the error.
    error = 1.0 - confidence
    if below is None:
        if episodes is None:
            raise ConfigError("give a number of episodes, or a wanted bound (--failure-below).")
        return CampaignPlan((Look(episodes, error, error),), confidence)
    # Numbers of flights that show the bound without a failure: at the last stage, and at the first late one.
    least, first = (
        flights_needed(below, error * (1.0 - _EARLY) * fraction) for fraction in (1.0, 0.5)
    )
    largest = min(first * 2 ** (_LOOKS - 1), _MOST) if episodes is None else episodes
    if largest < least:
        raise ConfigError(
            f"{largest:,} flights cannot show a probability below {below:g} at a confidence of "
            f"{confidence:.6g}: that takes at least {least:,} without a failure."
        )
    # Stages double. Early ones, before the bound can be shown, may stop campaigns that fail often.
    late = [first * 2**k for k in range(_LOOKS) if first * 2**k < largest] + [largest]
    early = [n for k in range(40, 0, -1) if (n := first // 2**k) >= _FIRST and n < late[0]]
    # Each late stage has half the error of the one before, so that all together have that of the plan.
    fractions = [2.0 ** -min(k, len(late) - 1) for k in range(1, len(late) + 1)]
    high = [error * _EARLY / len(early) for _ in early]
    high += [(error - sum(high)) * fraction for fraction in fractions]
    low = error / len(high)
    return CampaignPlan(
        tuple(Look(n, level, low) for n, level in zip(early + late, high, strict=True)),
        confidence,
        below,
    )
