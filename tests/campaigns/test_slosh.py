"""The craft of the campaign on slosh."""

from __future__ import annotations

import pytest

import rans
from campaigns.slosh import with_slosh
from tests.support.effector_crafts import EXAMPLES
from tests.support.slosh import slosh_of


def test_a_share_of_the_mass_swings_and_the_whole_stays() -> None:
    rigid = rans.load_spacecraft("atmos")
    craft = with_slosh(rigid, 0.2)
    slosh = slosh_of(craft)
    assert slosh.mass == pytest.approx(0.2 * rigid.mass)
    assert (craft.mass, craft.inertia) == (rigid.mass, rigid.inertia)
    assert with_slosh(rigid, 0.0) == rigid


def test_the_example_is_the_platform_with_a_tenth_of_its_mass_in_a_tank() -> None:
    craft = rans.load_spacecraft(EXAMPLES / "sloshing-platform.toml")
    expected = with_slosh(rans.load_spacecraft("floating-platform"), 0.1)
    assert craft.mass == expected.mass
    for key in ("mass", "length", "hinge", "direction", "damping"):
        ours = getattr(slosh_of(craft), key)
        assert ours == pytest.approx(getattr(slosh_of(expected), key), rel=1e-5, abs=1e-9)
