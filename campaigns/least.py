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
from rans_missions.script import Script
from rans_missions.tasks import Avoid, Dock, DockPort, Hold, Rendezvous
from rans_missions.tasks.orbital import OrbitalMission

from campaigns.elliptic import ECCENTRICITIES, orbit_of
from campaigns.missions import least_impulses, row
from campaigns.parts import in_parts
from campaigns.perturbed import around_the_earth
from rans.episode import Setup
from rans.evaluation.fly.contestants import contestant
from rans.model.spacecraft_file import load_spacecraft
from rans.optimal.trajectory.objectives import objective_of
from rans.optimal.trajectory.pool import solve_all
from rans.scenario import EVALUATION_SEED, Scenario, scenarios
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
    horizon: float | None = None
    """Length of optimal trajectories of throttled thrusters from which it begins too, s; None: there are none."""
    starts: int = 4
    """Number of starts: as many as some minutes of 16 busy cores have searched."""
    together: int = 2
    """Starts that a process searches together."""


def _by(deadline: float, task: OrbitalMission) -> dict[str, Any]:
    return {
        "task": replace(task, deadline=(deadline, deadline)),
        "condition": f"{deadline:,.0f} s",
        "contestants": ("convex", "mission"),
    }


SEARCHES: dict[str, Search] = {
    "hold": Search(**_by(1900.0, Hold()), rounds=2, starts=8, together=4),
    "dock": Search(**_by(1000.0, Dock()), rounds=3, starts=42),
    "rendezvous": Search(**_by(5000.0, Rendezvous()), rounds=3, starts=4),
    "avoid": Search(Avoid(), ("pretrained:avoid-2d",), 20, "default zones", 20.2, 8),
    "dock-port": Search(DockPort(), ("pretrained:dock-port-2d",), 20, "default rates", 30.0, 4),
    **{
        f"dock, eccentricity {e:g}": Search(
            **_by(1000.0, Dock(orbit=orbit_of(e))), rounds=1, starts=2, together=1
        )
        for e in ECCENTRICITIES
    },
    "hold, J2 and drag": Search(
        **_by(1000.0, around_the_earth()[1]), rounds=20, starts=2, together=1
    ),
}
"""All searches; a lander is steered by torques, which `rans improve` does not change."""
_GAIN = 1e-3
"""Part of the impulse by which a search gains at least where a flight counts as improved."""
_GUESSES = 2
"""Guesses of each optimal trajectory."""
_NOTHING = 1e-6
"""Impulse of flights that need none, N s."""


@dataclass(frozen=True)
class Least:
    """Search every mission."""

    only: tuple[str, ...] = ()
    """Search these missions alone, and keep the rows of others as they are in the evidence."""
    starts: int | None = None
    """Number of starts; None: that of each search."""
    workers: int | None = None
    """Number of processes; None: one per processor."""
    seed: int = EVALUATION_SEED
    """Seed of the starts."""

    def measured(self) -> Iterator[dict[str, Any]]:
        """A row of each mission."""
        asked = {k: one for k, one in SEARCHES.items() if not self.only or k in self.only}
        for most in sorted({one.starts for one in asked.values()}, reverse=True):
            together = {k: one.together for k, one in asked.items() if one.starts == most}
            count = min(most, self.starts or most)
            for name, parts in in_parts(searched, together, count, self.workers, self.seed):
                yield row_of_search(name, np.concatenate(parts))


def row_of_search(name: str, found: np.ndarray) -> dict[str, Any]:
    """What the flights of one search are, (N, contestants + 2), see `searched`."""
    search = SEARCHES[name]
    spent, after, lower = found[:, :-2], found[:, -2], found[:, -1]
    won = np.isfinite(after)
    who = " and ".join(search.contestants)
    if search.horizon is not None:
        who += f" and optimal trajectories by {search.horizon:g} s"
    ratios = (after / lower)[won]
    result = row(search.condition, f"from {who}", won, ~won & False, after, ratios)
    result["compared"] = int(won.sum())
    # The cheapest contestant of each start, and the search beside it.
    began = np.nan_to_num(spent, nan=np.inf).min(axis=1)
    begun = np.isfinite(began)
    gained = after < (1.0 - _GAIN) * began
    return {
        "mission": name,
        **result,
        "rounds": search.rounds,
        "before": float(began[begun].mean()),
        "improved": int(gained.sum()),
        "gains": bool(after[begun].mean() < (1.0 - _GAIN) * began[begun].mean()),
        "over": [_over(one, after) for one in spent.T],
        "impulses": found.tolist(),
    }


def cells(evidence: Any) -> Iterator[dict[str, Any]]:
    """Rows of the table, with what contestants spend over what was found, in few words: a page is narrow."""
    for one in evidence["rows"]:
        names = SEARCHES[one["mission"]].contestants
        ratios = [
            f"{who.removeprefix('pretrained:')} {over['mean']:.3f} ({over['worst']:.3f})"
            for who, over in zip(names, one["over"], strict=False)
            if over["mean"] is not None
        ]
        what = ", ".join(filter(None, (one["mission"], one["condition"])))
        yield {**one, "what": what, "ratios": ", ".join(ratios)}


def _over(spent: np.ndarray, found: np.ndarray) -> dict[str, float | None]:
    """What a contestant spends, (N,) N s, over what was found: ratio of the means, and the worst start."""
    both = np.isfinite(spent) & np.isfinite(found)
    if not both.any():
        return {"mean": None, "worst": None}
    # Some inspections need no burn.
    needs = both & (found > _NOTHING)
    return {
        "mean": float(spent[both].sum() / found[both].sum()),
        "worst": float((spent[needs] / found[needs]).max()),
    }


def searched(_: None, name: str, first: int, count: int, seed: int) -> np.ndarray:
    """Impulse of contestants, of what a search from them found, and its bound, N s, (N, contestants + 2).

    A job of a worker: so many starts from the first one.
    """
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
    if search.horizon is not None:
        seeds.append(_optima(setup, starts, search.horizon))
    found = improve(setup, starts, seeds, search.rounds)
    return np.stack([*found.spent, found.after, least_impulses(setup, starts)], axis=1)


def _optima(setup: Setup, starts: Scenario, horizon: float) -> Script:
    """Optimal trajectories of throttled thrusters, the best of some guesses each; where there is none, a coast."""
    craft, task, timing = setup[:3]
    aim = objective_of("fuel", horizon, timing.control_period)
    [found] = solve_all(craft, task, [aim], starts, workers=1, guesses=_GUESSES)
    commands = np.zeros((timing.episode_steps, len(found), craft.thruster_count))
    for k, one in enumerate(found):
        if one.solved:
            commands[: len(one.commands), k] = one.commands
    return Script(commands)
