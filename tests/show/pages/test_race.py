"""What a page's replay is given, worked by hand."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

import rans
from rans.episode.flight import fly
from rans.episode.scenario import scenarios
from rans.show.pages.page import Page, Section
from rans.show.pages.race import Race, Track, race
from tests.support.browser import opened, served
from tests.support.played import Played
from tests.support.random_flights import thrusting

PLATFORM = rans.load_spacecraft("floating-platform")
POSE = rans.GoToPose()


def test_positions_axes_and_commands_are_the_flights():
    flight = thrusting(PLATFORM, POSE, 6)
    (start,) = race(PLATFORM, [("worst", [Track("a", flight, 1, 0.8)])]).data["starts"]
    (track,) = start["tracks"]
    np.testing.assert_allclose(
        track["p"], np.stack([flight.states.p.x[:, 1], flight.states.p.y[:, 1]], 1), atol=5e-4
    )
    c = np.cos(flight.states.attitude.angle[:, 1])
    s = np.sin(flight.states.attitude.angle[:, 1])
    np.testing.assert_allclose(track["e"], np.stack([c, s, -s, c], 1), atol=5e-4)
    assert [[int(x) for x in text] for text in track["u"]] == (9 * flight.commands[:, 1]).astype(
        int
    ).tolist()
    assert (start["label"], start["period"], start["turned"]) == ("worst", 0.2, True)
    # a goal that stands still is given once
    assert len(start["goal"]["p"]) == 1


def test_zones_move_as_those_of_the_flight_and_a_slope_is_given_once():
    task = rans.load_task("avoid")
    zones = scenarios(task, PLATFORM, seed=5, count=2).goal.notes.zones
    flight = thrusting(PLATFORM, task, 6)
    (start,) = race(PLATFORM, [("x", [Track("a", flight, 1, 0.8)])]).data["starts"]
    assert [shape["kind"] for shape in start["shapes"]] == ["Ball"] * 3
    for zone, shape in zip(zones, start["shapes"], strict=True):
        # Centre, velocity and radius after 0, 0.2, ... 1.2 s.
        x = zone.centre.x[1] + zone.v.x[1] * 0.2 * np.arange(7)
        np.testing.assert_allclose([row[0] for row in shape["rows"]], x, atol=6e-4)
        assert shape["rows"][0][4] == pytest.approx(zone.radius[1], abs=6e-4)
    land = rans.load_task("land")
    lander = rans.load_spacecraft("mars-lander-steered")
    starts = scenarios(land, lander, seed=5, count=1)
    # All nine thrusters at their least.
    least = Played(np.zeros((3, 1, 9)))
    flight = fly(lander, land, least, starts, replace(land.timing, episode_steps=3))
    (start,) = race(lander, [("x", [Track("a", flight, 0, 0.8)])]).data["starts"]
    ((slope,),) = [shape["rows"] for shape in start["shapes"] if shape["kind"] == "GlideSlope"]
    assert slope[3:] == [0.0, 0.0, 1.0, pytest.approx(np.radians(4.0), abs=6e-4)]


def test_points_are_seen_from_the_instant_on_at_which_the_mission_counts_them():
    craft = rans.load_spacecraft("afrl-deputy")
    flight = thrusting(craft, rans.load_task("inspect"), 4)
    (start,) = race(craft, [("x", [Track("a", flight, 0, np.inf)])]).data["starts"]
    counted = [sum(0 <= row[3] <= k for row in start["markers"]) for k in range(5)]
    assert counted == flight.goals.notes.count[:, 0].tolist()


@pytest.mark.parametrize("replay", [None, Race({"starts": ["</script><b>"]}, "two & one")])
def test_only_a_page_with_a_replay_has_a_script_and_its_data_is_no_markup(replay):
    html = Page("x", [Section("s", race=replay)]).html()
    assert html.count("<script") == (2 if replay else 0)
    assert "<b>" not in html
    if replay:
        text = re.search(r'<script type="application/json">(.*?)</script>', html)
        assert text
        assert json.loads(text[1]) == replay.data


@pytest.mark.slow
def test_a_replay_plays_although_its_first_frame_began_before_it(tmp_path):
    """Browsers tell when a frame began, which may be before the script asked for it."""
    replay = race(PLATFORM, [("x", [Track("a", thrusting(PLATFORM, POSE, 6), 1, 0.8)])], plays=True)
    late = "<script>const was = performance.now.bind(performance); performance.now = () => was() + 500;"
    mistakes = "onerror = text => { document.documentElement.dataset.mistake = text; };</script>"
    html = late + mistakes + Page("x", [Section("s", race=replay)]).html()
    with served({"/": html}) as (address, _):
        shown = opened(f"{address}/", tmp_path)
    assert "data-mistake" not in shown
    assert 'class="cursor"' in shown
