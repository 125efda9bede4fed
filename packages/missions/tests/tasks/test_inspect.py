"""Inspection: which points are seen, by hand, and what an episode remembers of them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from hypothesis import given, settings, strategies as st
from rans_missions.tasks import Inspect
from rans_missions.tasks.inspect import Inspected

from rans.model.dynamics import SpatialState
from rans.model.fields import Quat, Vec3, map_leaves

STILL = Vec3(0.0, 0.0, 0.0)


def at(x: float, y: float, z: float) -> SpatialState:
    """A craft at rest."""
    return SpatialState(Vec3(x, y, z), Quat(1.0, 0.0, 0.0, 0.0), STILL, STILL)


def goal(task: Inspect, sun: float) -> SpatialState:
    """The target with the sun at an angle, and nothing seen."""
    words = -(-task.points // 20)
    return replace(at(0.0, 0.0, 0.0), notes=Inspected(sun, 0.0, (0.0,) * words))


def test_each_point_is_judged_by_angles():
    """Against angles computed at every point, with cones of 60 and 40 degrees."""
    task = Inspect(view_degrees=60.0, light_degrees=40.0)
    sun = 0.7
    craft = np.array([18.0, 9.0, 6.0])
    visible = task.visible(goal(task, sun), at(*craft))
    for normal, seen in zip(np.array(task.normals), visible, strict=True):
        way = craft - 10.0 * normal
        view = math.acos(way @ normal / np.linalg.norm(way))
        light = math.acos(normal @ [math.cos(sun), math.sin(sun), 0.0])
        assert bool(seen) is (view < math.radians(60.0) and light < math.radians(40.0))
    assert 2 < sum(visible) < 20


@settings(max_examples=30, deadline=None)
@given(
    st.lists(
        st.tuples(st.floats(-3.0, 3.0), st.floats(-1.5, 1.5), st.floats(-3.0, 3.0)),
        min_size=1,
        max_size=4,
    )
)
def test_what_was_seen_stays_seen(looks):
    """The bits hold the union of what is visible at every check, in single precision."""
    task = Inspect()
    now = goal(task, 0.0)
    union = np.zeros(100, bool)
    for azimuth, elevation, sun in looks:
        across = 40.0 * math.cos(elevation)
        craft = at(
            across * math.cos(azimuth), across * math.sin(azimuth), 40.0 * math.sin(elevation)
        )
        now = replace(now, notes=replace(now.notes, sun=sun))
        union |= np.array(task.visible(now, craft), bool)
        now = task.remember(now, craft)
        now = replace(now, notes=map_leaves(lambda x: float(np.float32(x)), now.notes))
    assert now.notes.count == union.sum()
    assert [bool(seen) for word in task._known(now) for seen in word] == union.tolist()
    unseen, lit = task.directions(now)
    normals = np.array(task.normals)
    expected = normals[~union].sum(axis=0) / 100
    assert np.allclose(unseen.columns(), expected, atol=1e-12)
    bright = ~union & (normals @ [math.cos(now.notes.sun), math.sin(now.notes.sun), 0.0] > 0.0)
    assert np.allclose(lit.columns(), normals[bright].sum(axis=0) / 100, atol=1e-12)


def test_the_sun_turns_once_an_orbit_against_the_motion():
    task = Inspect()
    period = 2.0 * math.pi / task.mean_motion
    sun = task.sun(task.later(goal(task, 0.3), 0.25 * period))
    assert np.allclose(
        sun.columns(), (math.cos(0.3 - math.pi / 2), math.sin(0.3 - math.pi / 2), 0.0)
    )


def test_the_mission_is_won_with_95_points():
    task = Inspect()
    for count, won in ((95, False), (96, True)):
        notes = replace(goal(task, 0.0).notes, count=float(count))
        assert bool(task.done(at(50.0, 0.0, 0.0), replace(goal(task, 0.0), notes=notes))) is won


def test_points_stand_on_a_lattice_of_even_heights():
    """Four points at heights of 3/4, 1/4 and below, each the golden angle of 137.5 degrees beyond the last."""
    normals = np.array(Inspect(points=4).normals)
    np.testing.assert_allclose(normals[:, 2], [0.75, 0.25, -0.25, -0.75])
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0)
    angles = np.degrees(np.arctan2(normals[:, 1], normals[:, 0])) % 360.0
    np.testing.assert_allclose(angles, [0.0, 137.508, 275.016, 52.523], atol=1e-3)
