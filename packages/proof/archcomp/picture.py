"""Picture of starts of the single pendulum: proved, refuted and open cells.

`python packages/proof/archcomp/picture.py FOLDER PICTURE.svg`; the folder has the organisers' network. The starts
are more than those of the problem, which is the frame.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from rans_proof.flights import lowest_margins
from rans_proof.network import network_of
from rans_proof.problem import read_problem
from rans_proof.prove import ClosedLoop
from run import ROWS, networks  # pyrefly: ignore[missing-import]

from rans.extend import Figure, ListedColormap
from rans.show.figures.plotting import Rectangle, rcParams

LOWER, UPPER = (0.9, -0.2), (1.4, 0.6)
"""Starts of the picture: angle (rad) and rate (rad/s)."""
CELLS = 40
"""Cells along each."""


def draw(folder: Path, picture: Path) -> None:
    """Judge and draw the cells."""
    row = ROWS["single-pendulum"]
    problem = read_problem(row.problem)
    layers = network_of(networks(folder)[row.sha256], "the network", problem.input_range())
    wide = replace(problem, lower=LOWER, upper=UPPER)
    edges = [np.linspace(low, high, CELLS + 1) for low, high in zip(LOWER, UPPER, strict=True)]
    low, high = (
        np.stack(np.meshgrid(*(edge[part] for edge in edges), indexing="ij"), axis=2).reshape(-1, 2)
        for part in (slice(None, -1), slice(1, None))
    )
    proved = ClosedLoop(wide, layers, torch.device("cpu")).margins(low, high)[0] > 0.0
    # A cell is refuted if its middle or a corner breaks the property.
    corners = [np.where(side, high, low) for side in ((0, 0), (0, 1), (1, 0), (1, 1))]
    flown = [lowest_margins(wide, layers, start) for start in (0.5 * (low + high), *corners)]
    broken = np.min(flown, axis=0) < 0.0
    assert not (proved & broken).any(), "a flight from a proved cell breaks the property"
    verdicts = np.where(proved, 1.0, np.where(broken, 2.0, 0.0)).reshape(CELLS, CELLS)
    rcParams["svg.hashsalt"] = "rans"  # the same picture has the same bytes
    figure = Figure(figsize=(5.5, 3.6), layout="constrained")
    axis = figure.subplots()
    colors = ListedColormap(["#d9d9d9", "#2a7f62", "#c8553d"])
    mesh = axis.pcolormesh(*edges, verdicts.T, cmap=colors, vmin=0, vmax=2)
    mesh.set_rasterized(True)
    sides = np.subtract(problem.upper, problem.lower)
    begin = float(problem.lower[0]), float(problem.lower[1])
    axis.add_patch(Rectangle(begin, *sides, fill=False, edgecolor="black", linewidth=1.5))
    axis.set_xlabel("angle at the start, rad")
    axis.set_ylabel("rate at the start, rad/s")
    axis.set_title("Proved (green), refuted (red), open (gray)", fontsize=11)
    figure.savefig(picture, metadata={"Date": None})
    counts = [int((verdicts == k).sum()) for k in (1, 2, 0)]
    figure.clear()
    sys.stdout.write("{} proved, {} refuted, {} open cells\n".format(*counts))


if __name__ == "__main__":
    draw(Path(sys.argv[1]), Path(sys.argv[2]))
