"""Inspection: which points are seen, by hand, and what an episode remembers of them."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rans_missions.script import Script
from rans_missions.tasks import Inspect
from rans_missions.tasks.inspect import Inspected

from rans.errors import ConfigError
from rans.fast.engine import Engine
from rans.flight import fly
from rans.model.dynamics import SpatialState
from rans.model.fields import Quat, Vec3, map_leaves
from rans.model.spacecraft_file import load_spacecraft
from rans.reference.flight import fly_in_drake
from rans.scenario import scenarios

DEPUTY = load_spacecraft("afrl-deputy")
STILL = Vec3(0.0, 0.0, 0.0)


def at(x: float, y: float, z: float) -> SpatialState:
    """A craft at rest."""
    return SpatialState(Vec3(x, y, z), Quat(1.0, 0.0, 0.0, 0.0), STILL, STILL)


def goal(task: Inspect, sun: float) -> SpatialState:
    """The target with the sun at an angle, and nothing seen."""
    words = -(-task.points // 20)
    return replace(at(0.0, 0.0, 0.0), notes=Inspected(sun, 0.0, (0.0,) * words))


def test_points_lie_evenly() -> None:
    normals = np.array(Inspect().normals)
    assert normals.shape == (100, 3)
    assert np.allclose(np.linalg.norm(normals, axis=1), 1.0)
    assert np.abs(normals.mean(axis=0)).max() < 0.01
    # 100 caps that do not overlap and cover the sphere have a radius of 0.2 rad: neighbours are about 0.35 apart.
    apart = np.linalg.norm(normals[:, None] - normals, axis=2) + 9.0 * np.eye(100)
    assert apart.min(axis=1).min() > 0.25
    assert apart.min(axis=1).max() < 0.45


@pytest.mark.parametrize(
    ("place", "share"),
    [
        # At 50 m the horizon of a sphere of 10 m is where the cosine is 0.2: 40 % of the sphere are in view.
        ((50.0, 0.0, 0.0), 0.40),
        # Half of what is in view from the side is lit.
        ((0.0, 50.0, 0.0), 0.20),
        ((0.0, 0.0, -50.0), 0.20),
        # From behind, the lit half is beyond the horizon.
        ((-50.0, 0.0, 0.0), 0.0),
        # At 20 m the horizon is at 0.5: a quarter.
        ((20.0, 0.0, 0.0), 0.25),
    ],
)
def test_what_is_in_view_and_in_light(place: tuple[float, ...], share: float) -> None:
    task = Inspect()
    seen = task.remember(goal(task, 0.0), at(*place))
    assert abs(seen.notes.count / 100 - share) <= 0.02
    assert math.isclose(task.unseen(seen), 1.0 - seen.notes.count / 100)


def test_each_point_is_judged_by_angles() -> None:
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
def test_what_was_seen_stays_seen(looks: list[tuple[float, float, float]]) -> None:
    """The bits hold the union of what is visible at every check, in single precision."""
    task = Inspect()
    now: Any = goal(task, 0.0)
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


def test_the_sun_turns_once_an_orbit_against_the_motion() -> None:
    task = Inspect()
    period = 2.0 * math.pi / task.mean_motion
    sun = task.sun(task.later(goal(task, 0.3), 0.25 * period))
    assert np.allclose(
        sun.columns(), (math.cos(0.3 - math.pi / 2), math.sin(0.3 - math.pi / 2), 0.0)
    )


def test_the_mission_is_won_with_95_points() -> None:
    task = Inspect()
    for count, won in ((95, False), (96, True)):
        notes = replace(goal(task, 0.0).notes, count=float(count))
        assert bool(task.done(at(50.0, 0.0, 0.0), replace(goal(task, 0.0), notes=notes))) is won


@pytest.mark.slow
def test_drake_and_the_engine_see_the_same_points() -> None:
    task = Inspect()
    starts = scenarios(task, DEPUTY, seed=3, count=3)
    timing = replace(task.timing, episode_steps=12)
    flown = [
        make(DEPUTY, task, Script(np.zeros((12, 3, 6))), starts, timing)
        for make in (fly, fly_in_drake)
    ]
    ours, drakes = (flight.errors()["unseen"] for flight in flown)
    assert (ours == drakes).all()
    assert (np.diff(ours, axis=0) <= 0.0).all()
    assert ours[-1].max() < 0.95
    engine = Engine(DEPUTY, task, 4, seed=3)
    import torch

    for _ in range(12):
        engine.step(torch.zeros(4, 6))
    found = task.unseen(engine.goal)
    assert np.allclose(np.asarray(found)[:3], ours[-1], atol=1e-6)


def test_settings_that_make_no_sense_are_refused() -> None:
    cases: tuple[tuple[dict[str, Any], str], ...] = (
        ({"points": 201}, "points must be a whole number"),
        ({"keep_out": 9.0}, "inside the target"),
        ({"view_degrees": 120.0}, "at most 90"),
    )
    for wrong, said in cases:
        with pytest.raises(ConfigError, match=said):
            Inspect(**wrong)
