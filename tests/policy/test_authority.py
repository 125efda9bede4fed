"""Columns of a craft's authority at states whose place of rest was worked out by hand."""

from __future__ import annotations

import math

import pytest

from rans.policy.authority import Authority, columns

OWN = Authority.of_numbers((0.2, 0.1, 0.05, 0.2, 0.08, 0.5, 0.3))
"""Accelerations along +x, -x, +y, -y, m/s^2, and about +z, -z, rad/s^2."""


@pytest.mark.parametrize(("spin", "braking"), [(0.4, 0.3), (-0.4, 0.5)])
def test_a_spin_rests_after_a_period_and_its_braking(spin: float, braking: float) -> None:
    """It turns by w T before the craft answers, then by w^2 / (2 alpha): there its column is 0.

    The angle of a rotation is off by some 1e-6 where its formula is smooth; a period turns by 0.08 rad.
    """
    angle = spin * 0.2 + spin * abs(spin) / (2.0 * braking)
    turn = math.cos(angle), [math.sin(angle)]
    assert columns([1.0, 2.0], turn, [0.0, 0.0], [spin], OWN)[15] == pytest.approx(0.0, abs=1e-4)
    before = math.cos(angle + 0.01), [math.sin(angle + 0.01)]
    assert columns([1.0, 2.0], before, [0.0, 0.0], [spin], OWN)[15] > 0.01


@pytest.mark.parametrize(
    ("velocity", "braking"), [((0.1, 0.2), (0.05, 0.08)), ((-0.1, -0.2), (0.1, 0.2))]
)
def test_a_velocity_rests_after_a_period_and_its_braking(
    velocity: tuple[float, float], braking: tuple[float, float]
) -> None:
    """Along each axis it moves on by v T, then by v^2 / (2 a) of the acceleration against it."""
    error = [v * 0.2 + v * abs(v) / (2.0 * a) for v, a in zip(velocity, braking, strict=True)]
    found = columns(error, (1.0, [0.0]), list(velocity), [0.0], OWN)[4:6]
    assert found == pytest.approx([0.0, 0.0], abs=1e-6)
