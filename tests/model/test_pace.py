"""Masses and radii that do not fit each other."""

import itertools
import math
import time
from dataclasses import replace

import pytest

from rans import Thruster
from rans.model.pace import misfits, seconds_for_a_metre
from tests.support.engines import PLATFORM


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({}, 0),
        ({"radius": 310.0}, 1),
        ({"radius": 0.00031}, 2),
        ({"inertia": ((20.0, 0.0, 0.0), (0.0, 20.0, 0.0), (0.0, 0.0, 20.0))}, 1),
        # In kg cm^2, with the radius of a ball that has it.
        ({"inertia": ((2e3, 0.0, 0.0), (0.0, 2e3, 0.0), (0.0, 0.0, 2e3)), "radius": 30.0}, 1),
        ({"centre_of_mass": (0.35, 0.0, 0.0)}, 1),
        ({"mass": 1000.0 * PLATFORM.mass}, 1),
        # All in grams, with the inertia that belongs to it.
        (
            {
                "mass": 1000.0 * PLATFORM.mass,
                "inertia": tuple(tuple(1000.0 * x for x in row) for row in PLATFORM.inertia),
            },
            1,
        ),
        # Forces in mN: 532 m/s^2.
        ({"thrusters": tuple(replace(t, force=1000.0) for t in PLATFORM.thrusters)}, 1),
    ],
)
def test_a_body_fits_its_radius(changes, expected):
    assert len(misfits(replace(PLATFORM, **changes))) == expected


def test_the_force_of_a_ring_of_many_thrusters_is_found_at_once():
    """N unit forces spread evenly over all directions: those that point to one side add up to N / pi."""
    count = 1000
    angles = [2.0 * math.pi * k / count for k in range(count)]
    ring = tuple(
        Thruster(
            (math.cos(a), math.sin(a), 0.0), (-sign * math.sin(a), sign * math.cos(a), 0.0), 1.0
        )
        for a, sign in zip(angles, itertools.cycle((1.0, -1.0)), strict=False)
    )
    begun = time.process_time()
    found = seconds_for_a_metre(replace(PLATFORM, thrusters=ring))
    assert time.process_time() - begun < 10.0  # all pairs of them would take a gigabyte and minutes
    by_hand = 2.0 * math.sqrt(PLATFORM.mass * math.pi / count)
    assert found == pytest.approx(by_hand, rel=1e-4)  # a sum in place of an integral: 1 / N^2
