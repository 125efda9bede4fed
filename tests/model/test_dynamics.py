"""The equations of motion against analysis and SciPy; Drake's verdict is in tests/reference."""

from dataclasses import replace

import pytest

from rans.model.body import Body
from rans.model.dynamics import thrust


def test_nozzles_take_pressure_from_their_own_supply_only(planar_craft):
    """A droop of 0.5: two open nozzles have 1 / 1.5 of their force each, one and a half 1 / 1.25, one all of it."""
    fed = tuple(
        replace(thruster, supply=supply)
        for thruster, supply in zip(planar_craft.thrusters, (4, 4, 4, 7, 7), strict=True)
    )
    craft = replace(planar_craft, thrusters=fed)
    assert craft.supplies == ((0, 1, 2), (3, 4))
    body = replace(Body.of(craft), droop=0.5)
    assert thrust(craft, (1.0, 1.0, 0.0, 1.0, 0.5), body) == pytest.approx(
        (2 / 3, 2 / 3, 0.0, 0.8, 0.4), abs=1e-15
    )
    # A nozzle that is stuck open takes from its own supply too.
    stuck = replace(body, gain=(1.0, 1.0, 0.0, 1.0, 1.0), leak=(0.0, 0.0, 1.0, 0.0, 0.0))
    assert thrust(craft, (1.0, 0.0, 0.0, 1.0, 0.0), stuck) == pytest.approx(
        (2 / 3, 0.0, 2 / 3, 1.0, 0.0), abs=1e-15
    )
    # One supply for all has four nozzles' worth and a half open: 1 / (1 + 0.5 * 2.5).
    single = replace(Body.of(planar_craft), droop=0.5)
    assert thrust(planar_craft, (1.0, 1.0, 0.0, 1.0, 0.5), single)[0] == pytest.approx(1 / 2.25)
