"""Zones, cones and slopes as they are drawn: every point of an outline is on the rim of its shape."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from rans_missions.tasks import Avoid, DockPort
from rans_missions.tasks.avoid import Zones

from rans.drawing import Scene, outlines
from rans.flight import fly
from rans.model.fields import Vec2, Vec3, map_leaves
from rans.model.spacecraft_file import load_spacecraft
from rans.model.timing import Timing
from rans.scenario import scenarios
from rans.show.figures.figures import episode_figure
from rans.show.scene.scene import SceneMotion, at_instant, scenery_parts, scenery_pose
from rans.tasks.shapes import Ball, Cone, GlideSlope, SpeedLimit
from tests.support.states import planar

PLATFORM = load_spacecraft("floating-platform")
UP = Vec3(0.0, 0.6, 0.8)
THIRTY = math.radians(30.0)


@pytest.mark.parametrize(
    ("shape", "count"),
    [
        (Ball(Vec2(1.0, 2.0), Vec2(0.0, 0.0), 0.5), 1),
        (Ball(Vec3(1.0, 2.0, 3.0), Vec3(0.0, 0.0, 0.0), 0.5), 3),
        (Cone(Vec2(1.0, 2.0), Vec2(0.6, 0.8), THIRTY, 2.0), 1),
        (Cone(Vec3(1.0, 2.0, 3.0), UP, THIRTY, 2.0), 9),
        (GlideSlope(Vec3(1.0, 2.0, 3.0), UP, 0.3), 9),
        (SpeedLimit(Vec3(1.0, 2.0, 3.0), 0.2, 0.1), 0),
    ],
)
def test_outlines_lie_where_the_margin_is_zero(shape: Any, count: int) -> None:
    found = outlines(shape, 4.0)
    assert len(found) == count
    for line in found:
        centre = shape.centre if isinstance(shape, Ball) else shape.apex
        place = type(centre)(*line.T[: len(centre.columns())])
        on_rim = np.abs(shape.gap(place)) < 1e-8  # an apex carries the softening of lengths
        if isinstance(shape, Cone):
            # The arc between the sides is as far away as the cone is long.
            on_rim |= np.abs((place - shape.apex).norm() - shape.length) < 1e-8
        assert on_rim.all()


def test_solids_stand_where_the_shapes_are() -> None:
    cone = Cone(Vec3(1.0, 2.0, 3.0), UP, THIRTY, 2.0)
    pose = scenery_pose(cone)
    assert pose.translation().tolist() == [1.0, 2.0, 3.0]
    np.testing.assert_allclose(pose.rotation().matrix()[:, 2], [0.0, 0.6, 0.8], rtol=0, atol=1e-12)
    assert [part.name for part in scenery_parts(cone, 1.0)] == ["cone"]
    sides = Cone(Vec2(1.0, 2.0), Vec2(0.0, 1.0), THIRTY, 2.0)
    np.testing.assert_allclose(
        scenery_pose(sides).rotation().matrix()[:, 0], [0.0, 1.0, 0.0], rtol=0, atol=1e-12
    )
    assert len(scenery_parts(sides, 1.0)) == 2
    assert scenery_parts(SpeedLimit(Vec2(0.0, 0.0), 0.1, 0.1), 1.0) == []


def shut() -> Any:
    pilot: Any = type("Shut", (), {"name": "shut"})()
    pilot.reset = lambda count: None
    pilot.act = lambda state, goal, observation: np.zeros((len(observation), 8))
    return pilot


def test_a_replay_moves_zones_and_turns_the_cone() -> None:
    """Over 4 s a zone moves by its velocity, and the port's cone by 3 degrees/s."""
    timing = Timing(episode_steps=20)
    task = Avoid(zone_speed=(0.04, 0.04))
    starts = scenarios(task, PLATFORM, 1, 2)
    motion = SceneMotion.of(fly(PLATFORM, task, shut(), starts, timing), 1)
    assert len(motion.scenery) == 3
    for k, zone in enumerate(motion.scenery):
        ways = [scenery_pose(at_instant(zone, instant)).translation() for instant in (0, 20)]
        drawn = map_leaves(lambda x: float(x[1]), starts.goal.notes.zones[k])
        expected = [4.0 * drawn.v.x, 4.0 * drawn.v.y, 0.0]
        moved = np.subtract(ways[1], ways[0])
        np.testing.assert_allclose(moved, expected, rtol=0, atol=1e-12)
    port = DockPort(port_rate=(math.radians(3.0), math.radians(3.0)))
    flight = fly(PLATFORM, port, shut(), scenarios(port, PLATFORM, 1, 1), timing)
    cone, _ = SceneMotion.of(flight, 0).scenery
    axes = [scenery_pose(at_instant(cone, k)).rotation().matrix()[:, 0] for k in (0, 20)]
    assert axes[0] @ axes[1] == pytest.approx(math.cos(math.radians(12.0)), abs=1e-9)


def test_figures_and_environments_draw_zones() -> None:
    """Lines in the figure of a path, and red pixels in a frame, which has none without zones."""
    task = Avoid(zones=2)
    starts = scenarios(task, PLATFORM, 1, 1)
    figure = episode_figure(fly(PLATFORM, task, shut(), starts, Timing(episode_steps=5)))
    (axes,) = figure.subfigs[0].axes
    assert "keep-out zone, dotted at first" in axes.get_legend_handles_labels()[1]
    state = planar(2.0)
    goal = map_leaves(lambda x: float(np.ravel(x)[0]), starts.goal)
    red = np.array([0xD5, 0x5E, 0x00])

    def reds(notes: Any) -> int:
        frame = Scene(PLATFORM, task).render(state, replace(goal, notes=notes), np.zeros(8))
        return int((np.abs(frame.astype(int) - red).max(axis=-1) < 40).sum())

    assert reds(goal.notes) > reds(Zones(())) + 50
