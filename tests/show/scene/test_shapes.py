"""Shapes of the scene that Drake has no class for."""

from __future__ import annotations

import math

import pytest
from pydrake.geometry import Rgba
from pydrake.math import RigidTransform

from rans.show.scene.craft import Part
from rans.show.scene.shapes import frustum
from tests.support.drawings import volume


@pytest.mark.parametrize("sides", [8, 20])
def test_a_frustum_is_closed_and_looks_outwards(sides: int) -> None:
    """Its volume is that of a pyramid cut off; numbers in a mesh have five digits."""
    area = 0.5 * sides * math.sin(2.0 * math.pi / sides)  # of a polygon in a circle of radius 1
    whole = area * 0.6 / 3.0 * (0.09 + 0.03 + 0.01)
    assert volume(
        Part("one", frustum(0.3, 0.1, 0.6, sides=sides), Rgba(), RigidTransform())
    ) == pytest.approx(whole, rel=1e-4)
