"""What people read of an evaluation, line by line: flights of which every figure is worked out by hand."""

from __future__ import annotations

import io
import math
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from rans import Timing
from rans.base.terminal import rendered
from rans.episode.flight import fly
from rans.episode.scenario import scenarios
from rans.evaluation.fly.contestants import contestant
from rans.evaluation.measure.aggregate import Metric, Metrics, measure, save_episodes
from rans.model.fields import Vec2
from tests.support.evaluation_flights import TrackNothing, flight_of, two_episodes

LINES = """\
success | solved | 50 % | 9.45 to 90.5 | within all tolerances at every step of the last fifth
success | solved in the mean | 100 % | 34.2 to 100 | mean errors of the last fifth within tolerances
success | settling time | never | 2.5 to never | median time to enter and stay
success | failed | 0 % | 0 to 65.8 | declared failed by the task at any time
success | first in the goal set | never | 0 to never \
| median first time within all tolerances and below 5 cm/s, 5 deg/s
success | stays in the goal set | 0 % | 0 to 65.8 | within all of these from then on, at every instant
success | solved to 5 cm 3 deg / 2 cm 2 deg / 1 cm 1 deg | 50 / 50 / 50 % | up to ± 40.5 \
| within so much at every step of the last fifth
position | PT10 / 5 / 2 / 1 | 90 / 85 / 25 / 15 % | up to ± 25 \
| time steps with position error below so many cm
position | reach 2 cm / 1 cm | 50 / 50 % | up to ± 40.5 | ever closer than that
position | stay 15 cm | 50 % | 9.45 to 90.5 | once closer than 2 cm, never farther than that
position | position error | 2.45 cm | 0.4 to 4.5 | mean over the last fifth
attitude | OT5 / 2 / 1 | 80 / 70 / 65 % | up to ± 35 | time steps with attitude error below so many deg
attitude | reach 5 deg / 2.5 deg | 100 / 100 % | up to ± 65.8 | ever closer than that
attitude | stay 37 deg | 100 % | 34.2 to 100 | once closer than 5 deg, never farther than that
attitude | attitude error | 0.25 deg | 0 to 0.5 | mean over the last fifth
motion | speed | 0.25 m/s | 0 to 0.5 | mean linear speed (ALV)
motion | spin | 0.1 rad/s | 0 to 0.2 | mean angular speed (AAV)
motion | spin at rest | 0.1 rad/s | 0 to 0.2 | the same over the last fifth
effort | duty | 2.5 % | 0 to 5 | mean duty cycle of the thrusters (AAC)
effort | duty at rest | 0 % | 0 to 0 | the same over the last fifth
effort | openings | 0.5 | 0 to 1 | times a thruster opens, an episode
effort | on-time | 1 s | 0 to 2 | thruster-seconds an episode
effort | impulse | 1 N s | 0 to 2 | thrust spent an episode
"""
"""Of two episodes, `tests.support.evaluation_flights.two_episodes`: a mean of two, resampled, is the one, the other
or half of both, each with a quarter or more, so that intervals are from the one's to the other's. Those of
shares of episodes are Wilson's, with z^2 = 3.84: of one of two (50 +- 40.5) %, of none up to z^2 / (2 + z^2).
"""


def printed(measured: Metrics, width: int) -> list[list[str]]:
    """Lines of a table, cell by cell."""
    console = Console(file=io.StringIO(), width=width)
    console.print(rendered(measured.table(width)))
    text = console.file.getvalue()  # type: ignore[attr-defined]
    return [
        [cell.strip() for cell in line.replace("┃", "│").split("│") if cell.strip()]
        for line in text.splitlines()
    ]


def test_every_line_of_two_episodes():
    lines = [" | ".join((group, *texts)) for group, texts in measure(two_episodes()).lines()]
    assert lines[:-1] == LINES.splitlines()
    assert lines[-1].startswith("effort | return | ")


