"""Impulse against time of inspections, beside their lower bound: ``python -m campaigns inspect``.

Circumnavigation for several times and the agent behind the safety filter fly from the
same held-out starts.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from rans_missions.control.circumnavigation import Circumnavigation
from rans_missions.convex.inspection import inspection_bound
from rans_missions.tasks.inspect import Inspect

from campaigns.parts import in_parts
from rans.episode.flight import Controller, fly
from rans.episode.scenario import EVALUATION_SEED, each, scenarios
from rans.episode.step import Setup
from rans.evaluation.fly.contestants import contestant
from rans.evaluation.measure.metrics import impulses, won
from rans.model.spacecraft_file import load_spacecraft

_WITHIN = (12_240.0, 7_200.0, 5_400.0)
"""Times within which circumnavigation is to inspect, s; the first one is the length of an episode."""


@dataclass(frozen=True)
class Inspection:
    """Fly all contestants."""

    episodes: int = 64
    """Held-out starts."""
    only: str = ""
    """Fly one contestant alone; rows of others stay as they are in the evidence."""
    seed: int = EVALUATION_SEED
    """Seed of the starts."""
    workers: int | None = None
    """Number of processes; None: one per processor."""

    def measured(self) -> Iterator[dict[str, Any]]:
        """Every contestant's flights."""
        together = {who: _TOGETHER for who in CONTESTANTS if self.only in ("", who)}
        for who, parts in in_parts(flown, together, self.episodes, self.workers, self.seed):
            yield _row(who, np.concatenate(parts))


def _circumnavigation(within: float) -> Callable[[Setup], Controller]:
    return lambda setup: Circumnavigation(setup.craft, setup.task, within=within)


CONTESTANTS: dict[str, Callable[[Setup], Controller]] = {
    **{f"circumnavigation, {within:,.0f} s": _circumnavigation(within) for within in _WITHIN},
    "pretrained:inspect-3d": lambda setup: contestant("pretrained:inspect-3d").controller,
}
"""What makes contestants, by the names of rows."""
_TOGETHER = 16
"""Starts that a process flies together."""


def flown(_: None, who: str, first: int, count: int, seed: int) -> np.ndarray:
    """Success, broken limit, time (s), impulse (N s) and its bound of so many starts, (N, 5); a job of a worker."""
    craft = load_spacecraft("afrl-deputy")
    task = Inspect().for_evaluation()
    starts = scenarios(task, craft, seed, count, first)
    controller = CONTESTANTS[who](Setup(craft, task))
    flight = fly(craft, task, controller, starts, task.timing)
    assert isinstance(task, Inspect)
    assert flight.lengths is not None
    times = flight.lengths * task.timing.control_period
    bounds = []
    for start, time in zip(each(starts), times, strict=True):
        one: Any = start
        bounds.append(inspection_bound(craft, task, one.start, one.goal, float(time), task.timing))
    return np.stack([won(flight), flight.violated(), times, impulses(flight), bounds], axis=1)


def _row(who: str, flights: np.ndarray) -> dict[str, Any]:
    """What the flights (N, 5) of one contestant are."""
    won = flights[:, 0] > 0.5
    _, _, times, spent, bounds = flights[won].T
    return {
        "who": who,
        "starts": len(flights),
        # Shares of the starts: success without breaking a limit, and a broken limit.
        "succeeded": float(won.mean()),
        "broken": float(flights[:, 1].mean()),
        # Times of success, s.
        "median": float(np.median(times)),
        "slowest": float(times.max()),
        # Impulse of the flights that succeed, N s.
        "impulse": float(spent.mean()),
        "worst": float(spent.max()),
        # Mean of the least impulse of success in the time of the same flight, N s.
        "bound": float(np.mean(bounds)),
    }
