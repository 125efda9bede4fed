"""Twists that all thrusters give together, against linear programs."""

import math

import numpy as np
import pytest
from rans_any_craft.twists import authority_margin, balanced, cone_pushes, reaches
from scipy.optimize import linprog

from rans.model.authority import authorities
from rans.model.spacecraft_file import load_spacecraft
from tests.support.layouts import sample_layout


@pytest.mark.parametrize(
    "name",
    [
        "astrobee-granite",
        "floating-platform",
        "floating-platform-shared",
        "freeflyer2",
        "atmos-orbit-16",
        "free-flyer-shared",
        "spheres",
        "cubesat-3u",
    ],
)
def test_balanced_authority_is_that_of_linear_programs(name):
    craft = load_spacecraft(name)
    columns = np.array(craft.wrench_map)
    # A wheel is a column of torque either way.
    torques = np.array(craft.wheel_map).reshape(-1, craft.degrees_of_freedom - craft.dimension)
    turning = np.column_stack([np.zeros((len(torques), craft.dimension)), torques])
    columns = np.vstack([columns, turning, -turning])
    found = balanced(columns, craft.thrust_sharing == "split")
    expected = [x for one in authorities(craft) for x in (one.forwards, one.backwards)]
    assert found == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("shared", [False, True])
def test_pushes_are_those_of_linear_programs(shared):
    """Ways 3 degrees apart miss the least one of a cone by 1.5 at most, and its reach by less than 2 percent."""
    columns = sample_layout(5)
    parts = {"bounds": (0.0, 1.0)}
    if shared:
        parts = {"A_ub": np.ones((1, len(columns))), "b_ub": [1.0]}

    def reach(angle):
        ahead = np.array([math.cos(angle), math.sin(angle), 0.0])
        aside = np.array([-math.sin(angle), math.cos(angle), 0.0])
        balance = columns @ np.array([aside, [0.0, 0.0, 1.0]]).T
        return -linprog(-columns @ ahead, A_eq=balance.T, b_eq=np.zeros(2), **parts).fun

    angles = np.radians(np.arange(-45, 315, 3))
    along = np.array([reach(angle) for angle in angles])
    ways = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(len(angles))])
    assert reaches(columns, ways, shared) == pytest.approx(along, rel=1e-9)
    # The cone about +x begins at -45 degrees, those of +y, -x and -y a quarter turn each later.
    quarters = [np.append(along, along[0])[30 * k : 30 * k + 31].min() for k in (0, 2, 1, 3)]
    found = cone_pushes(columns, shared)
    assert (found <= np.array(quarters) + 1e-9).all()
    assert found == pytest.approx(quarters, rel=0.02)


def test_a_layout_that_cannot_turn_one_way_has_no_margin():
    # Four thrusters that push every way and turn to the left only.
    wheel = np.array([[1.0, 0.0, 0.3], [0.0, 1.0, 0.3], [-1.0, 0.0, 0.3], [0.0, -1.0, 0.3]])
    assert math.isclose(balanced(wheel)[5], 0.0, abs_tol=1e-12)
    assert authority_margin(wheel) == pytest.approx(0.0, abs=1e-9)
    both = np.vstack([wheel, wheel * [1.0, 1.0, -1.0]])
    assert authority_margin(both) > 1.0


def test_thrusters_without_a_torque_do_not_count_in_its_unit():
    """The mean square of the torques 1 and 1/4 is 17/32; the weaker way is 1/4 over its root."""
    through_the_centre = [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0]]
    turning = [[0.0, 0.0, 1.0], [0.0, 0.0, -0.25]]
    margin = authority_margin(np.array(through_the_centre + turning))
    assert margin == pytest.approx(0.25 / np.sqrt(17.0 / 32.0), rel=1e-9)
