"""The cheapest flights that `rans improve` finds of every mission: ``python -m campaigns least-known``.

Each search begins from contestants of the page of its mission, with the same starts. What it finds stands beside
the bounds of the same starts.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from rans_missions.improve.search import improve
from rans_missions.tasks import Avoid, Dock, DockPort, Hold, Inspect, Rendezvous
from rans_missions.tasks.orbital import OrbitalMission

from campaigns.missions import least_impulses, row
from campaigns.parts import in_parts
from rans.episode import Setup
from rans.evaluation.fly.contestants import contestant
from rans.model.spacecraft_file import load_spacecraft
from rans.scenario import EVALUATION_SEED, scenarios
from rans.tasks import Task


@dataclass(frozen=True)
class Search:
    """A search of one mission."""

    task: Task
    """The mission, with one deadline."""
    contestants: tuple[str, ...]
    """What it begins from."""
    rounds: int
    """Rounds of the search: more where the beginning is far from the bound; 0: programs of inspections alone."""
    condition: str = ""
    """What the table of the page calls it."""


def _by(deadline: float, task: OrbitalMission) -> dict[str, Any]:
    return {
        "task": replace(task, deadline=(deadline, deadline)),
        "condition": f"{deadline:,.0f} s",
        "contestants": ("convex", "mission"),
    }


SEARCHES: dict[str, Search] = {
    "dock": Search(**_by(1000.0, Dock()), rounds=3),
    "hold": Search(**_by(1900.0, Hold()), rounds=1),
    "rendezvous": Search(**_by(5000.0, Rendezvous()), rounds=2),
    "inspect": Search(Inspect(), ("circumnavigation",), 0),
    "avoid": Search(Avoid(), ("pretrained:avoid-2d",), 60, "default zones"),
    "dock-port": Search(DockPort(), ("pretrained:dock-port-2d",), 60, "default rates"),
}
"""All searches; a lander is steered by torques, which `rans improve` does not change."""
_TOGETHER = 4
"""Starts that a process searches together."""


@dataclass(frozen=True)
class Least:
    """Search every mission."""

    only: tuple[str, ...] = ()
    """Search these missions alone, and keep the rows of others as they are in the evidence."""
    starts: int = 4
    """Number of starts."""
    workers: int | None = None
    """Number of processes; None: one per processor."""
    seed: int = EVALUATION_SEED
    """Seed of the starts."""

    def measured(self) -> Iterator[dict[str, Any]]:
        """A row of each mission."""
        together = {one: _TOGETHER for one in SEARCHES if not self.only or one in self.only}
        for name, parts in in_parts(searched, together, self.starts, self.workers, self.seed):
            yield row_of_search(name, np.concatenate(parts))


def row_of_search(name: str, found: np.ndarray) -> dict[str, Any]:
    """What the flights (N, 3) of one search are, see `searched`."""
    search = SEARCHES[name]
    before, after, lower = found.T
    won = np.isfinite(after)
    who = " and ".join(search.contestants)
    result = row(search.condition, f"from {who}", won, ~won & False, after, (after / lower)[won])
    if isinstance(search.task, Inspect):
        # Bounds of single starts may be zero.
        result["ratio"] = float(after[won].sum() / lower[won].sum())
    # What the beginnings spent from the same starts, N s, and the mean of what was found over it.
    began = before[won]
    return {
        "mission": name,
        **result,
        "rounds": search.rounds,
        "before": float(began.mean()),
        "saved": float((after[won] / np.maximum(began, 1e-9)).mean()),
    }


def searched(_: None, name: str, first: int, count: int, seed: int) -> np.ndarray:
    """Impulse before and after a search, and its bound, N s, of so many starts, (N, 3); a job of a worker."""
    search = SEARCHES[name]
    task: Any = search.task.for_evaluation()
    agents = [contestant(who) for who in search.contestants if ":" in who]
    if agents:
        setup = Setup(agents[0].craft, task, agents[0].timing)
        seeds = [agent.controller for agent in agents]
    else:
        setup = Setup(load_spacecraft(task.spacecraft), task, task.timing)
        seeds = [contestant(who, default_setup=setup).controller for who in search.contestants]
    starts = scenarios(task, setup.craft, seed, count, first)
    found = improve(setup, starts, seeds, search.rounds)
    return np.stack([found.before, found.after, least_impulses(setup, starts)], axis=1)
