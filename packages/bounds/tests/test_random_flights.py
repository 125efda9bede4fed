"""Random spacecraft and flights against their bounds, and a broken bound found out."""

from dataclasses import replace

import pytest
from rans_bounds import hull

from tests.support.bounded_flights import ROUNDING, beaten


@pytest.mark.slow
def test_no_random_flight_is_below_its_bounds():
    """Some are on them: what holds all its thrusters open from rest cannot be done sooner."""
    rows = {seed: beaten(seed) for seed in range(100, 140)}
    beyond = {
        seed: row
        for seed, row in rows.items()
        if not all(x <= 1.0 + ROUNDING for x in row.values())
    }
    assert not beyond
    times = [row["least time"] for row in rows.values() if row]
    assert len(times) > 20
    assert max(times) == pytest.approx(1.0, abs=1e-6)
    assert any("dual of the certificate" in row for row in rows.values())


def test_a_bound_that_is_too_high_is_found_out(monkeypatch):
    """The cap that once forgot the thrusters that turn."""
    of = hull.Reach.of.__func__  # type: ignore[attr-defined]
    monkeypatch.setattr(
        hull.Reach,
        "of",
        lambda *given: replace(found := of(hull.Reach, *given), most=float(found.thrust.max())),
    )
    rows = [beaten(seed) for seed in (40, 41)]
    assert max(row["least impulse"] for row in rows if row) > 1.0 + ROUNDING
    assert max(row["least time"] for row in rows if row) <= 1.0 + ROUNDING
