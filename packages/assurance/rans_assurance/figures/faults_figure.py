"""The figure of what a spacecraft can do without."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from rans.extend import Figure, Spacecraft, label, styled
from rans.randomization.conditions import FaultKind
from rans.randomization.faults import FaultSet
from rans.show.figures.plotting import ListedColormap
from rans.show.palette import GREEN, RED


@styled
def faults_figure(
    craft: Spacecraft, result: Mapping[tuple[FaultKind, int], Sequence[FaultSet]]
) -> Figure:
    """A square for every pair of failed thrusters, on the diagonal for one: green if recoverable.

    Args:
        craft: the spacecraft.
        result: sets by kind of fault and number of thrusters.
    """
    count = craft.thruster_count
    figure = Figure(figsize=(10.0, 5.6), layout="constrained")
    kinds: tuple[FaultKind, ...] = ("dead", "stuck-open")
    for axes, kind in zip(figure.subplots(1, 2), kinds, strict=True):
        grid = np.full((count, count), np.nan)
        for (of, _), sets in result.items():
            for fault_set in sets if of == kind else ():
                first = fault_set.thrusters[0]
                last = fault_set.thrusters[-1]
                grid[last, first] = grid[first, last] = float(fault_set.recoverable)
        axes.imshow(grid, cmap=ListedColormap([RED, GREEN]), vmin=0.0, vmax=1.0)
        axes.set(xticks=range(count), yticks=range(count))
        axes.set_xticks(np.arange(count) - 0.5, minor=True)
        axes.set_yticks(np.arange(count) - 0.5, minor=True)
        axes.grid(visible=False)
        axes.grid(which="minor", color="white", linewidth=1.5)
        axes.tick_params(which="minor", length=0)
        singles, pairs = (result.get((kind, n)) or () for n in (1, 2))
        title = f"{kind}: {_recoverable(singles)} single, {_recoverable(pairs)} pairs recoverable"
        label(axes, title, "thruster", "thruster")
    figure.suptitle(
        f"{craft.name}: green can still push and turn every way; on the diagonal one alone"
    )
    return figure


def _recoverable(sets: Sequence[FaultSet]) -> str:
    return f"{sum(fault_set.recoverable for fault_set in sets)} of {len(sets)}"
