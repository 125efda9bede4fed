from __future__ import annotations

import subprocess
import sys
from typing import Any, cast

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rans import GoToPose, Timing
from rans.episode.flight import Flight, fly
from rans.episode.scenario import scenarios
from rans.model.spacecraft_file import load_spacecraft
from rans.show.charts import Rows, flight_charts, learning_charts
from rans.show.figures.chart_figure import charts_figure
from rans.show.figures.figures import episode_figure
from rans.show.figures.svg import svg
from tests.support.comparisons import points
from tests.support.evaluation_flights import many_episodes, two_episodes
from tests.support.played import Played
from tests.support.training_rows import ROWS


def panel(figure: Figure, letter: str) -> Axes:
    return next(
        axes for axes in figure.axes if axes.get_title(loc="left").startswith(f"({letter})")
    )


def spatial_flight() -> Flight:
    craft = load_spacecraft("free-flyer")
    task = GoToPose(spawn_distance=(3.0, 4.0))

    shut = Played(np.zeros((10, 5, 16)))
    return fly(craft, task, shut, scenarios(task, craft, 0, 5), Timing(episode_steps=10))


def charts(flight: Flight) -> dict[str, Axes]:
    """The axes of all episodes, by their labels along y."""
    drawn = charts_figure([*flight_charts(flight)]).axes
    return {axes.get_ylabel().removesuffix(" (logarithmic)"): axes for axes in drawn}


def test_every_axis_has_its_unit():
    figures = charts_figure([*flight_charts(two_episodes())]), episode_figure(two_episodes())
    for figure in figures:
        labels = [text for axes in figure.axes for text in (axes.get_xlabel(), axes.get_ylabel())]
        unitless = {label for label in labels if ", " not in label}
        # An index, a ratio, a sum of reward terms, and the axis shared with the panel below.
        assert unitless <= {"thruster", "error / tolerance", "reward per step", ""}


def test_charts_show_mean_best_and_worst():
    found = charts(two_episodes())
    # Means over time: the first episode's 1 m start makes it the worst.
    assert points(found["position error, cm"])["worst episode"][0] == [0.0, 100.0]
    assert points(found["position error, cm"])["best episode"][-1] == pytest.approx([5.0, 6.0])
    shown = ("position error, cm", "angular speed, rad/s")
    means = {label: points(found[label])["mean (shaded: 5 to 95 %)"] for label in shown}
    assert means["position error, cm"][0] == pytest.approx([0.0, 52.0])
    assert [y for _, y in means["angular speed, rad/s"]] == pytest.approx([0.1] * 11)
    # Of rewards the best are most: the second episode never strays far.
    rewards = points(found["reward per step"])
    assert rewards["best episode"][0][1] > rewards["worst episode"][0][1]


def test_errors_and_their_tolerances_are_in_the_units_of_the_axis():
    """At most 100 cm and 10 degrees, where 5 cm and 5 degrees count as reached."""
    found = charts(two_episodes())
    for label, largest in (("position error, cm", 100.0), ("attitude error, deg", 10.0)):
        drawn = points(found[label])
        assert max(y for _, y in drawn["worst episode"]) == pytest.approx(largest)
        assert [y for _, y in drawn["tolerance"]] == pytest.approx([5.0, 5.0])
        assert found[label].get_yscale() == "log"
        assert found[label].get_xscale() == "linear"


def test_a_band_is_the_middle_of_many_episodes():
    """50 starts and a file whose size does not grow with them."""
    flight = many_episodes(50)
    error = 100.0 * flight.errors()["position"]
    (band,) = charts(flight)["position error, cm"].collections
    (path,) = band.get_paths()
    low, high = path.vertices[:, 1].min(), path.vertices[:, 1].max()  # type: ignore[index]
    assert high == pytest.approx(np.percentile(error, 95, axis=1).max())
    assert low == pytest.approx(max(0.01, np.percentile(error, 5, axis=1).min()))


@pytest.mark.slow
def test_spatial_flights_can_be_drawn():
    flight = spatial_flight()
    svg(charts_figure([*flight_charts(flight)]))
    path = episode_figure(flight, 3).axes[0]
    assert path.name == "3d"
    assert cast(Any, path).get_zlabel() == "z, m"


def test_episode_figure_draws_that_episode():
    figure = episode_figure(two_episodes(), 1)
    path = panel(figure, "a").get_lines()[1].get_xydata()
    np.testing.assert_allclose(
        np.asarray(path)[-1], [-0.06, 0.0], atol=1e-12
    )  # the goal is the origin
    assert not np.asarray(panel(figure, "c").get_images()[0].get_array()).any()  # it fired nothing


@pytest.mark.slow
def test_equal_figures_give_equal_bytes():
    assert svg(episode_figure(two_episodes())) == svg(episode_figure(two_episodes()))


def learning_figure(rows: Rows) -> Figure:
    return charts_figure([*learning_charts(rows)])


def test_learning_curve():
    success, returns = learning_figure(ROWS).axes
    np.testing.assert_allclose(success.get_lines()[0].get_xydata()[-1], [10_000, 100.0])  # type: ignore[index]
    assert {*returns.get_legend_handles_labels()[1]} == {"position", "attitude"}
    assert "5 s" in success.get_xlabel()


@pytest.mark.slow
def test_no_window_system_is_touched():
    code = "import sys, rans.show.figures.figures; print('matplotlib.pyplot' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
