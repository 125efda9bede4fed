"""Responses to impulses: those of the matrix exponential, and pairs of impulses that displace as asked."""

from __future__ import annotations

import numpy as np
import pytest
from rans_missions.guidance.impulses import ImpulseResponse
from scipy.linalg import expm

N = 0.0011
IN_PLANE = np.array(
    [[0, 0, 1, 0], [0, 0, 0, 1], [3 * N**2, 0, 0, 2 * N], [0, 0, -2 * N, 0]], dtype=float
)
"""Clohessy-Wiltshire equations in the orbital plane, of (x, y, x', y')."""


@pytest.mark.parametrize("time", [10.0, 900.0, 4000.0])
def test_a_response_is_a_column_of_the_matrix_exponential(time: float) -> None:
    response = ImpulseResponse(time, np.sin(N * time), 1.0 - np.cos(N * time))
    transition = expm(IN_PLANE * time)
    for axis in (0, 1):
        column = transition[:, 2 + axis]
        assert response.displacement(N, axis) == pytest.approx(tuple(column[:2]), rel=1e-9)
        assert response.velocity_change(axis) == pytest.approx(tuple(column[2:]), rel=1e-9)
