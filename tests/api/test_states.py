"""Poses and zones as words."""

import math

import numpy as np
import pytest

from rans import ConfigError, GoToPose, state
from rans.api.judging import own_endpoints
from rans.api.states import read_state, read_zones
from rans.episode.scenario import scenarios
from rans.model.fields import leaves
from rans.model.spacecraft_file import load_spacecraft


def test_a_pose_in_the_plane_with_each_unit():
    degrees, radians, bare = (
        read_state(["-3", "1.5", angle], 2, "--start").pose
        for angle in ("-90deg", f"{-math.pi / 2}rad", "-90")
    )
    assert degrees == bare == (-3.0, 1.5, -90.0)
    assert radians == pytest.approx(degrees, abs=1e-12)


def test_a_pose_in_space_may_leave_out_its_attitude():
    assert read_state(["1", "2", "3"], 3, "--goal").pose == (1.0, 2.0, 3.0, 0.0, 0.0, 0.0)
    turned = read_state(["1", "2", "3", "0", "0", "40deg"], 3, "--goal").pose
    assert turned == (1.0, 2.0, 3.0, 0.0, 0.0, 40.0)


def test_quotation_marks_and_commas_change_nothing():
    for words in (["3 1 40deg"], ["3,1,40deg"], ["3,", "1", "40deg"]):
        assert read_state(words, 2, "--start").pose == (3.0, 1.0, 40.0)


def test_velocities_follow_by_name():
    state = read_state(["3", "1", "40deg", "v.x=0.1", "w=-0.2"], 2, "--start")
    assert state == ((3.0, 1.0, 40.0), {"v.x": 0.1, "w": -0.2})
    assert read_state(["w.z=0.1"], 3, "--goal") == ((), {"w.z": 0.1})


def test_zones_are_words_with_commas():
    assert read_zones(["-1.5,0,0.4", "", "2,1,0.3"], 2) == [
        (-1.5, 0.0, 0.4),
        (2.0, 1.0, 0.3),
    ]
    with pytest.raises(
        ConfigError, match=r"x,y,z,r of each zone, m, such as 1.5,0.2,0,0.4, got '1,2,3'"
    ):
        read_zones(["1,2,3"], 3)


def test_words_and_states_are_the_same_start_and_goal():
    """With a start alone the goal of words is the origin, at rest."""
    sampled = scenarios(GoToPose(), load_spacecraft("floating-platform"), 7, 2)
    words = own_endpoints(("3", "1", "40deg", "v.x=0.1"), ())
    start = state((3.0, 1.0), math.radians(40.0), (0.1, 0.0))
    states = own_endpoints(start, state((0.0, 0.0)))
    assert words is not None
    assert states is not None
    first, second = words.applied(sampled), states.applied(sampled)
    for a, b in zip(leaves(first), leaves(second), strict=True):
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-15)
    spatial = scenarios(GoToPose(), load_spacecraft("free-flyer"), 7, 2)
    half = math.sqrt(0.5)
    words = own_endpoints(("1", "2", "3", "0", "0", "90deg", "v.y=0.2", "w.z=0.1"), ())
    quarter = state((1.0, 2.0, 3.0), (half, 0.0, 0.0, half), (0.0, 0.2, 0.0), (0.0, 0.0, 0.1))
    states = own_endpoints(quarter, state((0.0, 0.0, 0.0)))
    assert words is not None
    assert states is not None
    turned = words.applied(spatial), states.applied(spatial)
    for a, b in zip(*map(leaves, turned), strict=True):
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-15)
    # Each may be words or a state, whatever the others are.
    for mixed in (
        own_endpoints(start, ("0", "0", "0")),
        own_endpoints(("3", "1", "40deg", "v.x=0.1"), state((0.0, 0.0))),
    ):
        assert mixed is not None
        for a, b in zip(leaves(mixed.applied(sampled)), leaves(second), strict=True):
            np.testing.assert_allclose(a, b, rtol=0, atol=1e-15)
    with pytest.raises(ConfigError, match=r"the start must be a state .* got \(3, 1, 0\.7\)"):
        own_endpoints((3, 1, 0.7), ("0", "0", "0")).applied(sampled)  # type: ignore[arg-type,union-attr]
    assert own_endpoints((), None) is None
    with pytest.raises(ConfigError, match="--start takes x, y and heading"):
        own_endpoints(("3",), ()).applied(sampled)  # type: ignore[union-attr]
