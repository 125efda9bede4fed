"""Flights by the agents for any craft have these figures, however columns and allocation are computed."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from rans.base.pretrained import FOR_ANY_CRAFT, pretrained_folder
from rans.evaluation.fly.agent import load_policy
from rans.evaluation.fly.any_craft import for_spacecraft, frugal
from rans.evaluation.fly.contestants import contestant
from rans.evaluation.fly.episodes import fly_episodes
from rans.evaluation.measure.aggregate import measure
from rans.fast.flights import Flights
from rans.model.spacecraft_file import USUAL, load_spacecraft


@pytest.mark.parametrize(
    ("name", "seconds", "time", "impulse"),
    [
        # On/off thrusters that hold the pose by pulses, or fly as fast as they can along each way.
        ("any-craft-2d#1@floating-platform", 6.0, 3.85, 2.1),
        ("any-craft-2d#0@floating-platform", 6.0, 1.7, 6.4292),
        ("any-craft-2d#0.4@floating-platform-shared", 6.0, 3.2, 3.2667),
        # Pulsed and throttled ones, wheels, and finer tolerances.
        ("any-craft-2d#0.9@pingu", 6.0, 3.4, 8.2819),
        ("any-craft-2d#0.6,2cm@freeflyer2", 15.0, 8.2, 2.875),
        ("any-craft-3d#0@spheres", 9.0, 4.8, 1.893),
        ("any-craft-3d#0.8@free-flyer", 6.0, 2.15, 6.7125),
        pytest.param("any-craft-3d#0.3@cubesat-6u", 60.0, 17.0, 2.622, marks=pytest.mark.slow),
    ],
)
def test_all_settle_in_a_time_with_an_impulse(name, seconds, time, impulse):
    """Median settling time, s, and mean impulse, N s, of 24 flights; the on/off ones amplify roundings.

    They begin near the goal, where networks, allocation and holding have most to do.
    """
    run = contestant(name)
    asked: Any = run.task
    task = replace(asked, evaluation_distance=(0.3, 0.6))
    timing = replace(run.timing, episode_steps=round(seconds / run.timing.control_period))
    flight = fly_episodes(
        run.controller, run._replace(task=task, timing=timing).judged, 11, 24, workers=1
    )
    rows = {row.name: row.value for row in measure(flight).rows}
    assert rows["solved"] == 100.0
    assert rows["settling time"] == pytest.approx(time, rel=0.01)
    assert rows["impulse"] == pytest.approx(impulse, rel=0.01)


@pytest.mark.parametrize("dimension", [2, pytest.param(3, marks=pytest.mark.slow)])
def test_more_thrusters_of_less_force_are_as_quick(dimension):
    """Two in place of each, of the same force together."""
    craft = load_spacecraft(USUAL[dimension])
    parts = [
        replace(one, force=0.5 * one.force, position=(way * one.position[0], *one.position[1:]))
        for one in craft.thrusters
        for way in (0.98, 1.02)
    ]
    own = load_policy(pretrained_folder(FOR_ANY_CRAFT[dimension]))
    times = []
    for flown in (craft, replace(craft, thrusters=tuple(parts))):
        run = frugal(for_spacecraft(own, flown), 0.4)
        times.append(Flights(run.network, run.judged).fly(0, 48, 11).settling_step())
    assert times[1] <= 1.1 * times[0]
