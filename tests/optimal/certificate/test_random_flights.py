"""Random spacecraft and flights against their bounds, and a broken bound found out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rans.optimal.certificate import hull
from rans.optimal.certificate.goal_set import GoalSet
from rans.optimal.certificate.plane.dual import Relaxation
from rans.optimal.certificate.plane.lattice import Lattice
from tests.support.bounded_flights import ROUNDING, beaten, points, random_craft
from tests.support.states import planar
from tests.support.tiny_lattice import lopsided


@pytest.mark.slow
def test_no_random_flight_is_below_its_bounds() -> None:
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


def test_a_bound_that_is_too_high_is_found_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """The cap that once forgot the thrusters that turn."""
    of = hull.Reach.of.__func__  # type: ignore[attr-defined]
    monkeypatch.setattr(
        hull.Reach,
        "of",
        lambda *given: replace(found := of(hull.Reach, *given), most=float(found.thrust.max())),
    )
    rows = [beaten(seed) for seed in range(39, 42)]
    assert max(row["least impulse"] for row in rows if row) > 1.0 + ROUNDING
    assert max(row["least time"] for row in rows if row) <= 1.0 + ROUNDING


def test_a_lattice_is_as_large_as_planned() -> None:
    """The plan is what the certificate then builds; larger ones are left out."""
    rest = planar()
    lattice = Lattice(lopsided(), 0.2)
    loose = GoalSet()
    built = Relaxation(lattice, rest, rest, loose, 7, None)._after.size
    assert points(lopsided(), rest, rest, loose, 7) == built


def test_random_craft_are_of_every_kind() -> None:
    some = [random_craft(np.random.default_rng(seed)) for seed in range(80)]
    assert {craft.dimension for craft in some} == {2, 3}
    assert {craft.thrust_sharing for craft in some} == {"none", "split"}
    equal = [len({t.force for t in craft.thrusters}) == 1 for craft in some]
    assert 10 < sum(equal) < 70
    central = [
        any(np.allclose(np.cross(t.position, t.direction), 0.0) for t in craft.thrusters)
        for craft in some
    ]
    assert sum(central) > 20
