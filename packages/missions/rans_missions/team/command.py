"""``rans team``: guidance of a team that inspects, beside its bound, with what its coasts do."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from rans import load_spacecraft, scenarios
from rans.extend import (
    EVALUATION_SEED,
    Options,
    Table,
    Terminal,
    command_of,
    fly,
    impulses,
    map_leaves,
    progress,
    stages,
    whole,
)
from rans_missions.control.circumnavigation import Circumnavigation
from rans_missions.team.bound import team_bound
from rans_missions.team.coasts import coasts_apart
from rans_missions.team.task import InspectTeam
from rans_missions.vectors import motion_of


@dataclass(frozen=True)
class TeamFlights:
    """Flights of N teams, one number each, until their success or end."""

    succeeded: np.ndarray
    """Whether the team succeeded."""
    broken: np.ndarray
    """Whether one came too near to the target or to another, or left the zone."""
    time: np.ndarray
    """Time of the success, or the length of the episode, s."""
    spent: np.ndarray
    """Impulse of all deputies, N s."""
    bound: np.ndarray
    """Its lower bound (`rans_missions.team.bound.team_bound`), N s."""
    apart: np.ndarray
    """Least distance of two deputies at a check, m; infinite for one deputy."""
    coasts: np.ndarray
    """Least distance of two deputies on coasts after a burn (`rans_missions.team.coasts`), m; infinite: no burn."""


def team(deputies: int = 3, episodes: int = 8, seed: int = EVALUATION_SEED) -> TeamFlights:
    """Fly teams that inspect a target by guidance, and bound the impulse that any law needs from their starts.

    Args:
        deputies: number of deputies of a team, 1 to 3.
        episodes: number of teams; guidance and bound take some ten seconds of a core each.
        seed: seed of the starts.

    Raises:
        ConfigError: a number is out of range.
    """
    whole("--episodes", episodes)
    task = InspectTeam(deputies=deputies)
    craft = load_spacecraft("afrl-deputy")
    timing = task.timing
    starts: Any = scenarios(task, craft, seed, deputies * episodes)
    # All at once: a step of one row takes as long as one of hundreds.
    flight = fly(craft, task, Circumnavigation(craft, task), starts, timing)
    assert flight.done is not None
    assert flight.lengths is not None
    spent = impulses(flight)
    states = motion_of(flight.states)
    apart = flight.margins.get("keep-apart", np.full(flight.commands.shape[:2], math.inf))
    duration = timing.control_period * timing.episode_steps
    bounds, coasts = [], []
    with progress() as bars:
        step = stages(bars)("teams", episodes)
        for first in range(0, len(spent), deputies):
            rows = slice(first, first + deputies)
            each: list[Any] = [
                map_leaves(lambda x, j=j: float(x[j]), starts) for j in range(rows.start, rows.stop)
            ]
            bounds.append(
                team_bound(craft, task, [one.start for one in each], each[0].goal, duration, timing)
            )
            length = int(flight.lengths[first])
            burnt = flight.commands[:length, rows].any(axis=(1, 2)).cumsum() > 0
            flown = states[1 : length + 1, rows][burnt]
            coasts.append(coasts_apart(task.mean_motion, flown))
            step(1)
    return TeamFlights(
        flight.done[::deputies],
        flight.violated()[::deputies],
        flight.lengths[::deputies] * timing.control_period,
        spent.reshape(episodes, deputies).sum(axis=1),
        np.array(bounds),
        apart.min(axis=0)[::deputies] + task.keep_apart,
        np.array(coasts),
    )


@command_of(team)
class Team(Options):
    """Fly a team of deputies that inspects a target by guidance, beside the bound of the team's impulse."""

    group = "Limits"
    guide = "docs/missions/inspect.md"
    examples = ("rans team --deputies 2 --episodes 4",)
    following = ("rans compare circumnavigation:inspect-3d",)

    def run(self) -> int:
        """Print the table; 1 if a team did not succeed."""
        flown: TeamFlights = self.call()
        limit = InspectTeam().keep_apart
        bound = flown.bound.sum()
        factor = f"{flown.spent.sum() / bound:.3f}" if bound else "-"
        rows = [
            ("succeeded, %", f"{100.0 * flown.succeeded.mean():.1f}", "-", "-"),
            ("limit broken, %", f"{100.0 * flown.broken.mean():.1f}", "-", "-"),
            ("time, s", "-", *(f"{f(flown.time):,.0f}" for f in (np.median, np.max))),
            ("impulse, N s", *_three(flown.spent)),
            ("bound, N s", *_three(flown.bound)),
            ("impulse over bound", factor, "-", "-"),
        ]
        if self.deputies > 1:
            nearer = f"{100.0 * np.mean(flown.coasts < limit):.1f}"
            for what, share, distance in (
                ("apart, m", "-", flown.apart),
                (f"coasts apart, m; nearer than {limit:g} m, %", nearer, flown.coasts),
            ):
                rows.append((what, share, f"{np.median(distance):.1f}", f"{distance.min():.1f}"))
        title = f"Inspection by teams of {self.deputies}"
        Terminal().table(Table(("what", "of all", "median", "worst"), rows, title))
        return 0 if flown.succeeded.all() else 1


def _three(values: np.ndarray) -> tuple[str, ...]:
    """Mean, median and largest of numbers."""
    return tuple(f"{f(values):.3f}" for f in (np.mean, np.median, np.max))
