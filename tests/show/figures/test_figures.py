from __future__ import annotations

import io
import subprocess
import sys
from itertools import count
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from matplotlib import legend
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from rans.flight import Flight, fly
from rans.model.spacecraft_file import load_spacecraft
from rans.model.timing import Timing
from rans.scenario import scenarios
from rans.show.curve import Rows, learning_charts
from rans.show.figures.chart_figure import charts_figure
from rans.show.figures.figures import (
    episode_figure,
    evaluation_figure,
)
from rans.show.figures.svg import svg
from rans.tasks import GoToPose
from tests.support.evaluation_flights import many_episodes, two_episodes
from tests.support.played import Played
from tests.support.training_rows import ROWS


def panel(figure: Figure, letter: str) -> Axes:
    return next(
        axes for axes in figure.axes if axes.get_title(loc="left").startswith(f"({letter})")
    )


def line(axes: Axes, label: str) -> np.ndarray:
    found = next(x for x in axes.get_lines() if x.get_label() == label)
    return np.asarray(found.get_xydata())


def spatial_flight() -> Flight:
    craft = load_spacecraft("free-flyer")
    task = GoToPose(spawn_distance=(3.0, 4.0))

    shut = Played(np.zeros((10, 5, 16)))
    return fly(craft, task, shut, scenarios(task, craft, 0, 5), Timing(episode_steps=10))


def test_every_axis_has_its_unit() -> None:
    for figure in (evaluation_figure(two_episodes()), episode_figure(two_episodes())):
        labels = [text for axes in figure.axes for text in (axes.get_xlabel(), axes.get_ylabel())]
        unitless = {label for label in labels if ", " not in label}
        # An index, a ratio, a sum of reward terms, and the axis shared with the panel below.
        assert unitless <= {"thruster", "error / tolerance", "reward per step", ""}


def test_summaries_show_mean_best_and_worst() -> None:
    figure = evaluation_figure(two_episodes())
    distance = panel(figure, "c")
    # Means over time: the first episode's 1 m start makes it the worst.
    assert line(distance, "worst episode")[0].tolist() == [0.0, 100.0]
    np.testing.assert_allclose(line(distance, "best episode")[-1], [5.0, 6.0])
    np.testing.assert_allclose(line(distance, "mean")[0], [0.0, 52.0])
    # In the reward panel best means most: the second episode never strays far.
    rewards = panel(figure, "h")
    assert line(rewards, "best episode")[0, 1] > line(rewards, "worst episode")[0, 1]
    np.testing.assert_allclose(line(panel(figure, "d"), "mean")[:, 1], 0.1)


def test_errors_and_their_tolerances_are_in_the_units_of_the_axis() -> None:
    """At most 100 cm and 10 degrees, where 5 cm and 5 degrees count as reached."""
    figure = evaluation_figure(two_episodes())
    for letter, most in (("b", 100.0), ("f", 10.0)):
        axes = panel(figure, letter)
        [drawn] = (x for x in axes.collections if isinstance(x, LineCollection))
        assert max(segment[:, 1].max() for segment in drawn.get_segments()) == pytest.approx(most)
        assert line(axes, "tolerance")[:, 1] == pytest.approx([5.0, 5.0])
    assert line(panel(figure, "c"), "tolerance")[:, 1] == pytest.approx([5.0, 5.0])


def test_every_episode_is_drawn_and_rasterised() -> None:
    figure = evaluation_figure(many_episodes(50))
    for letter in "bef":
        lines = next(x for x in panel(figure, letter).collections if isinstance(x, LineCollection))
        assert len(lines.get_segments()) == 50
        assert lines.get_rasterized()


@pytest.mark.slow
def test_spatial_flights_can_be_drawn() -> None:
    flight = spatial_flight()
    svg(evaluation_figure(flight))
    path = episode_figure(flight, 3).axes[0]
    assert path.name == "3d"
    assert cast(Any, path).get_zlabel() == "z, m"


def test_episode_figure_draws_that_episode() -> None:
    figure = episode_figure(two_episodes(), 1)
    path = panel(figure, "a").get_lines()[1].get_xydata()
    np.testing.assert_allclose(
        np.asarray(path)[-1], [-0.06, 0.0], atol=1e-12
    )  # the goal is the origin
    assert not np.asarray(panel(figure, "c").get_images()[0].get_array()).any()  # it fired nothing


@pytest.mark.slow
def test_equal_figures_give_equal_bytes() -> None:
    assert svg(episode_figure(two_episodes())) == svg(episode_figure(two_episodes()))


@pytest.mark.slow
def test_a_busy_machine_is_no_news(monkeypatch: pytest.MonkeyPatch) -> None:
    """Matplotlib warns if the place of a legend was found late, and warnings are errors here."""
    monkeypatch.setattr(legend, "time", SimpleNamespace(perf_counter=count(0, 10).__next__))
    figure = evaluation_figure(two_episodes())
    with pytest.warns(UserWarning, match="Creating legend"):
        figure.savefig(io.BytesIO(), format="svg")
    svg(figure)


def learning_figure(rows: Rows) -> Figure:
    return charts_figure([*learning_charts(rows)])


def test_learning_curve() -> None:
    success, returns = learning_figure(ROWS).axes
    np.testing.assert_allclose(success.get_lines()[0].get_xydata()[-1], [10_000, 100.0])  # type: ignore[index]
    assert {*returns.get_legend_handles_labels()[1]} == {"position", "attitude"}
    assert "5 s" in success.get_xlabel()


@pytest.mark.slow
def test_no_window_system_is_touched() -> None:
    code = "import sys, rans.show.figures.figures; print('matplotlib.pyplot' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
