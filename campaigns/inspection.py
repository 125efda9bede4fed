"""Impulse against time of inspections, beside their lower bound: ``python -m campaigns inspect``.

Circumnavigation for several times, the controller `visiting` and the agent behind the safety filter fly from the
same held-out starts.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from rans_missions.control.circumnavigation import Circumnavigation
from rans_missions.control.visiting import Visiting
from rans_missions.convex.inspection import inspection_bound
from rans_missions.guard import safety_filter
from rans_missions.tasks.inspect import Inspect

from rans.episode import Guard, Setup
from rans.evaluation.fly.contestants import contestant
from rans.evaluation.measure.metrics import impulses
from rans.flight import Controller, Flight, fly
from rans.model.spacecraft_file import load_spacecraft
from rans.scenario import EVALUATION_SEED, Scenario, each, scenarios

_WITHIN = (12_240.0, 7_200.0, 5_400.0, 4_200.0, 3_600.0)
"""Times within which circumnavigation is to inspect, s; the first one is the length of an episode."""


@dataclass(frozen=True)
class Inspection:
    """Fly all contestants."""

    episodes: int = 64
    """Held-out starts."""
    only: str = ""
    """Fly one contestant alone, such as visiting; rows of others stay as they are in the evidence."""
    seed: int = EVALUATION_SEED
    """Seed of the starts."""

    def measured(self) -> Iterator[dict[str, Any]]:
        """Every contestant's flights."""
        craft = load_spacecraft("afrl-deputy")
        task = Inspect().for_evaluation()
        starts = scenarios(task, craft, self.seed, self.episodes)
        agent = contestant("pretrained:inspect-3d")
        contestants: list[tuple[str, Controller, Guard | None]] = [
            (
                f"circumnavigation, {within:,.0f} s",
                Circumnavigation(craft, task, within=within),
                None,
            )
            for within in _WITHIN
        ]
        contestants.append(("visiting", Visiting(craft, task), None))
        guard = safety_filter(Setup(craft, task))
        contestants.append(("inspect-3d, filtered", agent.controller, guard))
        for who, controller, guarded in contestants:
            if self.only not in ("", who):
                continue
            flight = fly(craft, task, controller, starts, task.timing, guard=guarded)
            yield _row(who, flight, starts)


def _row(who: str, flight: Flight, starts: Scenario) -> dict[str, Any]:
    assert flight.done is not None
    assert flight.lengths is not None
    broken = flight.violated()
    won = flight.done & ~broken
    times = (flight.lengths * flight.timing.control_period)[won]
    spent = impulses(flight)[won]
    assert isinstance(flight.task, Inspect)
    bounds = []
    for one, good, steps in zip(each(starts), won, flight.lengths, strict=True):
        start: Any = one
        if good:
            time = float(steps) * flight.timing.control_period
            bounds.append(
                inspection_bound(
                    flight.craft, flight.task, start.start, start.goal, time, flight.timing
                )
            )
    return {
        "who": who,
        # Shares of the starts: success without breaking a limit, and a broken limit.
        "succeeded": float(won.mean()),
        "broken": float(broken.mean()),
        # Times of success, s.
        "median": float(np.median(times)),
        "slowest": float(times.max()),
        # Impulse of the flights that succeed, N s.
        "impulse": float(spent.mean()),
        "worst": float(spent.max()),
        # Mean of the least impulse of success in the time of the same flight, N s.
        "bound": float(np.mean(bounds)),
    }
