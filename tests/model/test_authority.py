"""The largest force and torque along each axis, against numbers worked by hand."""

import numpy as np
import pytest

from rans.model.authority import authorities
from rans.model.spacecraft_file import load_spacecraft
from tests.support.crafts import point

BY_HAND = {
    # Two thrusters either way along an axis, the four of one way about z.
    "atmos": [3.0, 3.0, 0.72],
    "freeflyer2": [0.4, 0.4, 4 * 0.2 * 0.11461],
    "spheres": [0.224] * 3 + [2 * 0.112 * 0.0965] * 3,
    # One thruster's worth in all: along x a half each of 1 N at 45 degrees; all of it about z, and the wheel.
    "roboran-platform": [np.sqrt(0.5), np.sqrt(0.5), 0.31 + 0.1],
    # Nothing but wheels turns it.
    "afrl-12kg": [1.0] * 3 + [0.0074333] * 3,
    "afrl-deputy": [1.0] * 3 + [0.0] * 3,
}


@pytest.mark.parametrize("name", BY_HAND)
def test_authority_by_hand(name):
    found = authorities(load_spacecraft(name))
    assert [one.forwards for one in found] == pytest.approx(BY_HAND[name], rel=1e-6)
    assert [one.backwards for one in found] == pytest.approx(BY_HAND[name], rel=1e-6)


def test_acceleration_is_that_of_the_weaker_way():
    """Thrusters of 1 N at 90, 210 and 330 degrees on 4 kg: up 1 N; down, where two at 30 degrees balance, 1 N;
    along x sqrt(3) / 2 of one, and the others take its fall along y back."""
    found = authorities(point())
    assert [one.forwards for one in found[:2]] == pytest.approx([np.sqrt(3) / 2, 1.0])
    assert found[0].acceleration == pytest.approx(np.sqrt(3) / 8)
    assert (found[2].forwards, found[2].acceleration) == (0.0, 0.0)
