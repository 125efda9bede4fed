"""``rans team``: guidance of a team that inspects, beside its bound, with what its coasts do."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from rans.extend import (
    EVALUATION_SEED,
    Options,
    Table,
    Terminal,
    command_of,
    fly,
    load_spacecraft,
    map_leaves,
    progress,
    scenarios,
    stages,
    whole,
)
from rans_missions.control.circumnavigation import Circumnavigation
from rans_missions.orbits.earth import EARTH
from rans_missions.team.bound import team_bound
from rans_missions.team.task import InspectTeam
from rans_missions.vectors import motion_of

_STEP = 20.0
"""Time between instants of coasts, s."""


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
    """Least distance of two deputies in two-body gravity on coasts of an orbit after all thrusters shut, m."""


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
    forces = np.array([thruster.force for thruster in craft.thrusters])
    spent = (flight.commands @ forces).sum(axis=0) * timing.control_period
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
            flown = states[: int(flight.lengths[first]) + 1, rows]
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


def coasts_apart(mean_motion: float, states: np.ndarray) -> float:
    """Least distance between deputies if all thrusters shut at any of T instants, for an orbit in two-body gravity.

    It is that at instants 20 s apart, m; infinite for one deputy.

    Args:
        mean_motion: mean motion n of the target's orbit, rad/s.
        states: states in the Hill frame, (T, D, 6).
    """
    # From the Hill frame to axes that do not turn, where the target is at (r, 0, 0) with n r along y.
    radius = (EARTH / mean_motion**2) ** (1.0 / 3.0)
    p = states[..., :3] + np.array([radius, 0.0, 0.0])
    v = states[..., 3:] + np.cross([0.0, 0.0, mean_motion], p)
    pairs = np.triu_indices(states.shape[1], 1)
    if not len(pairs[0]):
        return math.inf

    def motion(_: float, both: np.ndarray) -> np.ndarray:
        p, v = both.reshape(2, -1, 3)
        pull = -EARTH * p / np.linalg.norm(p, axis=1, keepdims=True) ** 3
        return np.concatenate([v, pull], axis=None)

    period = 2.0 * math.pi / mean_motion
    coasts = solve_ivp(
        motion,
        (0.0, period),
        np.concatenate([p, v], axis=None),
        "DOP853",
        np.arange(0.0, period, _STEP),
        rtol=1e-10,
        atol=1e-6,
    )
    flown = coasts.y[: p.size].reshape(*p.shape, -1)
    return float(np.linalg.norm(flown[:, pairs[0]] - flown[:, pairs[1]], axis=2).min())


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
