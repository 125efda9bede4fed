"""How agents land, each start beside its own optimum: ``python -m validation.records.landing AGENT ...``.

Prints one line an agent: the share that lands, the least margins, and propellant over the lower bound of the same
start (`rans.evaluation.compare.landings`), for the first starts of the evaluation seed.
"""

from __future__ import annotations

import sys

import numpy as np

from rans.evaluation.compare.landings import descent_of
from rans.evaluation.fly.contestants import contestant
from rans.flight import fly
from rans.model.spacecraft import Spacecraft
from rans.optimal.convex.landing import Lander, best_landing
from rans.scenario import EVALUATION_SEED, Scenario, each, scenarios
from rans.tasks.land import Land
from rans.terminal import Terminal

EPISODES = 1024
"""Starts that are flown."""
OPTIMA = 128
"""Of them, those whose optimum is found: two seconds each."""


def main(specs: list[str]) -> None:
    """Fly every agent and print its line."""
    bounds: np.ndarray | None = None
    for spec in specs:
        loaded = contestant(spec)
        controller = loaded.controller
        craft = loaded.craft
        task = loaded.task
        timing = loaded.timing
        if not isinstance(task, Land):
            raise SystemExit(f"{spec} does not land.")
        starts = scenarios(task, craft, EVALUATION_SEED, EPISODES)
        flight = fly(craft, task, controller, starts, timing)
        assert flight.done is not None
        assert flight.lengths is not None
        landed = flight.done & ~flight.failed()
        left = flight.states.stores[0]
        used = left[0] - left[flight.lengths, np.arange(EPISODES)]
        if bounds is None:
            bounds = np.array(
                [
                    _bound(craft, task, one)
                    for one, _ in zip(each(starts), range(OPTIMA), strict=False)
                ]
            )
        counted = landed[:OPTIMA]
        ratios = (used[:OPTIMA] / bounds)[counted]
        margins = ", ".join(f"{k} {x[:, landed].min():.3g}" for k, x in flight.margins.items())
        Terminal().say(
            f"{spec}: {landed.sum()} of {EPISODES} land ({flight.violated().sum()} violate a limit); "
            f"{used[landed].mean():.1f} kg, {0.5 * flight.lengths[landed].mean():.1f} s; over the bound of the "
            f"same start {ratios.mean():.4f} (median {np.median(ratios):.4f}, worst {ratios.max():.4f}, "
            f"{len(ratios)} starts); least margins: {margins}"
        )
    if bounds is not None:
        Terminal().say(
            f"bounds: mean {np.nanmean(bounds):.1f} kg of {np.isfinite(bounds).sum()} starts"
        )


def _bound(craft: Spacecraft, task: Land, one: Scenario) -> float:
    """Propellant below which nothing lands from this start, kg."""
    p, v = (np.array(x.columns()) for x in (one.start.p, one.start.v))
    found = best_landing(
        Lander.of(craft),
        descent_of(task),
        (p, v),
        task.timing.control_period,
        "bound",
    )
    return float("nan") if found is None else found.propellant


if __name__ == "__main__":
    main(sys.argv[1:])
