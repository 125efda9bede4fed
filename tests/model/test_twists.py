"""Twists that all thrusters give together, against linear programs."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rans.model.authority import authorities
from rans.model.spacecraft_file import load_spacecraft
from rans.model.twists import balanced


@pytest.mark.parametrize(
    "name",
    [
        "astrobee-granite",
        "floating-platform",
        "floating-platform-shared",
        "freeflyer2",
        "atmos-orbit-16",
        "free-flyer-shared",
        "spheres",
        "cubesat-3u",
    ],
)
def test_balanced_authority_is_that_of_linear_programs(name: str) -> None:
    craft = load_spacecraft(name)
    columns = np.array(craft.wrench_map)
    # A wheel is a column of torque either way.
    torques = np.array(craft.wheel_map).reshape(-1, craft.degrees_of_freedom - craft.dimension)
    turning = np.column_stack([np.zeros((len(torques), craft.dimension)), torques])
    columns = np.vstack([columns, turning, -turning])
    found = balanced(columns, craft.thrust_sharing == "split")
    expected = [x for one in authorities(craft) for x in (one.forwards, one.backwards)]
    assert found == pytest.approx(expected, rel=1e-6)


def test_a_craft_that_cannot_push_alone_has_no_authority() -> None:
    tangential = np.array([[1.0, 0.0, 0.3], [0.0, 1.0, 0.3], [-1.0, 0.0, 0.3], [0.0, -1.0, 0.3]])
    assert math.isclose(balanced(tangential)[5], 0.0, abs_tol=1e-12)
