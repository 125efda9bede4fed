"""States, commands and differences between motions, by hand."""

from __future__ import annotations

import math
import warnings
from typing import Any

import numpy as np
import pytest

from rans import Spacecraft, Thruster
from rans.model.dynamics import PlanarState, SpatialState
from rans.model.fields import Heading, Quat, Vec2, Vec3
from tests.support.states import spatial
from tests.support.torquer import TURNED
from validation.study.sampling import (
    Restless,
    gap_checks,
    gaps,
    random_states,
    reach,
)

SPHERE = ((0.5, 0.0, 0.0), (0.0, 0.5, 0.0), (0.0, 0.0, 0.5))


def planar(x: Any, angle: Any = 0.0, vx: Any = 0.0, w: Any = 0.0) -> PlanarState:
    """Of arrays, along x."""
    x, angle, vx, w = np.broadcast_arrays(
        *(np.asarray(value, dtype=float) for value in (x, angle, vx, w))
    )
    nothing = np.zeros(x.shape)
    return PlanarState(Vec2(x, nothing), Heading(angle), Vec2(vx, nothing), w)


def couple(force: float, arm: float = 0.5) -> Spacecraft:
    """2 kg and 0.5 kg m^2; two thrusters along x that turn it one way and the other."""
    nozzles = tuple(Thruster((0.0, y, 0.0), (1.0, 0.0, 0.0), force) for y in (-arm, arm))
    with warnings.catch_warnings(action="ignore"):  # that it cannot be steered does not matter
        return Spacecraft("couple", 2, 2.0, SPHERE, nozzles)


@pytest.mark.parametrize(("way", "factor"), [(3.0, 1.0), (10.0, 1.0), (25.0, 2.5)])
def test_long_ways_loosen_in_proportion(way, factor):
    """10 m and less count as they are, 25 m two and a half times."""
    assert reach(planar([0.0, -way])) == factor


def test_whatever_has_commands_is_commanded():
    """Thrusters, and a torquer from -1 to 1."""
    start = random_states(2, 0, 5)
    flown = Restless(TURNED, 0).act(start, start, np.zeros((5, 1)))
    assert flown.shape == (5, len(TURNED.commands))
    assert len({*flown[:, -1]}) == 5


def test_gaps_in_the_plane():
    """3 and 4 m are 5 m; a heading of 179 degrees and one of -179 differ by 2."""
    a = PlanarState(Vec2(1.0, 1.0), Heading(math.radians(179)), Vec2(0.5, 0.0), 0.3)
    b = PlanarState(Vec2(4.0, 5.0), Heading(math.radians(-179)), Vec2(0.5, -0.25), -0.1)
    found = gaps(a, b)
    assert {name: float(value) for name, value in found.items()} == pytest.approx(
        {"position": 5.0, "attitude": math.radians(2), "velocity": 0.25, "spin": 0.4}
    )


def test_gaps_in_space():
    """Quaternions of either sign are the same attitude; 60 degrees about y are 60 degrees."""
    half = math.radians(30)
    a = spatial((1.0, 2.0, 3.0), attitude=(-1.0, 0.0, 0.0, 0.0), w=(1.0, 0.0, 0.0))
    b = SpatialState(
        Vec3(3.0, 3.0, 1.0),
        Quat(math.cos(half), 0.0, math.sin(half), 0.0),
        Vec3(0.0, 0.0, 7.0),
        Vec3(1.0, 0.6, 0.8),
    )
    assert {name: float(value) for name, value in gaps(a, b).items()} == pytest.approx(
        {"position": 3.0, "attitude": math.radians(60), "velocity": 7.0, "spin": 1.0}
    )


def test_the_worst_is_named():
    """Of states the third; of flights the first, in its fourth control period."""
    ours = planar([0.0, 0.1, -0.5, 0.2])
    position, *others = gap_checks("layer", ours, planar(np.zeros(4)), 0.4, "Because.")
    assert (position.name, position.value, position.unit) == ("layer: position", 0.5, "m")
    assert (position.worst, position.passed) == ("state 2", False)
    assert [check.unit for check in others] == ["rad", "m/s", "rad/s"]
    flown = np.zeros((5, 3))
    flown[3, 0] = 2.0
    flown[4, 2] = 1.0
    position, *_ = gap_checks("layer", planar(flown), planar(np.zeros((5, 3))), 1.0, "")
    assert position.worst == "flight 0, period 3"


def test_random_states_fill_their_ranges():
    """Of a thousand the largest are within some percent of the bounds, and signs are even."""
    for dimension in (2, 3):
        states = random_states(dimension, 3, 1000)  # type: ignore[arg-type]
        for size, most in (
            (states.p.norm(), 5.0),
            (states.v.norm(), 1.0),
            (np.linalg.norm(np.array(states.spin()), axis=0), 1.0),
        ):
            assert 0.95 * most < size.max() <= most
            assert size.min() < 0.05 * most
        assert 400 < (np.array(states.spin())[0] > 0).sum() < 600  # 6 standard deviations of 500
        assert (
            states.attitude.to(random_states(dimension, 4, 1000).attitude).magnitude().max() > 3.0
        )
