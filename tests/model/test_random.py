"""Spins that episodes draw; everything else drawn is tested with the scenarios made of it."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import stats
from scipy.spatial.transform import Rotation

from rans.model.random import Random, generator, seed_words

FALSE_ALARM = 1e-6
COUNT = 20_000


def random(dimension: int) -> Random:
    return Random(dimension, *seed_words(4), np.arange(COUNT, dtype=np.int32), np.float64)  # type: ignore[arg-type]


def test_spins_in_the_plane_go_either_way():
    assert stats.kstest(random(2).spin(0.7), stats.uniform(-0.7, 1.4).cdf).pvalue > FALSE_ALARM


def test_spins_in_space_have_every_rate_and_axis():
    spins = np.stack(random(3).spin(0.7).columns())
    rates = np.linalg.norm(spins, axis=0)
    assert stats.kstest(rates, stats.uniform(0.0, 0.7).cdf).pvalue > FALSE_ALARM
    for component in spins / rates:  # of a point on the sphere: uniform, after Archimedes
        assert stats.kstest(component, stats.uniform(-1.0, 2.0).cdf).pvalue > FALSE_ALARM


def test_vectors_have_every_length_of_a_range():
    lengths = np.hypot(*random(2).vector((1.0, 3.0)).columns())
    assert stats.kstest(lengths, stats.uniform(1.0, 2.0).cdf).pvalue > FALSE_ALARM


def test_generators_take_every_seed_that_scenarios_take():
    drawn = {tuple(generator(seed).integers(2**32, size=4)) for seed in (0, 1, 2**64 - 1)}
    assert len(drawn) == 3
    assert tuple(np.random.default_rng(0).integers(2**32, size=4)) in drawn


def test_attitudes_in_space_are_uniform_over_all_rotations():
    """Every column of a rotation's matrix is a point of the sphere (Archimedes); angles follow."""
    q: Any = random(3).attitude()
    matrices = Rotation.from_quat(np.stack([q.x, q.y, q.z, q.w], axis=1)).as_matrix()
    np.testing.assert_allclose(np.linalg.norm([q.w, q.x, q.y, q.z], axis=0), 1.0, rtol=1e-12)
    for entry in matrices.reshape(COUNT, 9).T:
        assert stats.kstest(entry, stats.uniform(-1.0, 2.0).cdf).pvalue > FALSE_ALARM
    angle = np.arccos(np.clip(0.5 * (np.trace(matrices, axis1=1, axis2=2) - 1.0), -1.0, 1.0))
    assert stats.kstest((angle - np.sin(angle)) / np.pi, "uniform").pvalue > FALSE_ALARM
