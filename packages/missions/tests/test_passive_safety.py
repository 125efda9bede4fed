"""Distances that coasts keep, against matrix exponentials and hand-worked orbits."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from rans_missions.passive_safety import (
    PRECISION,
    Pieces,
    keep_away,
    least_distances,
    pieces_of_periods,
    single_coasts,
)

from tests.support.clohessy_wiltshire import transition

N = 1.1e-3
ORBIT = 2.0 * math.pi / N
PERIOD = 20.0
TIMES = np.concatenate(
    [np.linspace(0.0, PERIOD, 201), np.linspace(PERIOD, PERIOD + ORBIT, 4000)[1:]]
)
"""Instants of coasts, s: the first 201 are a tenth of a second apart."""


def pushed(state: np.ndarray, push: np.ndarray, time: float) -> np.ndarray:
    """State after constant thrust."""
    return transition(N, time)[:6] @ np.concatenate([state, push])


@pytest.fixture(scope="module")
def responses() -> np.ndarray:
    """Responses (times, 6, 6) at instants of `TIMES`."""
    return np.array([transition(N, time)[:6, :6] for time in TIMES])


@pytest.mark.parametrize("seed", range(12))
def test_families_of_coasts_are_bounded(seed, responses):
    random = np.random.default_rng(seed)
    state = np.concatenate([random.uniform(-150.0, 150.0, 3), random.uniform(-0.2, 0.2, 3)])
    push = random.uniform(-0.02, 0.02, 3)
    # Coasts that begin at nine instants of the period, at common times.
    sampled = []
    for step in range(9):
        shut = pushed(state, push, PERIOD * step / 8)
        sampled.append(responses @ np.linalg.solve(responses[25 * step], shut))
    positions = np.array(sampled)[:, :, :3]
    after = pushed(state, push, PERIOD)
    one = np.array([0])
    pieces = pieces_of_periods(N, state[None], after[None], PERIOD, ORBIT, 50.0, one)
    found = float(least_distances(N, pieces, 1)[0])
    # No coast is nearer than the certified distance.
    assert found <= np.linalg.norm(positions, axis=2).min()
    # It is that of the segments between neighbours, which differ by their bend of less than 0.2 m.
    pairs = itertools.pairwise(positions)
    between = min(float(_segment_distance(a, b).min()) for a, b in pairs)
    assert found == pytest.approx(between, abs=0.35)


def _segment_distance(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Distance of the origin from segments between rows."""
    along = b - a
    square = np.maximum((along**2).sum(axis=1), 1e-30)
    part = np.clip(-(a * along).sum(axis=1) / square, 0.0, 1.0)
    return np.linalg.norm(a + part[:, None] * along, axis=1)


def test_an_impulse_at_an_unknown_instant_is_covered():
    # All thrust in the first half second of a period: not constant, but of one direction.
    period, change = 20.0, np.array([0.0, 0.1, 0.0])
    state = np.array([20.0, -150.0, 5.0, 0.0, 0.0, 0.0])
    nothing = np.zeros(3)
    after = pushed(pushed(state, change / 0.5, 0.5), nothing, period - 0.5)
    partial = pushed(state, change / 0.5, 0.25)
    one = np.array([0])
    pieces = pieces_of_periods(N, state[None], after[None], period, ORBIT, 50.0, one)
    coast = single_coasts(partial[None], np.array([ORBIT]), one)
    assert pieces.error.max() == pytest.approx(math.sqrt(50.0) * 0.1 * period / 4.0, rel=0.02)
    assert least_distances(N, pieces, 1)[0] <= least_distances(N, coast, 1)[0]


def test_whether_a_distance_is_kept_agrees_with_the_least_distance():
    random = np.random.default_rng(3)
    count, flights = 400, 80
    first = random.normal(size=(count, 6)) * [80.0, 80.0, 80.0, 0.1, 0.1, 0.1]
    second = first + random.normal(size=(count, 6)) * [0.0, 0.0, 0.0, 0.02, 0.02, 0.02]
    pieces = Pieces(
        first,
        np.where(random.uniform(size=(count, 1)) < 0.5, first, second),
        random.uniform(0.3, 1.2, count) * ORBIT,
        random.uniform(0.0, 0.3, count),
        random.integers(flights, size=count),
    )
    least = least_distances(N, pieces, flights)
    for distance in np.quantile(least, [0.1, 0.5, 0.9]):
        kept = keep_away(N, pieces, flights, float(distance))
        # Both are certain to a centimetre.
        certain = np.abs(least - distance) > PRECISION
        assert certain.sum() > 0.9 * flights
        np.testing.assert_array_equal(kept[certain], (least > distance)[certain])
