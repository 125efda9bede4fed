"""Optimal trajectories and certified commands as arrays and flights."""

from dataclasses import replace

import numpy as np
import pytest

import rans
from rans import ConfigError


def test_a_bound_without_commands_says_so():
    """At the goal none are needed."""
    found = rans.certify(start=rans.state((0.0, 0.0)), goal=rans.state((0.0, 0.0)))
    assert found.lower == 0.0
    with pytest.raises(ConfigError, match="no on/off commands"):
        found.replay()


def test_commands_have_the_instants_and_states_of_their_periods():
    """Two periods of 0.5 s with all valves open, which push and turn nothing."""
    start = rans.state((0.0, 0.0))
    none = rans.certify(start=start, goal=start, control_period=0.5)
    found = replace(none, commands=[[1] * 8] * 2)
    assert found.t.tolist() == [0.0, 0.5, 1.0]
    assert found.u.shape == (2, 8)
    np.testing.assert_allclose(found.x, np.zeros((3, 6)), atol=1e-12)