def test_lines_of_a_tracker_have_their_units():
    """Twelve steps of half a second: after 5 s only 0.25 and 0.75 m/s count."""
    flight = flight_of(np.ones((13, 1)), 0.0, spin=-0.2, task=TrackNothing())
    speed = np.array([9.0] * 11 + [0.25, 0.75])[:, None]
    flight = replace(flight, states=replace(flight.states, v=Vec2(speed, 0.0 * speed)))
    shown = {texts[0]: texts[1] for _, texts in measure(flight).lines()}
    assert shown["velocity error"] == "50 cm/s"
    assert shown["velocity error after 5 s"] == "0.5 m/s"
    assert shown["spin error"] == "11.5 deg/s"
    assert shown["spin error after 5 s"] == "0.2 rad/s"
    assert shown["ST20 / 10 / 5 / 2 / 1"] == "100 / 0 / 0 / 0 / 0 %"
    assert shown["VT10 / 5 / 2 / 1"] == "0 / 0 / 0 / 0 %"


def test_a_narrow_terminal_breaks_no_figure():
    text = "\n".join(" | ".join(line) for line in printed(measure(two_episodes()), 80))
    assert "85 / 25 / 15 %" in text
    assert "…" not in text
    assert "within all tolerances" not in text
    assert "A terminal of 110 columns or more shows what each of them means." in text


def test_the_widest_of_several_intervals_is_shown():
    rows = tuple(Metric("g", f"P{k}", "m", "%", 50.0, 50.0 - k, 50.0 + k / 2) for k in (1, 7, 3))
    ((_, texts),) = Metrics("c", "fast", "s", 1, 1, 0.2, rows).lines()
    assert texts == ("P1 / 7 / 3", "50 / 50 / 50 %", "up to ± 7", "m")


def test_a_metric_that_is_not_there_is_told_with_those_that_are():
    measured = measure(two_episodes())
    assert measured["PT10"].value == 90.0
    with pytest.raises(KeyError, match=r"no metric 'solvd' \(did you mean solved\?\).* PT10, "):
        measured["solvd"]


@pytest.mark.parametrize(
    ("estimates", "limits"),
    [
        ([(math.inf, math.inf, math.inf)] * 2, "never"),
        ([(6.0, 5.0, 8.0), (math.inf, math.inf, math.inf)], "up to ± 2"),
        ([(6.0, 5.0, 8.0), (math.inf, 7.0, math.inf)], "up to never"),
        ([(6.0, 5.0, 8.0), (7.0, 6.0, math.inf)], "up to never"),
    ],
)
def test_intervals_of_times_that_never_come(estimates, limits):
    rows = tuple(Metric("g", "arrival", "m", "s", *estimate) for estimate in estimates)
    ((_, texts),) = Metrics("c", "fast", "s", 1, 1, 0.2, rows).lines()
    assert texts[2] == limits


def test_every_metric_of_every_episode(tmp_path):
    flight = two_episodes()
    file = tmp_path / "episodes.npz"
    save_episodes(flight, file)
    with np.load(file) as read:
        episodes = dict(read)
    assert episodes["settling_time"].tolist() == [2.5, np.inf]
    assert episodes["PT5"].tolist() == [80.0, 90.0]
    for row in measure(flight).rows:
        values = episodes[row.name.replace(" ", "_")]
        centre = np.median if row.name == "settling time" else np.mean
        # float32 in the file
        np.testing.assert_allclose(centre(values), row.value, rtol=1e-6, atol=1e-6)
    # The goal is at (2, -1), the episodes start 1 m and 4 cm west of it.
    np.testing.assert_allclose(episodes["start"][:, :2], [[1.0, -1.0], [1.96, -1.0]], atol=1e-6)
    assert "states" not in episodes


def test_trajectories_of_both_dimensions(tmp_path):
    for dimension in (2, 3):
        loaded = contestant(f"lqr:go-to-pose-{dimension}d")
        craft = loaded.craft
        task = loaded.task
        flight = fly(
            craft, task, loaded.controller, scenarios(task, craft, 1, 3), Timing(episode_steps=4)
        )
        save_episodes(flight, tmp_path / "episodes.npz", trajectories=True)
        with np.load(tmp_path / "episodes.npz") as read:
            episodes = dict(read)
        column = dict(
            zip(episodes["columns"].tolist(), np.moveaxis(episodes["states"], 2, 0), strict=True)
        )
        np.testing.assert_allclose(column["v_y"], flight.states.v.y, atol=1e-6)
        np.testing.assert_allclose(column["y"], flight.states.p.y, atol=1e-6)
        last = flight.states.spin()[-1]
        np.testing.assert_allclose(column["w_z"], last, atol=1e-6)
        np.testing.assert_array_equal(episodes["commands"], flight.commands)
        assert episodes["times"].shape == (5,)
