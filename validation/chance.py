"""Statistics as checks: how improbable is what was drawn, if it is drawn as the documents say?"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy import stats

from validation.checks import Check

UNLIKELY = 8.0
"""Powers of ten: a probability of 1e-8. All statistics of a study together pass it once in 300,000 seeds."""
_LEAST = 1e-300
"""Probabilities are told no smaller than this: a logarithm has no zero."""


def chance_check(name: str, probability: float, reason: str, worst: str = "") -> Check:
    """A probability as powers of ten, of which the tolerance allows eight.

    Args:
        name: what was drawn.
        probability: of what was seen, or of worse, if it is drawn as stated.
        reason: how it is drawn, as one sentence.
        worst: where it was seen.
    """
    surprise = -np.log10(max(float(probability), _LEAST))
    return Check(name, max(float(surprise), 0.0), UNLIKELY, "-log10 p", reason, worst)


def uniform_check(name: str, values: Any, low: float, high: float) -> Check:
    """Kolmogorov and Smirnov's test of a uniform distribution; a value outside of it is impossible.

    Args:
        name: what was drawn.
        values: (N,).
        low: the least it may be.
        high: the largest.
    """
    values = np.asarray(values, dtype=float)
    slack = 1e-9 * (high - low)
    outside = (values < low - slack) | (values > high + slack)
    probability = 0.0 if outside.any() else stats.kstest(values, stats.uniform(low, high - low).cdf).pvalue
    return chance_check(name, probability, f"Declared as uniform from {low:g} to {high:g}.",
                        f"{len(values):,} draws, {np.count_nonzero(outside)} of them outside")


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
    probability = 0.0 if not possible.all() or not counts.sum() else (
        1.0 if kinds == 1 else stats.chisquare(counts).pvalue)
    return chance_check(name, probability, f"Each of {kinds} is declared as likely as the next.",
                        f"{counts.min()} to {counts.max()} times each")


def share_check(name: str, hits: Any, probability: float) -> Check:
    """The binomial test of how often something happens.

    Args:
        name: what happens.
        hits: truth values of any shape.
        probability: how often it should.
    """
    hits = np.asarray(hits)
    seen = int(np.count_nonzero(hits))
    return chance_check(name, stats.binomtest(seen, hits.size, probability).pvalue,
                        f"Declared to happen with a probability of {probability:g}.",
                        f"{seen:,} of {hits.size:,}")


def normal_check(name: str, values: Any, deviation: float) -> Check:
    """Kolmogorov and Smirnov's test of a normal distribution of mean zero.

    Args:
        name: what was drawn.
        values: of any shape.
        deviation: its standard deviation, in the values' unit.
    """
    values = np.ravel(values)
    return chance_check(name, stats.kstest(values, stats.norm(0.0, deviation).cdf).pvalue,
                        f"Declared as normal with a standard deviation of {deviation:g}.",
                        f"{values.size:,} draws, deviation {values.std():.3g}")


def independence_check(name: str, pairs: Mapping[str, tuple[Any, Any]]) -> Check:
    """The strongest correlation of many pairs, each (N,), against that of independent numbers.

    Its standard error is 1 / sqrt(N); that there are many pairs is allowed for (Bonferroni).
    """
    strongest = 0.0
    where = ""
    for label, (one, other) in pairs.items():
        error = abs(np.corrcoef(np.ravel(one), np.ravel(other))[0, 1]) * np.sqrt(np.size(one))
        if not error <= strongest:
            strongest = error
            where = label
    probability = min(1.0, len(pairs) * 2.0 * float(stats.norm.sf(strongest)))
    return chance_check(name, probability, f"Declared as independent, each of {len(pairs):,} pairs.", where)


def all_pairs(columns: Mapping[str, Any]) -> dict[str, tuple[Any, Any]]:
    """Every pair of different columns."""
    names: Sequence[str] = list(columns)
    return {f"{one} and {other}": (columns[one], columns[other])
            for k, one in enumerate(names) for other in names[k + 1:]}
