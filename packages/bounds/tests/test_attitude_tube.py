"""Bounds of transfers: close to optima worked by hand and to a linear program, and below random flights."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from rans_bounds import attitude_tube, hull
from rans_bounds.goal_set import GoalSet
from scipy.optimize import linprog
from scipy.spatial.transform import Rotation

from rans import Spacecraft, Thruster
from rans.model.fields import Heading, Quat, Vec3
from rans.model.spacecraft_file import load_spacecraft
from tests.support.bounded_flights import PERIOD, flight, random_craft
from tests.support.states import planar, spatial

EXACT = GoalSet(0.0, 0.0, 0.0, 0.0)
PINGU = load_spacecraft("pingu")
CLOSE = 0.004
"""Relative: the cutting planes, and the tube of forty intervals."""


def _fixed() -> Spacecraft:
    """A craft of 12 kg with 1 N along each axis of B, which cannot turn."""
    ways = ((1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, -1.0, 0.0))
    inertia = ((0.1, 0.0, 0.0), (0.0, 0.1, 0.0), (0.0, 0.0, 0.1))
    return Spacecraft("fixed", 2, 12.0, inertia, tuple(Thruster((0, 0, 0), w, 1.0) for w in ways))


def _check_least_time(craft: Spacecraft, start: Any, goal: Any, optimum: float) -> None:
    """Flights a little shorter are excluded, and those as long are not."""
    assert attitude_tube._excluded(craft, start, goal, optimum * (1.0 - CLOSE), EXACT)
    assert not attitude_tube._excluded(craft, start, goal, optimum * (1.0 + 1e-9), EXACT)


def test_least_time_of_a_craft_that_cannot_turn_is_that_of_its_axis():
    # 2 sqrt(m d / F) along x; the hull bound turns the diagonal force of 1.41 N there.
    goal = planar(1.0)
    optimum = 2.0 * math.sqrt(12.0)
    _check_least_time(_fixed(), planar(), goal, optimum)
    assert hull.least_time(
        _fixed(), ("position", "velocity"), planar(), goal, EXACT
    ) == pytest.approx(optimum / 2.0**0.25)


def test_the_hull_bound_of_a_turn_includes_wheels():
    # A turn about one axis is a double integrator, for which the bound is the optimum; the wheel has no price.
    torque = 4.0 * 1.75 * 0.2388427 + 0.1
    turn = planar(), planar(heading=1.0)
    aims = ("attitude", "spin")
    bound = hull.least_time(PINGU, aims, *turn, EXACT)
    assert bound == pytest.approx(2.0 * math.sqrt(0.5 / torque), rel=1e-6)
    assert hull.least_fuel(PINGU, aims, *turn, 20.0, EXACT) == 0.0
    # In space nothing is claimed of a turn with wheels.
    start = spatial()
    half = replace(start, attitude=Quat(0, 0, 0, 1))
    assert hull.least_time(load_spacecraft("cubesat-3u"), aims, start, half, EXACT) == 0.0


def test_linear_program_of_an_oblique_transfer_agrees():
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
    bound = attitude_tube.least_impulse(_fixed(), planar(), planar(1.0, 0.6), horizon, EXACT)
    assert answer.fun * (1.0 - CLOSE) < bound < answer.fun * (1.0 + 1e-9)


def test_spinning_wheels_do_not_turn_a_craft_out_of_its_tube():
    """Unequal moments and fast wheels: |J w| of the body grows faster than by the torque, and the angle does not.

    The equations are the same backwards in time, so that this is also the way to the goal.
    """
    moments = np.array([1.0, 3.0, 3.5])
    craft = load_spacecraft("cubesat-3u")
    craft = replace(craft, inertia=_diagonal(moments))
    # The largest rate of the root of twice the energy, here by a torque about the axis of moment 1.
    largest = attitude_tube._measures(craft)[0].largest
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
    start = spatial()
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


_BALL = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
"""Moments of inertia of 1 kg m^2."""
_AT_REST = spatial()


def _turning(main: bool) -> Spacecraft:
    """A craft of 10 kg in space with couples of 0.05 N m about z, and perhaps 1 N along x."""
    couples = tuple(
        Thruster((0.5 * side, 0.0, 0.0), (0.0, side * sense, 0.0), 0.05)
        for sense in (1.0, -1.0)
        for side in (1.0, -1.0)
    )
    ahead = (Thruster((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), 1.0),) if main else ()
    return Spacecraft("turning", 3, 10.0, _BALL, ahead + couples)


@pytest.mark.filterwarnings("ignore:.* cannot push and turn")
def test_a_turn_in_space_is_speeding_up_and_slowing_down():
    goal = replace(_AT_REST, attitude=Quat(math.cos(1.0), 0, 0, math.sin(1.0)))
    # Two radians with 0.05 rad/s^2.
    optimum = 2.0 * math.sqrt(2.0 / 0.05)
    _check_least_time(_turning(False), _AT_REST, goal, optimum)
    # In 20 s: 0.05 t (20 - t) = 2, and both thrusters of a couple are open for 2 t.
    burn = 10.0 - math.sqrt(60.0)
    least = attitude_tube.least_impulse(_turning(False), _AT_REST, goal, 20.0, EXACT)
    assert 0.2 * burn * (1.0 - CLOSE) < least < 0.2 * burn


@pytest.mark.filterwarnings("ignore:.* cannot push and turn")
def test_a_turn_on_the_way_has_its_price():
    """A craft with one engine ahead that ends in its first attitude has to turn half round, brake and turn back."""
    # Couples for 5 s to 0.25 rad/s: half a turn and both of their burns last pi / 0.25 + 5 s.
    turn = math.pi / 0.25 + 5.0
    goal = replace(_AT_REST, p=Vec3(0.4 * (4.0 + turn), 0.0, 0.0))
    time = 8.0 + 2.0 * turn
    spent = 8.0 + 20.0 * 0.1
    bound = attitude_tube.least_impulse(_turning(True), _AT_REST, goal, time, EXACT)
    free = hull.least_fuel(_turning(True), ("position", "velocity"), _AT_REST, goal, time, EXACT)
    assert 1.1 * free < bound < spent
    assert not attitude_tube._excluded(_turning(True), _AT_REST, goal, time, EXACT)


def _diagonal(moments: np.ndarray) -> Any:
    return tuple(tuple(row) for row in np.diag(moments).tolist())


def aside(attitude: Any, angle: float) -> Any:
    """The attitude turned by an angle about z."""
    if isinstance(attitude, Heading):
        return Heading(attitude.angle + angle)
    return attitude.times(Quat(math.cos(0.5 * angle), 0.0, 0.0, math.sin(0.5 * angle)))


@pytest.mark.slow
@pytest.mark.parametrize("dimension", [2, 3])
def test_no_random_flight_is_below_its_bound(dimension):
    random = np.random.default_rng(5 + dimension)
    flown = 0
    while flown < 4:
        craft = random_craft(random)
        found = flight(craft, random) if craft.dimension == dimension else None
        if found is None:
            continue
        start, goal, spent, steps = found
        time = steps * PERIOD
        bound = attitude_tube.least_impulse(craft, start, goal, time, EXACT)
        assert bound <= spent * (1.0 + 1e-9) + 1e-9
        # Nor below that of a goal which it misses by the tolerance of the attitude.
        missed = replace(goal, attitude=aside(goal.attitude, 0.3))
        wide = GoalSet(0.0, 0.0, 0.3 + 1e-9, 0.0)
        bound = attitude_tube.least_impulse(craft, start, missed, time, wide)
        assert bound <= spent * (1.0 + 1e-9) + 1e-9
        # Neither is this flight excluded, which is what a least time rests on.
        assert not attitude_tube._excluded(craft, start, goal, time, EXACT)
        # A goal set that allows motion: no sooner instant hides the one of this flight.
        loose = GoalSet(0.02, 0.05, 0.05, 0.05)
        assert attitude_tube.least_arrival(craft, start, goal, PERIOD, loose, PERIOD) <= time
        flown += 1
