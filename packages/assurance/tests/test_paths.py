"""Paths and the look-ahead planner: lengths known in closed form, picks worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rans_assurance.follow.paths import (
    PATHS,
    SPACING,
    LookAhead,
    Path,
    circle,
    helix,
    lemniscate,
    spiral,
    square,
)
from scipy.integrate import quad

LINE = Path.through("line", np.array([(0.0, 0.0), (2.0, 0.0)]), closed=False)
"""401 points along the x axis, 5 mm apart."""
LEMNISCATE = 2.622057554292119
"""Half the length of a lemniscate of half-width 1 (Gauss)."""


def spiral_length() -> float:
    """Of radius 0.5 to 2 m in five turns, integrated by SciPy."""
    growth = 1.5 / (10 * math.pi)
    return quad(lambda t: math.hypot(0.5 + growth * t, growth), 0.0, 10 * math.pi)[0]


@pytest.mark.parametrize(
    ("path", "length"),
    [
        (circle(), 2 * math.pi * 1.5),
        (circle(0.4), 2 * math.pi * 0.4),
        (square(), 12.0),
        (spiral(), spiral_length()),
        (lemniscate(), 2 * LEMNISCATE * 1.5),
        (helix(1.0, 0.5, 2.0), 2 * math.hypot(2 * math.pi, 0.5)),
        (LINE, 2.0),
    ],
)
def test_lengths(path: Path, length: float) -> None:
    # chords of 5 mm on a radius of 0.4 m are short by (0.005 / 0.4)^2 / 24 = 7e-6
    assert path.length == pytest.approx(length, rel=1e-5)


@pytest.mark.parametrize("path", [make() for make in PATHS.values()], ids=list(PATHS))
def test_points_are_equally_close(path: Path) -> None:
    gaps = np.linalg.norm(np.diff(path.at(np.arange(path.last + 1)), axis=0), axis=1)
    assert gaps.max() <= SPACING + 1e-12  # rounding
    # chords are shorter than their arcs by 2e-5 at a radius of 0.2 m, and around the spiral's start
    assert gaps.min() > 0.999 * gaps.max()


def test_a_closed_path_goes_round_and_an_open_one_stops() -> None:
    loop = square()
    assert (len(loop.points), loop.last) == (2400, 2400)
    corners = [(1.5, -1.5), (-1.5, -1.5), (1.5, -1.5)]
    np.testing.assert_allclose(loop.at(np.array([600, 2400, 3000])), corners, atol=1e-12)
    np.testing.assert_allclose(
        LINE.at(np.array([-5, 200, 999])), [(0, 0), (1, 0), (2, 0)], atol=1e-12
    )


def test_a_planar_path_in_space_has_no_height() -> None:
    assert circle().in_space().dimension == 3
    np.testing.assert_array_equal(
        circle().in_space().points, np.pad(circle().points, ((0, 0), (0, 1)))
    )
    assert helix().in_space().points.shape == helix().points.shape


@pytest.mark.parametrize(
    ("position", "progress", "expected"),
    [
        ((0.3, 0.2), 60, 0.2),
        ((0.3012, -0.2), 60, 0.2),  # between two points
        ((2.3, 0.4), 400, 0.5),  # beyond the end: 3-4-5
        (
            (1.0, 0.0),
            20,
            0.65,
        ),  # on the path, but not where the flight is: it looks as far as 0.35 m
    ],
)
def test_cross_track(position: tuple[float, float], progress: int, expected: float) -> None:
    found = LINE.cross_track(np.array([position]), np.array([progress]), reach=0.25)
    assert found == pytest.approx([expected], abs=1e-12)


def test_cross_track_around_a_corner() -> None:
    """Outside the lower right corner the corner itself is nearest, inside it the nearer side."""
    positions = np.array([(1.53, -1.54), (1.4, -1.43)])
    found = square().cross_track(positions, np.array([600, 600]), reach=0.25)
    assert found == pytest.approx([0.05, 0.07], abs=1e-12)


def planned(
    path: Path,
    position: tuple[float, ...],
    progress: int,
    speed: float = 0.25,
    radius: float = 0.25,
) -> tuple[int, int, np.ndarray]:
    """New progress, target and command of a single flight."""
    planner = LookAhead(path, speed, radius)
    moved, target, command = planner.plan(np.array([position]), np.array([progress]))
    return int(moved[0]), int(target[0]), command[0]


def test_the_farthest_point_within_the_radius() -> None:
    """15 cm beside the line it reaches 20 cm ahead: 3-4-5, with a hair more against rounding."""
    progress, target, command = planned(LINE, (0.5, 0.15), 90, radius=0.2501)
    assert (progress, target) == (100, 140)
    np.testing.assert_allclose(command, (0.2, -0.15), atol=1e-12)


def test_the_closest_point_if_none_is_within_the_radius() -> None:
    progress, target, command = planned(LINE, (0.5, 0.4), 90, speed=0.5)
    assert (progress, target) == (100, 100)
    np.testing.assert_allclose(command, (0.0, -0.5), atol=1e-12)


def test_around_a_right_angle_as_the_paper_says() -> None:
    """15 cm before the corner, 20 cm of the next side are within 25 cm."""
    progress, target, command = planned(square(), (1.35, -1.5), 560, radius=0.2501)
    assert (progress, target) == (570, 640)
    np.testing.assert_allclose(command, (0.15, 0.2), atol=1e-12)


def test_a_path_that_crosses_itself_is_flown_straight_on() -> None:
    """At its crossing the lemniscate comes from the upper right, and then from the upper left."""
    path = lemniscate()
    quarter = round(path.last / 4)
    first, second = (planned(path, (0.0, 0.0), p - 20)[2] for p in (quarter, 3 * quarter))
    # the branches leave the crossing at 45 degrees and turn on by 2 degrees within 25 cm
    np.testing.assert_allclose(first, 0.25 * np.array([-1, -1]) / math.sqrt(2), atol=0.01)
    np.testing.assert_allclose(second, 0.25 * np.array([1, -1]) / math.sqrt(2), atol=0.01)


def test_a_neighbouring_loop_is_no_short_cut() -> None:
    """The spiral's next loop is 30 cm away, within a radius of 40 cm: its points are a loop later."""
    path = spiral()
    here = round(0.5 * path.last)
    progress, target, _ = planned(path, tuple(path.points[here]), here - 5, radius=0.4)
    assert progress == here
    assert 80 <= target - here <= 85  # 40 cm of chord, and a little more of path


