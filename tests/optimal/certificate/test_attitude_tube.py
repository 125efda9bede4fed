"""Bounds of transfers to rest: close to optima worked by hand and to a linear program, and below random flights."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import linprog
from scipy.spatial.transform import Rotation

from campaigns import bounds as random_craft
from rans.errors import ConfigError
from rans.model.dynamics import PlanarState, SpatialState
from rans.model.fields import Heading, Quat, Vec2, Vec3
from rans.model.spacecraft import Propellant, Spacecraft, Thruster
from rans.model.spacecraft_file import load_spacecraft
from rans.optimal.certificate import attitude_tube, hull
from rans.optimal.certificate.goal_set import GoalSet

EXACT = GoalSet(0.0, 0.0, 0.0, 0.0)
PINGU = load_spacecraft("pingu")
CLOSE = 0.004
"""Relative: 0.1 % of the bisection, and the tube of forty intervals."""


def _planar(x: float = 0.0, y: float = 0.0, heading: float = 0.0) -> PlanarState:
    return PlanarState(Vec2(x, y), Heading(heading), Vec2(0.0, 0.0), 0.0)


def _fixed() -> Spacecraft:
    """A craft of 12 kg with 1 N along each axis of B, which cannot turn."""
    ways = ((1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, -1.0, 0.0))
    inertia = ((0.1, 0.0, 0.0), (0.0, 0.1, 0.0), (0.0, 0.0, 0.1))
    return Spacecraft("fixed", 2, 12.0, inertia, tuple(Thruster((0, 0, 0), w, 1.0) for w in ways))


def test_least_time_of_a_craft_that_cannot_turn_is_that_of_its_axis() -> None:
    # 2 sqrt(m d / F) along x; the hull bound turns the diagonal force of 1.41 N there.
    goal = _planar(1.0)
    bound = attitude_tube.least_time(_fixed(), _planar(), goal, EXACT)
    optimum = 2.0 * math.sqrt(12.0)
    assert optimum * (1.0 - CLOSE) < bound < optimum
    assert hull.least_time(
        _fixed(), ("position", "velocity"), _planar(), goal, EXACT
    ) == pytest.approx(optimum / 2.0**0.25)


def test_least_impulse_of_a_straight_way_is_two_burns() -> None:
    # Burns of t at both ends: F t (T - t) = m d, with T = 10 s.
    burn = 5.0 - math.sqrt(25.0 - 12.0)
    bound = attitude_tube.least_impulse(_fixed(), _planar(), _planar(1.0), 10.0, EXACT)
    assert 2.0 * burn * (1.0 - CLOSE) < bound < 2.0 * burn


@pytest.mark.slow
def test_least_time_of_a_turn_includes_wheels() -> None:
    # Four thrusters of 1.75 N at 0.2388427 m and a wheel of 0.1 N m turn 0.5 kg m^2 by one radian.
    torque = 4.0 * 1.75 * 0.2388427 + 0.1
    optimum = 2.0 * math.sqrt(0.5 / torque)
    bound = attitude_tube.least_time(PINGU, _planar(), _planar(heading=1.0), EXACT)
    assert optimum * (1.0 - CLOSE) < bound < optimum


def test_the_hull_bound_of_a_turn_includes_wheels() -> None:
    # A turn about one axis is a double integrator, for which the bound is the optimum; the wheel has no price.
    torque = 4.0 * 1.75 * 0.2388427 + 0.1
    turn = _planar(), _planar(heading=1.0)
    aims = ("attitude", "spin")
    bound = hull.least_time(PINGU, aims, *turn, EXACT)
    assert bound == pytest.approx(2.0 * math.sqrt(0.5 / torque), rel=1e-6)
    assert hull.least_fuel(PINGU, aims, *turn, 20.0, EXACT) == 0.0
    # In space nothing is claimed of a turn with wheels.
    start = SpatialState(Vec3(0, 0, 0), Quat(1, 0, 0, 0), Vec3(0, 0, 0), Vec3(0, 0, 0))
    half: Any = replace(start, attitude=Quat(0, 0, 0, 1))
    assert hull.least_time(load_spacecraft("cubesat-3u"), aims, start, half, EXACT) == 0.0


@pytest.mark.slow
def test_wheels_turn_without_impulse() -> None:
    turn = _planar(heading=1.0)
    assert attitude_tube.least_impulse(PINGU, _planar(), turn, 20.0, EXACT) == 0.0
    # Without them two couples: torque t (T - t) = I angle, at 2 t F per couple of arm 0.2388427 m.
    bare = replace(PINGU, wheels=())
    torque = 4.0 * 1.75 * 0.2388427
    burn = 10.0 - math.sqrt(100.0 - 0.5 / torque)
    optimum = 2.0 * burn * 4.0 * 1.75
    bound = attitude_tube.least_impulse(bare, _planar(), turn, 20.0, EXACT)
    assert optimum * (1.0 - CLOSE) < bound < optimum


def test_linear_program_of_an_oblique_transfer_agrees() -> None:
    # An independent program: forces held for 0.04 s, exact sums of a double integrator in W.
    steps = 200
    horizon = 8.0
    period = horizon / steps
    signs = np.array([[1.0, -1.0, 0.0, 0.0], [0.0, 0.0, 1.0, -1.0]]) / 12.0
    left = horizon - period * (np.arange(steps) + 0.5)
    speed = np.concatenate([signs * period] * steps, axis=1)
    way = np.concatenate([signs * period * t for t in left], axis=1)
    answer = linprog(
        np.full(4 * steps, period),
        A_eq=np.vstack([way, speed]),
        b_eq=[1.0, 0.6, 0.0, 0.0],
        bounds=(0.0, 1.0),
    )
    bound = attitude_tube.least_impulse(_fixed(), _planar(), _planar(1.0, 0.6), horizon, EXACT)
    assert answer.fun * (1.0 - CLOSE) < bound < answer.fun * (1.0 + 1e-9)


def test_half_turn_in_space_is_in_the_tube() -> None:
    # A ball-like craft that may turn at once and one that cannot: the tube lies between them.
    craft = load_spacecraft("spheres")
    start = SpatialState(Vec3(0, 0, 0), Quat(1, 0, 0, 0), Vec3(0, 0, 0), Vec3(0, 0, 0))
    goal: Any = replace(start, p=Vec3(1.0, 1.0, 0.5))
    bound = attitude_tube.least_time(craft, start, goal, EXACT)
    free = hull.least_time(craft, ("position", "velocity"), start, goal, EXACT)
    fixed = 2.0 * math.sqrt(4.616 * 1.0 / 0.224)  # each axis by itself, without turning
    assert free * (1.0 - CLOSE) < bound < fixed


def test_spinning_wheels_do_not_turn_a_craft_out_of_its_tube() -> None:
    """Unequal moments and fast wheels: |J w| of the body grows faster than by the torque, and the angle does not.

    The equations are the same backwards in time, so that this is also the way to the goal.
    """
    moments = np.array([1.0, 3.0, 3.5])
    craft = load_spacecraft("cubesat-3u")
    craft = replace(craft, inertia=_diagonal(moments))
    largest = attitude_tube._corners(craft)[1]
    time, steps = 1.0 / math.sqrt(largest), 1200  # turns by half a radian at most
    h = time / steps
    torque = largest * np.array([1.0, 0.0, 0.0])
    # Momentum that exchanges the spins about x and y once in five quarters of the time.
    wheels = np.array([0.0, 0.0, 2.5 * math.sqrt(moments[0] * moments[1]) / time])

    def rate(w: np.ndarray) -> np.ndarray:
        return (torque - np.cross(w, moments * w + wheels)) / moments

    w = np.zeros(3)
    attitudes = [Rotation.identity()]
    growth = 0.0
    for k in range(steps):
        half = w + 0.5 * h * rate(w)
        attitudes.append(attitudes[-1] * Rotation.from_rotvec(h * half))
        w = w + h * rate(half)
        growth = max(growth, float(np.linalg.norm(moments * w)) / (largest * h * (k + 1)))
    assert growth > 1.2
    # Forwards and backwards: every attitude is in the tubes of the intervals on both sides.
    start = SpatialState(Vec3(0, 0, 0), Quat(1, 0, 0, 0), Vec3(0, 0, 0), Vec3(0, 0, 0))
    x, y, z, real = map(float, attitudes[-1].as_quat())
    goal: Any = replace(start, attitude=Quat(real, x, y, z), w=Vec3(*map(float, w)))
    back: Any = replace(goal, w=goal.w.scale(-1.0))
    edges = attitudes[:: steps // attitude_tube._INTERVALS]
    for ends, way in (((start, goal), edges), ((back, start), edges[::-1])):
        transfer = attitude_tube._transfer(craft, *ends, time, EXACT, 0)
        assert transfer is not None
        for centre, width, *both in zip(
            transfer.centre, transfer.width, way[:-1], way[1:], strict=True
        ):
            middle = Rotation.from_matrix(centre).inv()
            assert max((middle * one).magnitude() for one in both) <= width * (1.0 + 1e-6) + 1e-6


def _diagonal(moments: np.ndarray) -> Any:
    return tuple(tuple(row) for row in np.diag(moments).tolist())


def test_what_is_not_covered_is_refused() -> None:
    tank = replace(PINGU, propellant=Propellant(1.0, 60.0))
    with pytest.raises(ConfigError, match="propellant"):
        attitude_tube.least_time(tank, _planar(), _planar(1.0), EXACT)
    with pytest.raises(ConfigError, match="at rest"):
        attitude_tube.least_time(PINGU, _planar(), _planar(1.0), GoalSet(0.0, 0.1, 0.0, 0.0))
    with pytest.raises(ConfigError, match="horizon"):
        attitude_tube.least_impulse(PINGU, _planar(), _planar(1.0), 0.0, EXACT)


@pytest.mark.slow
@pytest.mark.parametrize("dimension", [2, 3])
def test_no_random_flight_is_below_its_bound(dimension: int) -> None:
    random = np.random.default_rng(5 + dimension)
    flown = 0
    while flown < 4:
        craft = random_craft.random_craft(random)
        flight = random_craft._flight(craft, random) if craft.dimension == dimension else None
        if flight is None:
            continue
        start, goal, spent, steps = flight
        time = steps * random_craft._PERIOD
        bound = attitude_tube.least_impulse(craft, start, goal, time, EXACT)
        assert bound <= spent * (1.0 + 1e-9) + 1e-9
        # Neither is this flight excluded, which is what a least time rests on.
        assert not attitude_tube._excluded(craft, start, goal, time, EXACT)
        # A goal set that allows motion: no sooner instant hides the one of this flight.
        loose = GoalSet(0.02, 0.05, 0.05, 0.05)
        period = random_craft._PERIOD
        assert attitude_tube.least_arrival(craft, start, goal, period, loose, period) <= time
        flown += 1
