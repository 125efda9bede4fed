"""Optimal trajectories and certified commands as arrays and flights."""

import numpy as np
import pytest

import rans
from rans import ConfigError


@pytest.mark.slow
def test_certified_commands_fly_into_the_goal_set():
    """In both engines, as long as the time that the bound proves least; what they need is what was found."""
    found = rans.certify("go-to-pose", start=3, control_period=0.5)
    assert found.t[-1] == found.upper == 5.5
    assert set(np.unique(found.u)) <= {0.0, 1.0}
    for engine in ("fast", "drake"):
        flight = found.replay(engine)  # type: ignore[arg-type]
        errors = flight.errors()
        assert errors["position"][-1, 0] <= 0.05
        assert np.degrees(errors["attitude"][-1, 0]) <= 5.0
    apart = found.replay("fast").states.p - found.replay("drake").states.p
    assert np.abs(apart.x).max() < 1e-9


def test_a_bound_without_commands_says_so():
    """At the goal none are needed."""
    found = rans.certify(start=rans.state((0.0, 0.0)), goal=rans.state((0.0, 0.0)))
    assert found.lower == 0.0
    with pytest.raises(ConfigError, match="no on/off commands"):
        found.replay()