def test_a_lap_goes_on_over_the_first_point() -> None:
    """The approach is flown again: 4 * 0.25 m = 200 points. Then it rests."""
    path = circle()
    planner = LookAhead(path)
    assert (planner.approach, planner.end) == (200, path.last + 200)
    start = tuple(path.points[0])
    for progress, moving in (
        (path.last - 10, True),
        (path.last + 195, True),
        (path.last + 200, False),
    ):
        here = start if progress < path.last else tuple(path.at(np.array(progress)))
        found = planned(path, here, progress)
        assert found[0] == max(progress, path.last)
        assert found[1] > path.last
        assert np.linalg.norm(found[2]) == pytest.approx(0.25 if moving else 0.0)


def test_a_point_that_obeys_exactly_follows_the_circle() -> None:
    """It settles where its command is a tangent: radius^2 + 0.25^2 = 1.5^2, 2.1 cm inside the path."""
    planner = LookAhead(circle())
    period = 0.01
    position = np.array([(1.4, -0.1)])
    progress = np.zeros(1, dtype=int)
    for _ in range(round(30.0 / period)):
        progress, _, command = planner.plan(position, progress)
        position = position + period * command
    error = planner.path.cross_track(position, progress, reach=0.25)
    # points 5 mm apart: the target is up to 5 mm nearer than 25 cm, the error (0.245 / 0.25)^2 of it
    assert error == pytest.approx([1.5 - math.sqrt(1.5**2 - 0.25**2)], abs=1e-3)
    # 1.479 m are flown while the path goes on by 1.5 m; the start takes a few centimetres
    assert progress[0] * SPACING == pytest.approx(30.0 * 0.25 * 1.5 / 1.479, rel=0.02)


@given(st.sampled_from(sorted(PATHS)), st.integers(0, 2**31), st.floats(0.02, 1.0))
def test_progress_never_goes_back_nor_jumps(name: str, seed: int, radius: float) -> None:
    """Wherever it is blown to: progress grows by a window at most, and the command keeps its length."""
    planner = LookAhead(PATHS[name](), 0.3, radius)
    position = np.random.default_rng(seed).normal(0.0, 1.5, (3, planner.path.dimension))
    before = np.array([0, planner.path.last // 2, planner.path.last - 1])
    after, target, command = planner.plan(position, before)
    assert ((after >= before) & (after <= before + planner.window)).all()
    assert ((target >= after) & (target <= after + planner.window)).all()
    lengths = np.linalg.norm(command, axis=1)
    assert lengths == pytest.approx(np.where(after < planner.end, 0.3, 0.0))
