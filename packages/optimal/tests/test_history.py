"""Optimal trajectories and certified commands as arrays and flights."""

from dataclasses import replace

import numpy as np
import pytest

import rans
from rans import ConfigError


@pytest.mark.slow
def test_certified_commands_fly_into_the_goal_set():
    """In Drake, as long as the time that the bound proves least; the engines' states are the same."""
    found = rans.certify("go-to-pose", start=3, control_period=0.5)
    assert found.t[-1] == found.upper == 5.5
    assert set(np.unique(found.u)) <= {0.0, 1.0}
    flight = found.replay()
    errors = flight.errors()
    assert errors["position"][-1, 0] <= 0.05
    assert np.degrees(errors["attitude"][-1, 0]) <= 5.0
    apart = found.x[:, :2] - np.hstack(flight.states.p.columns())
    assert np.abs(apart).max() < 1e-9


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
