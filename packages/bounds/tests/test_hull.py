"""Hull bounds: equal to closed forms where these exist, and below everything that ever flew."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from rans_bounds import hull
from rans_bounds.goal_set import GoalSet

from rans import ConfigError, GoToPose, TrackVelocity
from rans.episode.scenario import scenario
from rans.model.body import Body
from rans.model.dynamics import thrust, wrench
from rans.model.fields import Quat, Vec3, leaves, unflatten
from rans.model.spacecraft_file import load_spacecraft
from rans.tasks.goal_set import aims
from tests.support.crafts import nasty_planar, nasty_spatial
from tests.support.effector_crafts import WHEELED
from tests.support.problems import spatial
from tests.support.states import planar
from tests.support.tiny_lattice import fly_everything, lopsided

PLATFORM = load_spacecraft("floating-platform")
FLYER = load_spacecraft("free-flyer")
SHARED = replace(PLATFORM, thrust_sharing="split")
POSE = aims(GoToPose())
EXACT = GoalSet(0.0, 0.0, 0.0, 0.0)
"""What is optimal has rounding, and the optimiser 1e-8 of its own."""


@pytest.mark.parametrize(
    "craft", [PLATFORM, nasty_planar(), SHARED, nasty_spatial(), WHEELED], ids=lambda c: c.name
)
def test_reach_with_faults_is_that_of_every_command(craft):
    """One dead, one stuck at 0.6, one weak: the hardest push and turn of full commands and of random ones."""
    count = len(craft.thrusters)
    gain = (0.0, 0.0, 0.4, *(1.0,) * (count - 3))
    leak = (0.0, 0.6, *(0.0,) * (count - 2))
    body = replace(Body.of(craft), gain=gain, leak=leak)
    reach = hull.Reach.of(craft, hull.Health(gain, leak))
    rng = np.random.default_rng(1)
    every = (
        itertools.product((0.0, 1.0), repeat=count)
        if count < 9
        else rng.integers(0, 2, (4000, count))
    )
    told = np.concatenate([np.array(list(every), dtype=float), rng.random((1000, count))])
    given = wrench(craft, tuple(told.T), body)
    force = given.force.norm()
    torque = np.linalg.norm(
        np.atleast_2d(given.torque.columns() if isinstance(given.torque, Vec3) else given.torque),
        axis=0,
    ) + sum(wheel.max_torque for wheel in craft.wheels)  # one wheel at most, in the plane
    assert force.max() <= reach.force.max() * (1 + 1e-12)
    assert torque.max() <= reach.torque * (1 + 1e-12)
    if count < 9 and craft.thrust_sharing == "none":  # reached by a command that was tried
        assert force.max() == pytest.approx(reach.force.max())
        assert torque.max() == pytest.approx(reach.torque)


def least_settling(start: Any, period: float, health: hull.Health | None = None) -> float:
    """Least time until the platform stays within 5 cm and 0.1 rad of the origin."""
    settled = hull.settling_set(PLATFORM, 0.05, 0.1, period, health)
    aimed = "position", "velocity", "attitude"
    return hull.least_time(PLATFORM, aimed, start, planar(), settled, health)


def test_least_settling_by_hand():
    """2 sqrt(2) N: from 3 m to 5 cm short of the goal, there at most at 2 sqrt(a 5 cm); with one thruster
    left, of 1 N, as much longer as the root of what it has less."""
    a = 2 * math.sqrt(2) / PLATFORM.mass
    # looked at all the time
    v = 2 * math.sqrt(a * 0.05)
    way = 2.95
    peak = math.sqrt(a * way + v * v / 2)
    found = least_settling(planar(x=-3.0), 0.0)
    assert found == pytest.approx((2 * peak - v) / a)
    dead = hull.Health((0.0,) * 7 + (1.0,), (0.0,) * 8)
    alone = least_settling(planar(x=-3.0), 0.0, dead)
    assert alone == pytest.approx(found * math.sqrt(2 * math.sqrt(2)), rel=1e-9)


def test_who_is_faster_leaves_for_a_moment():
    """Braking as hard as it can from one side of the ball along a line, at any phase of the period."""
    within = hull.settling_set(PLATFORM, 0.05, 0.1, 0.2)
    h = 0.2
    a = 2 * math.sqrt(2) / PLATFORM.mass
    k = np.arange(1, 20) * h
    farthest = lambda v: (v * k - a * k**2 / 2).max()  # noqa: E731
    assert farthest(within.velocity * 1.001) > 0.1
    exact = math.sqrt(4 * a * 0.05)  # whoever is slower stays, if looked at all the time
    assert exact < within.velocity < 1.02 * exact
    assert within.spin == pytest.approx(
        2 * math.sqrt(6.0637 * 0.1 + (6.0637 * 0.05) ** 2), rel=1e-4
    )


def test_overshooting_is_allowed_for():
    """Too fast to stop in time: brake, come back. v^2 / 2a too far, then bang-bang back."""
    a = 2 * math.sqrt(2) / PLATFORM.mass
    v = 0.6
    back = v * v / (2 * a)
    bound = hull.least_time(PLATFORM, POSE, planar(v=(v, 0.0)), planar(), EXACT)
    assert bound == pytest.approx(v / a + 2 * math.sqrt(back / a))


def test_out_of_reach_is_infinite():
    assert hull.least_fuel(PLATFORM, POSE, planar(x=-30.0), planar(), 2.0, EXACT) == math.inf
    with pytest.raises(ConfigError, match="horizon > 0 s, got 0"):
        hull.least_fuel(PLATFORM, POSE, planar(), planar(), 0.0, EXACT)


def test_tolerances_are_granted():
    """By hand, with a = 2.828 N / 5.32 kg = 0.5317 m/s^2 and 1.24 N m / 0.2045 kg m^2 for the turn."""
    push = 2 * math.sqrt(2) / PLATFORM.mass
    turn = 1.24 / PLATFORM.inertia[2][2]
    slow = hull.least_time(
        PLATFORM, aims(TrackVelocity()), planar(v=(0.5, 0.0)), planar(), GoalSet(0.0, 0.2, 0.0, 0.0)
    )
    assert slow == pytest.approx(0.3 / push)
    near = hull.least_time(PLATFORM, POSE, planar(x=-3.0), planar(), GoalSet(0.5, 0.0, 0.0, 0.0))
    assert near == pytest.approx(2 * math.sqrt(2.5 / push))
    # at 0.2 m/s at the end: v0 = 0, way = 3 = the triangle less what braking to 0.2 spares
    fast = hull.least_time(PLATFORM, POSE, planar(x=-3.0), planar(), GoalSet(0.0, 0.2, 0.0, 0.0))
    peak = math.sqrt(push * 3.0 + 0.5 * 0.2**2)
    assert fast == pytest.approx((2 * peak - 0.2) / push)
    heading = hull.least_time(
        PLATFORM, POSE, planar(heading=2.0), planar(), GoalSet(0.0, 0.0, 0.5, 0.0)
    )
    assert heading == pytest.approx(2 * math.sqrt(1.5 / turn))
    spin = hull.least_time(PLATFORM, POSE, planar(w=2.0), planar(), GoalSet(9.0, 9.0, 3.0, 0.5))
    assert spin == pytest.approx(1.5 / turn)
    saved = hull.least_fuel(
        PLATFORM, POSE, planar(w=2.0), planar(), 20.0, GoalSet(0.0, 0.0, 3.0, 0.5)
    )
    assert saved == pytest.approx(1.5 * PLATFORM.inertia[2][2] / 0.31)
    loose = hull.least_fuel(
        PLATFORM, POSE, planar(x=-3.0), planar(), 200.0, GoalSet(0.5, 0.0, 0.0, 0.0)
    )
    assert loose == pytest.approx(
        2 * PLATFORM.mass * 2.5 / 200.0, rel=0.01
    )  # approached from above


def test_a_long_body_turns_about_its_easiest_axis():
    """Momentum L turns no faster than L / I_min: with moments 0.1, 0.4, 0.4 the angle counts by 0.1."""
    craft = replace(FLYER, inertia=((0.1, 0.0, 0.0), (0.0, 0.4, 0.0), (0.0, 0.0, 0.4)))
    torques = [np.array(row[3:]) for row in craft.wrench_map]
    torque = max(
        float(np.linalg.norm(sum(some)))
        for count in range(1, len(torques) + 1)
        for some in itertools.combinations(torques, count)
    )
    case = scenario(GoToPose().for_evaluation(), 3, 3, 0)
    start = replace(case.goal, attitude=Quat(math.cos(0.5), math.sin(0.5), 0.0, 0.0))
    goal = replace(case.goal, attitude=Quat(1.0, 0.0, 0.0, 0.0))
    assert hull.least_time(craft, POSE, start, goal, EXACT) == pytest.approx(
        2 * math.sqrt(0.1 / torque)
    )
    # spin in the goal set costs up to I_max times the tolerance
    spinning = replace(goal, w=Vec3(0.0, 1.0, 0.0))
    bound = hull.least_time(craft, {"spin"}, spinning, goal, GoalSet(0.0, 0.0, 0.0, 0.5))
    assert bound == pytest.approx((0.4 * 1.0 - 0.4 * 0.5) / torque)


@pytest.mark.parametrize(
    "craft", [lopsided(), replace(lopsided(), thrust_sharing="split")], ids=["full", "shared"]
)
def test_no_firing_sequence_beats_its_bounds(craft):
    """All 32,768 of three periods; bounds for every final state of some of them."""
    start = planar(0.3, -0.2, 0.7, (0.1, 0.05), 0.4)
    flown = fly_everything(craft, start, 3)
    h = 0.2
    shares = np.array(thrust(craft, tuple(np.moveaxis(flown.commands, 2, 0))))
    spent = np.einsum("imk,i->m", shares, [t.force for t in craft.thrusters]) * h
    for k in np.random.default_rng(0).integers(0, len(spent), 8):
        end = unflatten(start, [float(x[k]) for x in leaves(flown.final)])
        assert hull.least_fuel(craft, POSE, start, end, 3 * h, EXACT) <= spent[k] + 1e-9
        assert hull.least_time(craft, POSE, start, end, EXACT) <= 3 * h + 1e-9


def test_many_thrusters_are_bounded_by_their_sum():
    """Beyond 16 no force exceeds the thrust; the bound is looser, and still one."""
    doubled = replace(FLYER, thrusters=FLYER.thrusters * 2)
    start = scenario(GoToPose().for_evaluation(), 3, 3, 0)
    tight, loose = (
        hull.least_time(c, POSE, start.start, start.goal, EXACT) for c in (FLYER, doubled)
    )
    assert 0 < loose < tight


@pytest.mark.parametrize("craft", [PLATFORM, SHARED, nasty_spatial()], ids=lambda c: c.name)
def test_who_has_no_thruster_left_never_arrives_unless_drifting(craft):
    """At 0.5 m/s it is 5.9 s away from the set of 5 cm around a goal 3 m ahead."""
    count = len(craft.thrusters)
    dead = hull.Health((0.0,) * count, (0.0,) * count)
    at = planar if craft.dimension == 2 else spatial
    goal = at()
    aimed = ("position", "velocity", "attitude", "spin")
    exact = hull.GoalSet(0.05, 0.0, 0.1, 0.0)
    loose = hull.GoalSet(0.05, 1.0, 0.1, 0.0)
    assert hull.least_time(craft, aimed, at(-3.0), goal, exact, dead) == math.inf
    assert hull.least_time(craft, aimed, goal, goal, exact, dead) == 0.0
    moving = replace(at(-3.0), v=replace(goal.v, x=0.5))  # pyrefly: ignore[bad-argument-type]
    assert hull.least_time(craft, aimed, moving, goal, exact, dead) == math.inf
    assert hull.least_time(craft, aimed, moving, goal, loose, dead) == pytest.approx(2.95 / 0.5)
    settled = hull.settling_set(craft, 0.05, 0.1, 0.2, dead)
    assert hull.least_time(craft, aimed[:3], at(-3.0), goal, settled, dead) == math.inf
    assert hull.staying_time(craft, exact, 0.2, dead) == math.inf
