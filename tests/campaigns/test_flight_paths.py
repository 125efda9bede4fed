"""Pictures of missions: what is drawn where."""

from __future__ import annotations

import numpy as np
import pytest
from rans_missions.tasks import Avoid, Dock, DockPort, Hold
from rans_missions.tasks.orbital import TargetOrbit

from campaigns.flight_paths import paths_figure
from rans.flight import Flight, fly
from rans.model.spacecraft_file import load_spacecraft
from rans.model.timing import Timing
from rans.optimal.control.lqr import LQR
from rans.scenario import scenarios
from rans.tasks import GoToPose, Task
from tests.support.played import Played


def flown(craft_name: str, task: Task, steps: int = 5, count: int = 4) -> Flight:
    """Short flights of a coasting craft."""
    craft = load_spacecraft(craft_name)
    starts = scenarios(task, craft, 7, count)

    coasting = Played(np.zeros((steps, count, craft.command_count)))
    return fly(craft, task, coasting, starts, Timing(episode_steps=steps))


def test_an_orbit_has_its_ball_in_two_views() -> None:
    """Along the track is to the right; the ball of 50 m is whole although no path goes around it."""
    flight = flown("vbar-chaser", Hold())
    paths = paths_figure(flight)
    in_plane, across = paths.axes
    assert (in_plane.get_ylabel(), across.get_ylabel()) == (
        "radially outwards, m",
        "across the orbit, m",
    )
    path = in_plane.lines[0].get_xydata()
    np.testing.assert_allclose(np.asarray(path)[0, 0], flight.states.p.y[0, 0])
    left, right = in_plane.get_xlim()
    assert left < -50.0
    assert right > 50.0
    [legend] = paths.legends
    [name] = [text.get_text() for text in legend.get_texts() if "zone" in text.get_text()]
    assert name == "keep-out zone"


@pytest.mark.slow
def test_other_orbits_have_the_views_of_a_circle() -> None:
    labels = [
        [axes.get_xlabel() for axes in paths_figure(flown("afrl-deputy", Dock(orbit=orbit))).axes]
        for orbit in (TargetOrbit(), TargetOrbit(0.5, 13_556.0), TargetOrbit(oblate=True))
    ]
    assert labels[0] == labels[1] == labels[2] == ["along the track, m"] * 2


@pytest.mark.parametrize("task", [Avoid(), DockPort()])
def test_flights_with_zones_of_their_own_have_panels(task: Task) -> None:
    """Three of four flights are drawn, each with what is around it."""
    figure = paths_figure(flown("floating-platform", task))
    assert [axes.get_title(loc="left") for axes in figure.axes] == [
        "episode 0",
        "episode 1",
        "episode 2",
    ]


def test_flights_without_zones_share_a_panel() -> None:
    task = GoToPose()
    craft = load_spacecraft("floating-platform")
    starts = scenarios(task, craft, 7, 4)
    flight = fly(craft, task, LQR(craft, task), starts, Timing(episode_steps=5))
    [axes] = paths_figure(flight).axes
    assert sum(len(np.asarray(line.get_xydata())) == 6 for line in axes.lines) == 4
