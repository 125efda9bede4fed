"""Responses to impulses: those of the matrix exponential, and pairs of impulses that displace as asked."""

from __future__ import annotations

import numpy as np
import pytest
from rans_missions.guidance.impulses import ImpulseResponse, axis_price, two_impulses
from scipy.linalg import expm

from rans.model.fields import Vec3

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


def test_two_impulses_displace_as_asked() -> None:
    """(1, 2) and (3, -1) make (7, 0) as 1 and 2 times."""
    assert two_impulses((1.0, 2.0), (3.0, -1.0), (7.0, 0.0)) == pytest.approx((1.0, 2.0), rel=1e-8)


def test_impulses_along_one_line_are_too_dear_to_be_chosen() -> None:
    assert max(map(abs, two_impulses((1.0, 2.0), (2.0, 4.0), (1.0, 0.0)))) > 1e8


def test_thrusters_along_the_axes_pay_for_every_component() -> None:
    assert axis_price(Vec3(3.0, -4.0, 0.5)) == 7.5
