"""A page that replays flights in the browser without Drake."""

from __future__ import annotations

import re
import sys
from dataclasses import replace

import numpy as np
import pytest

import rans
from rans.show.pages.page import Page
from rans.show.pages.race import Race
from rans.show.pages.replay import replay_page
from tests.support.browser import opened, served
from tests.support.random_flights import thrusting

PLATFORM = rans.load_spacecraft("floating-platform")
FLYER = rans.load_spacecraft("free-flyer")


def races(page: Page) -> list[Race]:
    return [section.race for section in page.sections if section.race is not None]


def test_flights_from_the_same_starts_share_a_picture():
    flights = [
        thrusting(PLATFORM, rans.GoToPose()),
        thrusting(FLYER, rans.GoToPose()),
        thrusting(PLATFORM, rans.GoToPose()),
        replace(thrusting(PLATFORM, rans.GoToPose(), seed=6), first=7),
    ]
    starts = [each.data["starts"] for each in races(replay_page(flights, "all"))]
    assert [len(each[0]["tracks"]) for each in starts] == [2, 1, 1]
    assert all(len(each) == 2 for each in starts)
    assert [each[1]["label"] for each in starts] == ["episode 1", "episode 1", "episode 8"]
    assert "v" not in starts[0][0]["tracks"][0]
    # Every flight has a colour of its own among all.
    colours = [track["colour"] for each in starts for track in each[0]["tracks"]]
    assert len(set(colours)) == 4


def test_a_velocity_to_follow_is_given_with_that_of_the_craft():
    flight = thrusting(PLATFORM, rans.TrackVelocity())
    (start, _) = races(replay_page([flight], "t"))[0].data["starts"]
    (track,) = start["tracks"]
    assert start["follows"]
    expected = np.stack([flight.states.v.x[:, 0], flight.states.v.y[:, 0]], 1)
    np.testing.assert_allclose(track["v"], expected, atol=5e-4)
    assert start["goal"]["v"][0][0] == pytest.approx(np.ravel(flight.goals.v.x)[0], abs=5e-4)


@pytest.mark.slow
def test_a_browser_draws_it(tmp_path):
    """After its scripts have run, every flight has its distance, or the error of its velocity."""
    flights = [thrusting(PLATFORM, rans.GoToPose()), thrusting(FLYER, rans.TrackVelocity())]
    with served({"/": replay_page(flights, "t").html()}) as (address, _):
        page = opened(f"{address}/", tmp_path)
    assert re.findall(r'class="now">[\d.]+ (m|m/s) off · [\d.]+ thruster-s', page) == ["m", "m/s"]


def test_a_replay_needs_no_drake_and_plays_by_itself(monkeypatch):
    monkeypatch.setitem(sys.modules, "pydrake", None)
    page = rans.view("lqr:go-to-pose-2d")
    assert "<title>go-to-pose, floating-platform</title>" in page.html()
    (replay,) = races(replay_page(page.flights, page.title))
    assert replay.data["plays"]
