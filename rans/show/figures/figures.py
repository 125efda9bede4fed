"""Figures of flights and trainings, for reports and papers.

Every function returns a `matplotlib.figure.Figure` that nobody else holds: no window, no global state.
Colours are those of Okabe and Ito ("Color Universal Design", 2008), which everybody can tell apart.
"""

from __future__ import annotations

from pathlib import Path

from rans.base.files import write_text
from rans.episode.flight import Flight
from rans.show.charts import flight_charts
from rans.show.figures import panels
from rans.show.figures.chart_figure import charts_figure
from rans.show.figures.panels import styled
from rans.show.figures.plotting import Figure
from rans.show.figures.svg import svg


@styled
def episode_figure(flight: Flight, episode: int = 0) -> Figure:
    """One episode of the batch: its path with headings and zones, its errors, and when each thruster fired."""
    figure = Figure(figsize=(9.4, 4.6), layout="constrained")
    cells = figure.add_gridspec(1, 2, width_ratios=(1.0, 1.3))
    left = figure.add_subfigure(cells[0])
    right = figure.add_subfigure(cells[1])
    panels.path(left, flight, episode)
    stack = right.subplots(2, 1, sharex=True)
    panels.episode_errors(stack[0], flight, episode)
    panels.timeline(stack[1], flight, episode)
    return figure


def save_flight_figures(flight: Flight, folder: Path, suffix: str) -> None:
    """Write ``evaluation.svg`` and, of the first episode, ``episode.svg``, the suffix before the dot."""
    figures = {
        "evaluation": charts_figure([*flight_charts(flight)]),
        "episode": episode_figure(flight),
    }
    for name, figure in figures.items():
        write_text(folder / f"{name}{suffix}.svg", svg(figure))
