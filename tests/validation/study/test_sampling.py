"""States, commands and differences between motions, by hand."""

from __future__ import annotations

import math
import warnings
from typing import Any

import numpy as np
import pytest

from rans.flight import fly
from rans.model.dynamics import PlanarState, SpatialState
from rans.model.fields import Heading, Quat, Vec2, Vec3
from rans.model.spacecraft import Spacecraft, Thruster
from rans.model.spacecraft_file import load_spacecraft
from rans.model.timing import Timing
from rans.scenario import scenarios
from rans.tasks import GoToPose
from tests.support.crafts import nasty_planar, nasty_spatial
from tests.support.states import spatial
from validation.study.sampling import (
    Restless,
    gap_checks,
    gaps,
    gentle_commands,
    growth,
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
def test_long_ways_loosen_in_proportion(way: float, factor: float) -> None:
    """10 m and less count as they are, 25 m two and a half times."""
    assert reach(planar([0.0, -way])) == factor


def test_gaps_in_the_plane() -> None:
    """3 and 4 m are 5 m; a heading of 179 degrees and one of -179 differ by 2."""
    a = PlanarState(Vec2(1.0, 1.0), Heading(math.radians(179)), Vec2(0.5, 0.0), 0.3)
    b = PlanarState(Vec2(4.0, 5.0), Heading(math.radians(-179)), Vec2(0.5, -0.25), -0.1)
    found = gaps(a, b)
    assert {name: float(value) for name, value in found.items()} == pytest.approx(
        {"position": 5.0, "attitude": math.radians(2), "velocity": 0.25, "spin": 0.4}
    )


def test_gaps_in_space() -> None:
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


def test_the_worst_is_named() -> None:
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


def test_growth_is_of_the_worst_flight_at_every_instant() -> None:
    ours = planar([[0.0, 0.0], [0.1, -0.3], [0.5, 0.2]], angle=[[0.0, 0.0], [0.0, 0.2], [0.0, 0.0]])
    position, attitude = growth("ours", ours, planar(np.zeros((3, 2))), Timing(control_period=0.5))
    assert (position.figure, position.name) == ("position error over time", "ours")
    assert position.x == (0.0, 0.5, 1.0)
    assert position.y == pytest.approx((0.0, 0.3, 0.5))
    assert attitude.figure == "attitude error over time"
    assert attitude.y == pytest.approx((0.0, 0.2, 0.0))


def test_random_states_fill_their_ranges() -> None:
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


def test_commands_of_a_gentle_craft_are_on_off_and_between() -> None:
    commands = gentle_commands(couple(1.0), 5, 400)
    assert set(commands[::2].ravel()) == {0.0, 1.0}
    between = commands[1::2]
    assert 0.0 < between.min() < 0.02 < 0.98 < between.max() < 1.0
    assert 0.4 < commands[::2].mean() < 0.6


@pytest.mark.parametrize(("force", "scale"), [(9.9, 1.0), (10.0, 1.0), (40.0, 0.25)])
def test_commands_of_a_strong_craft_are_scaled_to_10_rad_per_s2(force: float, scale: float) -> None:
    """One thruster of F newtons at 0.5 m turns 0.5 kg m^2 by F rad/s^2; the other the other way."""
    assert gentle_commands(couple(force), 5, 50)[::2].max() == pytest.approx(scale)


def test_at_the_goal_a_restless_controller_is_wrong_one_time_in_twenty() -> None:
    craft = nasty_planar()
    state = planar(np.zeros(4000))
    opened = Restless(craft, 3).act(state, state, np.zeros(0))
    # 20,000 decisions: a standard deviation is 0.0015.
    assert opened.mean() == pytest.approx(0.05, abs=0.006)


@pytest.mark.parametrize(
    ("craft", "share", "least", "most"),
    [
        (nasty_planar(), 0.5, 0.02, 0.4),
        pytest.param(nasty_spatial(), 0.0, 0.3, 0.7, marks=pytest.mark.slow),
    ],
    ids=["plane", "space"],
)
def test_a_restless_controller_stays_near_the_goal(
    craft: Spacecraft, share: float, least: float, most: float
) -> None:
    """As the layers ask that fly it: all its flights stay within 10 m, and it never falls silent."""
    starts = scenarios(GoToPose(), craft, 1, 4)
    flight = fly(craft, GoToPose(), Restless(craft, 1, share), starts, Timing())
    assert reach(flight.states) == 1.0
    assert least < flight.commands.mean() < most
    assert (flight.commands[-25:].max(axis=(0, 2)) > 0).all()


def test_valves_that_pulse_are_opened_by_quarters() -> None:
    craft = load_spacecraft("atmos")
    state = planar(np.full(200, -3.0))
    opened = Restless(craft, 3).act(state, planar(np.zeros(200)), np.zeros(0))
    assert set(opened.ravel()) == {0.0, 0.25, 0.5, 0.75, 1.0}
