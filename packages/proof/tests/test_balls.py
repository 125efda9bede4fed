"""Ball arithmetic."""

from __future__ import annotations

import pytest


def test_powers_of_balls_round_zero() -> None:
    """Spins and heading near zero: products and squares of them are numbers."""
    flint = pytest.importorskip("flint")
    from rans_proof.balls import polynomial, value_at

    ball = flint.arb(0, 0.5)
    value = value_at(polynomial("x0 * x0 * x1 - 2 * x0", 2, 2), [ball, flint.arb(3)])
    assert value.contains(0)
    assert 1.0 <= float(value.upper()) < 2.0
