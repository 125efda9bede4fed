from __future__ import annotations

import math

import numpy as np
import pytest
from matplotlib.patches import Circle
from matplotlib.quiver import Quiver

from rans import Spacecraft
from rans.episode.drawing import Scene
from rans.model.fields import Heading, Vec2
from rans.model.spacecraft_file import load_spacecraft
from rans.show.figures.layout_figure import draw_layout
from rans.tasks import (
    GoToPose,
    GoToPosition,
    SingleTask,
    TrackVelocity,
    TrackVelocityHeading,
)
from tests.support.states import planar, spatial

BODY = (220, 230, 240)
FLAME = (230, 159, 0)
TRAIL = (0, 114, 178)
GOAL = (0, 158, 115)
PLATFORM = load_spacecraft("floating-platform")
FLYER = load_spacecraft("free-flyer")
TASK = GoToPose()
FAR = 3.0  # m; the view then holds start and goal side by side


def shut(craft: Spacecraft) -> np.ndarray:
    return np.zeros(len(craft.thrusters))


def opened(craft: Spacecraft, index: int, opening: float = 1.0) -> np.ndarray:
    return np.where(np.arange(len(craft.thrusters)) == index, opening, 0.0)


def spots(frame: np.ndarray, colour: tuple[int, int, int]) -> np.ndarray:
    """Pixels of this colour as (x, y) with y upwards, (K, 2)."""
    # The grid's light grey is 8 from the body's in red.
    rows, columns = np.nonzero((np.abs(frame.astype(int) - colour) < 6).all(axis=2))
    return np.stack((columns, -rows), axis=1).astype(float)


def centre(frame: np.ndarray, colour: tuple[int, int, int]) -> np.ndarray:
    found = spots(frame, colour)
    assert len(found)
    return found.mean(axis=0)


def test_only_open_thrusters_have_flames():
    scene = Scene(PLATFORM, TASK)
    assert not len(spots(scene.render(planar(), planar(FAR), shut(PLATFORM)), FLAME))
    full = spots(scene.render(planar(), planar(FAR), opened(PLATFORM, 2)), FLAME)
    half = spots(scene.render(planar(), planar(FAR), opened(PLATFORM, 2, 0.5)), FLAME)
    assert 0 < len(half) < len(full)


@pytest.mark.parametrize("index", range(8))
@pytest.mark.parametrize("heading", [0.0, -2.5])
def test_flames_leave_against_the_force(index, heading):
    frame = Scene(PLATFORM, TASK).render(
        planar(heading=heading), planar(FAR), opened(PLATFORM, index)
    )
    found = centre(frame, FLAME) - centre(frame, BODY)
    thruster = PLATFORM.thrusters[index]
    # From the nozzle's mouth a third of the flame's length on: 0.3 r + 1.1 r / 3.
    place = np.array(thruster.position) - np.array(thruster.direction) * 0.67 * PLATFORM.radius
    expected = Heading(heading).rotate(Vec2(place[0], place[1]))
    angle = math.atan2(expected.y, expected.x) - math.atan2(found[1], found[0])
    # A few pixels of smoothing and cover at about 40 pixels from the centre.
    assert abs((angle + math.pi) % math.tau - math.pi) < 0.15


def goal_of(task: SingleTask, angle: float) -> np.ndarray:
    """Green pixels from the craft's middle at (3, 0); the goal is at the origin and moves to +y."""
    goal = planar(heading=angle, v=(0.0, 0.7))
    frame = Scene(PLATFORM, task).render(planar(FAR), goal, shut(PLATFORM), [(0.0, 0.0)])
    return spots(frame, GOAL) - centre(frame, BODY)


def test_the_goal_is_what_the_task_wants():
    """A metre is 130 pixels: 3 m and six radii of 0.31 m fill the frame's 640."""
    pose = goal_of(GoToPose(), math.pi / 2)
    dot = goal_of(GoToPosition(), math.pi / 2)
    np.testing.assert_allclose(
        pose[:, 0].mean(), dot[:, 0].mean(), atol=5
    )  # what covers the body's middle
    assert dot[:, 0].max() < -200  # 3 m to the left
    assert np.ptp(pose[:, 1]) > 4 * np.ptp(dot[:, 1])  # 2.5 radii and more against 0.5
    way = goal_of(TrackVelocity(), math.pi / 2)
    assert abs(way[:, 0]).max() < 12  # an arrow's head, and nothing where the craft started
    assert way[:, 1].max() > 90  # 1.4 m up
    heading = goal_of(TrackVelocityHeading(), math.pi)
    assert (
        -150 < heading[:, 0].min() < -40
    )  # an axis of 0.71 m to the left, but nothing at the start


def test_the_trail_is_drawn_and_fits_the_frame():
    trail = [(10.0, 10.0), (10.0, -10.0)]
    frame = Scene(PLATFORM, TASK).render(planar(), planar(), shut(PLATFORM), trail)
    found = spots(frame, TRAIL)
    assert np.ptp(found[:, 1]) > 300  # the leg from y = 10 to y = -10 fills most of the 480 rows
    assert not len(spots(Scene(PLATFORM, TASK).render(planar(), planar(), shut(PLATFORM)), TRAIL))


def test_a_view_with_room_for_a_whole_film_stays():
    scene = Scene(PLATFORM, TASK)
    room = [(6.0, 6.0), (-6.0, -6.0)]
    seen = [
        centre(scene.render(planar(x), planar(), shut(PLATFORM), further=room), GOAL)
        for x in (-5.0, 1.0, 5.0)
    ]
    np.testing.assert_array_equal(seen, [seen[0]] * 3)


def test_space_is_seen_with_z_up():
    scene = Scene(FLYER, TASK)
    goal = spatial()
    above = centre(scene.render(spatial((0.0, 0.0, FAR)), goal, shut(FLYER)), BODY)
    below = centre(scene.render(spatial((0.0, 0.0, -FAR)), goal, shut(FLYER)), BODY)
    assert above[1] - below[1] > 150
    np.testing.assert_allclose(above[0], below[0], atol=3.0)


@pytest.mark.parametrize("dimension", [2, 3])
def test_layout_shows_every_thruster(dimension):
    craft = PLATFORM if dimension == 2 else FLYER
    figure = draw_layout(craft)
    (axes,) = figure.axes
    assert {text.get_text() for text in axes.texts} == {str(i) for i in range(len(craft.thrusters))}
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("x, m", "y, m")
    assert craft.name in axes.get_title(loc="left") + axes.get_title()


def test_layout_arrows_are_the_forces(planar_craft):
    (axes,) = draw_layout(planar_craft).axes
    arrows = next(c for c in axes.collections if isinstance(c, Quiver))
    forces = np.array([np.array(t.direction) * t.force for t in planar_craft.thrusters])[:, :2]
    drawn = np.stack((np.asarray(arrows.U), np.asarray(arrows.V)), axis=1)
    scale = np.linalg.norm(drawn[0]) / np.linalg.norm(forces[0])
    np.testing.assert_allclose(drawn, scale * forces, rtol=1e-12, atol=1e-15)
    outline = next(p for p in axes.patches if isinstance(p, Circle))
    assert outline.center == planar_craft.centre_of_mass[:2]
