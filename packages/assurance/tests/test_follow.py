"""Flights along a path: measured by hand on made-up motion, and flown by a simple tracker."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
import pytest
from rans_assurance.follow.follow import START_SPREAD, fly_path
from rans_assurance.follow.paths import LookAhead, circle, helix

from rans.files import plain
from rans.model.timing import Timing
from rans.tasks import TrackVelocity

from .path_flights import FLYER, LINE, PLATFORM, Tracker, by_hand, flown


def test_the_approach_does_not_count() -> None:
    """A flight that is still in it is judged by its last instant."""
    expected = [[0, 0], [1, 0], [1, 0], [1, 0], [1, 0], [0, 1]]
    np.testing.assert_array_equal(by_hand().measured, np.array(expected, dtype=bool))


@pytest.mark.parametrize(
    ("name", "first", "second"),
    [
        ("cross-track RMS", 100 * math.sqrt((2 * 0.03**2 + 2 * 0.04**2) / 4), 20.0),
        ("cross-track maximum", 4.0, 20.0),
        (
            "velocity error",
            10.0,
            40.0,
        ),  # 0.5, 0.5, 0.3, 0.3 m/s at the ends of the periods; at last 0.8
        ("speed error", 10.0, 40.0),
        ("duration", 2.5, math.inf),
        ("duty", 25.0, 0.0),  # half of the thrusters in two of four periods
    ],
)
def test_quantities_by_hand(name: str, first: float, second: float) -> None:
    values = {quantity.name: quantity.values for quantity in by_hand().quantities()}
    assert values[name] == pytest.approx([first, second], abs=1e-12)


def test_a_table_says_never_and_json_too() -> None:
    following = by_hand()
    assert "1 of 2 flights arrive" in following.title()
    table = json.loads(json.dumps(plain(following.to_json()), allow_nan=False))
    rows = {row["name"]: row for row in table["quantities"]}
    assert rows["duration"]["flights"] == [2.5, "inf"]
    assert rows["duration"]["worst"] == "inf"
    assert rows["cross-track maximum"]["mean"] == pytest.approx(12.0)
    cells = [row[2] for row in following.table().rows]
    assert cells == ["20 cm", "20 cm", "40 cm/s", "40 cm/s", "never", "25 %"]


def test_a_simple_tracker_follows_the_circle() -> None:
    """A perfect one is 2.1 cm inside; with pulses of 7.5 cm/s it should stay within three times that."""
    following = flown(LookAhead(circle()))
    values = {quantity.name: quantity.values for quantity in following.quantities()}
    assert (values["cross-track RMS"] < 6.0).all()
    assert (values["cross-track RMS"] > 0.1).all()
    # 1 m of approach and 9.42 m of lap at 0.25 m/s: 41.7 s, and some for the start and for detours
    assert ((values["duration"] > 38.0) & (values["duration"] < 50.0)).all()
    # never faster than commanded by more than a pulse
    assert np.linalg.norm(following.velocities, axis=2).max() < 0.25 + 0.15


def test_a_simple_tracker_follows_a_planar_and_a_spatial_path_in_space() -> None:
    for path in (circle(0.75), helix(0.75, 0.3, 1.0)):
        following = flown(LookAhead(path), FLYER, count=3)
        values = {quantity.name: quantity.values for quantity in following.quantities()}
        assert np.isfinite(values["duration"]).all()
        # a perfect one is (0.25 m)^2 / (2 * 0.75 m) = 4.2 cm inside; three times that
        assert (values["cross-track RMS"] < 12.6).all()


def test_starts_are_near_the_first_point_and_different() -> None:
    following = flown(LookAhead(LINE), count=32)
    offset = np.linalg.norm(following.positions[0] - LINE.points[0], axis=1)
    assert offset.max() <= START_SPREAD
    assert len(np.unique(offset)) == len(np.unique(following.flight.states.attitude.angle[0])) == 32
    assert not following.velocities[0].any()
    again = flown(LookAhead(LINE), count=32)
    np.testing.assert_array_equal(following.positions, again.positions)


def test_it_rests_at_the_end_of_an_open_path() -> None:
    following = flown(LookAhead(LINE))
    arrived = following.progress >= LINE.last
    assert arrived[-1].all()
    assert not following.commands[arrived].any()
    # what a pair cannot undo: 0.0376 m/s along each of two axes
    assert np.linalg.norm(following.velocities[-1], axis=1).max() < 0.0376 * math.sqrt(2) + 1e-9


def test_the_tracker_sees_the_command_as_its_goal() -> None:
    seen: list[np.ndarray] = []

    class Watching(Tracker):
        def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
            seen.append(observation)
            return super().act(state, goal, observation)

    task = TrackVelocity()
    following = fly_path(PLATFORM, task, Watching(PLATFORM), LookAhead(LINE), Timing(), 5, 2)
    wanted = following.commands - following.velocities[:-1]
    np.testing.assert_allclose(np.stack(seen)[:, :, 6:8], wanted, atol=1e-7)  # float32


def test_drake_follows_as_we_do() -> None:
    """The goal moves with the spacecraft, whoever moves that: same commands, ways apart by rounding."""
    planner = LookAhead(LINE, speed=0.25, radius=0.1)
    ours, drakes = (
        fly_path(
            PLATFORM,
            TrackVelocity(),
            Tracker(PLATFORM),
            planner,
            Timing(),
            seed=5,
            count=2,
            engine=engine,
        )
        for engine in ("fast", "drake")
    )
    assert drakes.flight.engine == "drake"
    np.testing.assert_array_equal(drakes.progress, ours.progress)
    np.testing.assert_array_equal(drakes.flight.commands, ours.flight.commands)
    # Drake's Runge-Kutta at 0.01 s: 1e-12 m in 25 s (`rans.reference.plant`)
    np.testing.assert_allclose(drakes.positions, ours.positions, rtol=0, atol=1e-10)
    assert np.ptp(drakes.flight.goals.v.x, axis=0).min() > 0.01  # the command did change


@pytest.mark.parametrize(("look_ahead", "arrives"), [(0.1, True), (0.45, False)])
def test_a_lap_that_is_cut_is_none(look_ahead: float, arrives: bool) -> None:
    """By hand: around a circle of 0.5 m at sqrt(0.5^2 - L^2), 0.98 and 0.44 of its radius."""
    following = flown(LookAhead(circle(0.5), radius=look_ahead), count=4)
    assert following.progress.max() >= following.planner.end  # the planner counts both as done
    assert np.isfinite(following.durations).all() == arrives
    assert np.isfinite(following.durations).any() == arrives
