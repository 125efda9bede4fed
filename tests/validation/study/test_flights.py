import numpy as np
import pytest

from rans import Timing
from rans.model.dynamics import PlanarState
from rans.model.fields import Heading, Vec2
from rans.model.spacecraft_file import load_spacecraft
from tests.support.states import planar, spatial
from validation.study import flights
from validation.study.checks import Check


def test_long_ways_loosen_in_proportion():
    """25 m is two and a half times 10 m; in space a thousand times as much is allowed as in the plane."""
    plane = planar(25.0)
    space = spatial((0.0, 0.0, -25.0))
    assert flights._agreement(plane) == pytest.approx(2.5e-9)
    assert flights._agreement(space) == pytest.approx(2.5e-6)


def test_drakes_own_error_is_found_by_halving_its_step(monkeypatch):
    """A judge whose error is its step's length, in x: 0.01 m against 0.005 m, which is too much."""

    def judged(*arguments):
        x = np.zeros((6, 1))
        return PlanarState(Vec2(x + arguments[-1], x), Heading(x), Vec2(x, x), x)

    monkeypatch.setattr(flights, "Timing", lambda: Timing(episode_steps=5))
    monkeypatch.setattr(flights, "drake_states", judged)
    checks = [
        c
        for c in flights.flight_checks(load_spacecraft("floating-platform"), 1, 1)
        if isinstance(c, Check)
    ]
    own = next(c for c in checks if c.name == "Drake's own error: position")
    assert own.value == pytest.approx(0.005)
    assert not own.passed
