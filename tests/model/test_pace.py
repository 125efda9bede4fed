"""Masses and radii that do not fit each other."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from rans.model.pace import misfits
from tests.support.engines import PLATFORM


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({}, 0),
        ({"radius": 310.0}, 1),
        ({"radius": 0.00031}, 2),
        ({"inertia": ((20.0, 0.0, 0.0), (0.0, 20.0, 0.0), (0.0, 0.0, 20.0))}, 1),
        ({"centre_of_mass": (0.35, 0.0, 0.0)}, 1),
        ({"mass": 1000.0 * PLATFORM.mass}, 1),
        # Forces in mN: 532 m/s^2.
        ({"thrusters": tuple(replace(t, force=1000.0) for t in PLATFORM.thrusters)}, 1),
    ],
)
def test_a_body_fits_its_radius(changes: dict[str, Any], expected: int) -> None:
    assert len(misfits(replace(PLATFORM, **changes))) == expected
