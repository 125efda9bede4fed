"""Spins that episodes draw; everything else drawn is tested with the scenarios made of it."""

from __future__ import annotations

import numpy as np
from scipy import stats

from rans.model.random import Random, seed_words

FALSE_ALARM = 1e-6
COUNT = 20_000


def random(dimension: int) -> Random:
    return Random(dimension, *seed_words(4), np.arange(COUNT, dtype=np.int32), np.float64)  # type: ignore[arg-type]


def test_spins_in_the_plane_go_either_way() -> None:
    assert stats.kstest(random(2).spin(0.7), stats.uniform(-0.7, 1.4).cdf).pvalue > FALSE_ALARM


def test_spins_in_space_have_every_rate_and_axis() -> None:
    spins = np.stack(random(3).spin(0.7).columns())
    rates = np.linalg.norm(spins, axis=0)
    assert stats.kstest(rates, stats.uniform(0.0, 0.7).cdf).pvalue > FALSE_ALARM
    for component in spins / rates:  # of a point on the sphere: uniform, after Archimedes
        assert stats.kstest(component, stats.uniform(-1.0, 2.0).cdf).pvalue > FALSE_ALARM
