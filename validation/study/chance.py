"""Statistics as checks: how improbable is what was drawn, if it is drawn as the documents say?"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy import stats

from validation.study.checks import Check

UNLIKELY = 8.0
"""Powers of ten: a probability of 1e-8. A study with some fifty statistics passes it by chance with one seed
in two million."""
_LEAST = 1e-300
"""Probabilities are told no smaller than this: a logarithm has no zero."""


def chance_check(name: str, probability: float, reason: str, worst: str = "") -> Check:
    """How many powers of ten below one a probability is, of which the tolerance allows eight.

    Args:
        name: what was drawn.
        probability: of what was seen, or of worse, if it is drawn as stated.
        reason: how it is drawn, without a full stop.
        worst: where it was seen.
    """
    surprise = abs(np.log10(np.clip(probability, _LEAST, 1.0)))  # that of a NaN is NaN, and fails
    return Check(
        name,
        float(surprise),
        UNLIKELY,
        "decades",
        f"{reason}: a probability of 1e-8 is no chance.",
        worst,
    )


def uniform_check(name: str, drawn: Mapping[str, tuple[Any, float, float]]) -> Check:
    """Kolmogorov and Smirnov's test of uniform distributions; a value outside of its bounds is impossible.

    That of several quantities the worst one counts is allowed for (Bonferroni).

    Args:
        name: of all that was drawn.
        drawn: values (N,), the least and the largest that they may be, by quantity.
    """
    least = 1.0
    where = ""
    for quantity, (values, low, high) in drawn.items():
        values = np.asarray(values, dtype=float)
        slack = 1e-9 * (high - low)
        inside = (values >= low - slack) & (values <= high + slack)
        outside = np.count_nonzero(~inside)
        probability = (
            stats.kstest(values, stats.uniform(low, high - low).cdf).pvalue if not outside else 0.0
        )
        if not probability > least:
            least = probability
            where = f"{quantity}, {outside} of {len(values):,} outside of {low:g} to {high:g}"
    return chance_check(name, len(drawn) * least, "Declared as uniform within bounds", where)


def even_check(name: str, values: Any, kinds: int) -> Check:
    """The chi-squared test of whole numbers from 0 to kinds - 1, each as likely as the next.

    Args:
        name: what was drawn.
        values: (N,) whole numbers; another than these is impossible.
        kinds: how many there are.
    """
    values = np.asarray(values)
    possible = np.isin(values, np.arange(kinds))
    counts = np.bincount(values[possible].astype(int), minlength=kinds)
    probability = 0.0
    if possible.all() and counts.sum():
        probability = 1.0 if kinds == 1 else float(np.asarray(stats.chisquare(counts).pvalue))
    return chance_check(
        name,
        probability,
        f"Each of {kinds} is declared as likely as the next",
        f"{counts.min()} to {counts.max()} times each",
    )


def share_check(name: str, hits: Any, probability: float) -> Check:
    """The binomial test of how often something happens.

    Args:
        name: what happens.
        hits: truth values of any shape.
        probability: how often it should.
    """
    hits = np.asarray(hits)
    seen = int(np.count_nonzero(hits))
    chance = float(np.asarray(stats.binomtest(seen, hits.size, probability).pvalue))
    return chance_check(
        name,
        chance,
        f"Declared to happen with a probability of {probability:g}",
        f"{seen:,} of {hits.size:,}",
    )


def normal_check(name: str, values: Any, deviation: float) -> Check:
    """Kolmogorov and Smirnov's test of a normal distribution of mean zero, and the chi-squared of its size.

    Args:
        name: what was drawn.
        values: of any shape.
        deviation: its standard deviation, in the values' unit.
    """
    values = np.ravel(values)
    shape = stats.kstest(values, stats.norm(0.0, deviation).cdf).pvalue
    squares = stats.chi2(values.size)
    total = np.sum((values / deviation) ** 2)
    size = 2.0 * np.minimum(squares.cdf(total), squares.sf(total))
    return chance_check(
        name,
        2.0 * float(np.minimum(shape, size)),
        f"Declared as normal with a standard deviation of {deviation:g}",
        f"{values.size:,} draws, deviation {values.std():.3g}",
    )


def independence_check(name: str, pairs: Mapping[str, tuple[Any, Any]]) -> Check:
    """The strongest correlation of many pairs, each (N,), against that of independent numbers.

    Its standard error is 1 / sqrt(N); that there are many pairs is allowed for (Bonferroni). What never
    varies was not drawn: it counts as impossible.
    """
    strongest = 0.0
    where = ""
    for label, (one, other) in pairs.items():
        varies = np.ptp(one) > 0.0 and np.ptp(other) > 0.0
        correlation = np.corrcoef(np.ravel(one), np.ravel(other))[0, 1] if varies else np.inf
        error = abs(correlation) * np.sqrt(np.size(one))
        if error > strongest:
            strongest = error
            where = label
    probability = len(pairs) * 2.0 * float(stats.norm.sf(strongest))
    return chance_check(name, probability, f"Declared as independent, {len(pairs):,} pairs", where)


def all_pairs(columns: Mapping[str, Any]) -> dict[str, tuple[Any, Any]]:
    """Every pair of different columns."""
    names: Sequence[str] = list(columns)
    return {
        f"{one} and {other}": (columns[one], columns[other])
        for k, one in enumerate(names)
        for other in names[k + 1 :]
    }
