"""Real spacecraft: thrusters against numbers worked by hand or their makers' own allocation, and Drake."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rans.model.body import Body
from rans.model.dynamics import thrust
from rans.model.spacecraft_file import load_spacecraft
from tests.support.crafts import REAL_CRAFT

INCH = 0.0254
"""m."""

BY_HAND: list[tuple[str, int, list[float]]] = [
    # Tangential, 1.75 N at 0.23884 m: counter-clockwise at +x, clockwise at +y.
    ("pingu", 0, [0.0, 1.75, 0.4179747]),
    ("pingu", 3, [1.75, 0.0, -0.4179747]),
    # 1 N along (1, -1) at 45 degrees on a circle of 0.31 m: clockwise.
    ("roboran-platform", 0, [0.7071068, -0.7071068, -0.31]),
    # 1.5 N along y at x = 0.17 m turns about z; along x at z = 0.17 m about y; along z at y = 0.17 m about x.
    ("atmos-orbit-12", 4, [0.0, 1.5, 0.0, 0.0, 0.0, 0.255]),
    ("atmos-orbit-12", 0, [1.5, 0.0, 0.0, 0.0, 0.255, 0.0]),
    ("atmos-orbit-12", 8, [0.0, 0.0, 1.5, 0.255, 0.0, 0.0]),
    # Nozzle 1 of module 1 blows forwards at (6.00, 4.01, -1.56) in: 0.268 N backwards; about the centre of mass
    # torque y is (z - z_cm) F_x = (-0.039624 + 0.002532192) (-0.268), torque z is -(y - y_cm) F_x.
    ("astrobee-iss", 0, [-0.268, 0.0, 0.0, 0.0, 0.0099406, 0.0273843]),
    # Nozzle 3 blows along +y at (2.83, 6.00) in: torque z is x F_y.
    ("astrobee-granite", 2, [0.0, -0.197, -0.197 * 2.83 * INCH]),
    # 0.112 N on the arm of 0.0965 m: +x above the centre turns about +y, +y at +x about +z.
    ("spheres", 0, [0.112, 0.0, 0.0, 0.0, 0.010808, 0.0]),
    ("spheres", 2, [0.0, 0.112, 0.0, 0.0, 0.0, 0.010808]),
    ("spheres", 10, [0.0, 0.0, -0.112, -0.010808, 0.0, 0.0]),
    ("afrl-12kg", 3, [0.0, -1.0, 0.0, 0.0, 0.0, 0.0]),
    # 25 mN along (-1, -1, -1) / sqrt(3) at (0.04, 0.04, 0.15) m: f (0.15 - 0.04) about x and back about y.
    ("cubesat-3u", 0, [-0.0144338, -0.0144338, -0.0144338, 0.0015877, -0.0015877, 0.0]),
    # 50 mN at (0.045, 0.09, 0.15) m: (y F_z - z F_y, z F_x - x F_z, x F_y - y F_x), F = -0.0288675 each.
    ("cubesat-6u", 0, [-0.0288675] * 3 + [0.0017321, -0.0030311, 0.0012990]),
]


@pytest.mark.parametrize("name", ["astrobee-granite", "astrobee-iss"])
def test_astrobee_has_a_plenum_for_each_module(name):
    """By NASA's model two open nozzles of a module give 0.72 each: 1 / (1 + 0.39); the other module's all."""
    craft = load_spacecraft(name)
    first, second = craft.supplies
    assert [craft.thrusters[i].position[1] > 0.0 for i in (*first, *second)] == [
        *[True] * len(first),
        *[False] * len(second),
    ]
    command = [float(i in (*first[:2], second[0])) for i in range(len(craft.thrusters))]
    given = thrust(craft, command, replace(Body.of(craft), droop=0.39))
    assert [given[i] for i in (*first[:2], second[0])] == pytest.approx([0.72, 0.72, 1.0], abs=1e-3)


@pytest.mark.parametrize(("name", "index", "expected"), BY_HAND)
def test_thrusters_by_hand(name, index, expected):
    row = load_spacecraft(name).wrench_map[index]
    assert row == pytest.approx(expected, abs=1e-7)  # digits written here


def test_the_makers_matrix_of_sixteen_thrusters():
    """DISCOWER/fault-tolerant-mpc, data/InertialProperties.md: D times 1.75 N, one column a thruster."""
    a, b, c = 0.12, 0.09, 0.05
    none = [0.0] * 4
    matrix = [
        [-1, -1, 1, 1, -1, -1, 1, 1, *none, *none],
        [*none, *none, -1, -1, 1, 1, *none],
        [*none, *none, *none, -1, 1, -1, 1],
        [*none, *none, *none, -a, a, a, -a],
        [-c, c, c, -c, -c, c, c, -c, *none, *none],
        [a, a, -a, -a, -a, -a, a, a, -b, b, b, -b, *none],
    ]
    ours = np.array(load_spacecraft("atmos-orbit-16").wrench_map).T
    assert ours == pytest.approx(1.75 * np.array(matrix), abs=1e-12)


def test_apollos_thrusters_turn_as_its_handbook_says():
    """The table of primary torques in SCPToolbox's parameters.jl: axes forward, right and down, so that pitch up,
    yaw right and roll right are positive."""
    table = np.array(load_spacecraft("apollo-csm").wrench_map)
    forward = [(1, 1), (2, 1), (1, -1), (2, -1)]  # pitch up, yaw right, pitch down, yaw left
    for quad, (axis, sign) in enumerate(forward):
        torques = table[4 * quad : 4 * quad + 4, 3:]
        for nozzle, (about, way) in enumerate([(axis, sign), (axis, -sign), (0, -1), (0, 1)]):
            assert abs(torques[nozzle]).argmax() == about
            assert np.sign(torques[nozzle, about]) == way
    # 445 N, of which a cant of 10 degrees leaves 0.9848 along the axis.
    assert table[0, 0] == pytest.approx(-438.24, abs=0.01)
    assert np.linalg.norm(table[:, :3], axis=1) == pytest.approx(445.0)


def test_the_free_flyers_own_mapping():
    """StanfordASL/freeflyer2, simulator_node.py: F_x, F_y and torque of eight openings."""
    table = np.array(load_spacecraft("freeflyer2").wrench_map)
    opened = np.random.default_rng(0).uniform(size=8)
    u = opened.tolist()
    force_x = 0.2 * (u[2] + u[5] - u[1] - u[6])
    force_y = 0.2 * (u[4] + u[7] - u[0] - u[3])
    torque = 0.2 * 0.11461 * (u[1] + u[3] + u[5] + u[7] - u[0] - u[2] - u[4] - u[6])
    assert opened @ table == pytest.approx([force_x, force_y, torque], abs=1e-12)


def test_wheels_turn_the_craft_the_other_way():
    assert load_spacecraft("pingu").wheel_map == ((-0.1,),)
    assert np.array(load_spacecraft("cubesat-3u").wheel_map) == pytest.approx(-0.004 * np.eye(3))


@pytest.mark.parametrize("name", REAL_CRAFT)
def test_every_real_craft_pushes_and_turns_every_way(name):
    craft = load_spacecraft(name)
    wrenches = craft.wrenches_either_way
    assert np.linalg.matrix_rank(wrenches) == craft.degrees_of_freedom
    assert craft.can_turn
    assert craft.controls_every_direction
    # An oracle of its own: a linear programme for each way along each axis.
    from scipy.optimize import linprog

    for axis in range(craft.degrees_of_freedom):
        for sign in (1.0, -1.0):
            asked = sign * np.eye(craft.degrees_of_freedom)[axis]
            assert linprog(np.ones(wrenches.shape[1]), A_eq=wrenches, b_eq=asked).success
