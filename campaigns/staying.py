"""Whether flights that have first been at rest can stay at rest to the end, by an exact search.

``python -m campaigns.staying go-to-pose-2d-fast lqr --episodes 256`` flies contestants and asks, of each
flight's first instant in the goal set, whether any on/off commands keep it there at every later one.

The answer is exact, because little is left to do there. A pulse changes a spin by more than the goal set allows.
So who stays has no spin, keeps its attitude, and fires only sets of thrusters without torque. These change the
velocity by a few vectors that are fixed in B. So velocities and positions at the ends of the periods lie on
lattices, and only finitely many of their points are within the goal set.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from tyro.conf import Positional

from rans.errors import ConfigError
from rans.evaluation.compare.contest import Contest, Contestant, Entry
from rans.evaluation.fly.contestants import contestant
from rans.files import write_json
from rans.model.actuators import ON_OFF
from rans.model.fields import map_leaves
from rans.model.spacecraft import Spacecraft
from rans.scenario import SELECTION_SEED
from rans.tasks.goal_set import REST_SPEED, REST_SPIN
from rans.terminal import Terminal, table

_MOST_STATES = 400_000
"""Points of the lattices after which a search gives up."""
_MOST_THRUSTERS = 16
"""Of which all sets are looked at."""
_DIGITS = 8
"""Decimals, in m and m/s, to which two ways to the same point agree; points are millimetres apart."""


class Changes(NamedTuple):
    """What sets of thrusters without torque do to a velocity in a control period."""

    velocities: np.ndarray
    """(K, d) m/s in B; the first one is zero."""
    impulses: np.ndarray
    """(K,) N s, the least of all sets that do this."""
    commands: np.ndarray
    """(K, thrusters) zeros and ones."""


def balanced_changes(craft: Spacecraft, period: float) -> Changes:
    """The changes of velocity below twice `REST_SPEED` that leave the spin alone.

    Raises:
        ConfigError: thrusters are not on or off, there are more than 16, the inertia is not that of a ball, or a
            pulse could leave a spin that the goal set allows.
    """
    if craft.actuators != ON_OFF or len(craft.thrusters) > _MOST_THRUSTERS:
        raise ConfigError(
            f"{craft.name} has {len(craft.thrusters)} thrusters, {craft.actuators.kind}: the search takes "
            f"at most {_MOST_THRUSTERS}, on or off."
        )
    inertia = np.array(craft.inertia)
    if craft.thrust_sharing != "none" or not np.allclose(inertia, inertia[0, 0] * np.eye(3)):
        raise ConfigError(
            f"{craft.name} shares thrust, or has an inertia that is not that of a ball: its spins lie on "
            "no lattice."
        )
    wrenches = np.array(craft.wrench_map)
    force = wrenches[:, : craft.dimension]
    torque = wrenches[:, craft.dimension :]
    # Along each axis all spins are multiples of one number.
    turns = np.abs(torque) * period / inertia[0, 0]
    for turn in turns.T:
        least = turn[turn > 1e-9].min()
        if least <= REST_SPIN or np.abs(turn / least - np.round(turn / least)).max() > 1e-6:
            raise ConfigError(
                f"a pulse turns {craft.name} by {np.degrees(least):.3g} degrees/s: spins within "
                f"{np.degrees(REST_SPIN):.3g} degrees/s would have to be searched too."
            )
    commands = np.array(list(product((0, 1), repeat=len(wrenches))), dtype=np.int8)
    commands = commands[np.abs(commands @ torque).max(axis=1) < 1e-9]
    impulses = commands @ np.array([one.force for one in craft.thrusters]) * period
    velocities = np.round(commands @ force * period / craft.mass, _DIGITS)
    order = np.lexsort((*velocities.T, impulses))
    _, first = np.unique(velocities[order], axis=0, return_index=True)
    kept = order[np.sort(first)]
    kept = kept[np.linalg.norm(velocities[kept], axis=1) <= 2.0 * REST_SPEED]
    return Changes(velocities[kept], impulses[kept], commands[kept])


def commands_that_stay(
    position: np.ndarray,
    velocity: np.ndarray,
    periods: int,
    changes: Changes,
    period: float,
    radius: float,
) -> np.ndarray | None:
    """Commands (T, thrusters) that keep a craft without spin in the goal set; None: there are none.

    A depth-first search of the lattice's points, which waits for as long as it can.

    Args:
        position: (d,) relative to the goal's, in B, m.
        velocity: (d,) in B, m/s.
        periods: T.
        changes: see `balanced_changes`.
        period: control period, s.
        radius: position tolerance, m.

    Raises:
        RuntimeError: the search had more points to look at than it may.
    """
    points: list[tuple[np.ndarray, np.ndarray, tuple[int, ...]]] = [(position, velocity, ())]
    known: set[tuple[float, ...]] = set()
    while points:
        here, moving, chosen = points.pop()
        if len(chosen) == periods:
            return changes.commands[list(chosen)]
        key = (len(chosen), *np.round(here, _DIGITS - 2), *np.round(moving, _DIGITS - 2))
        if key in known:
            continue
        known.add(key)
        if len(known) > _MOST_STATES:
            raise RuntimeError(f"more than {_MOST_STATES:,} points of the lattice.")
        after = moving + changes.velocities
        there = here + period * (moving + 0.5 * changes.velocities)
        allowed = np.linalg.norm(after, axis=1) <= REST_SPEED
        allowed &= np.linalg.norm(there, axis=1) <= radius
        # Looked at last is what leads away soonest; a coast is looked at first.
        ahead = np.linalg.norm(there + after, axis=1)
        ahead[0] = -1.0
        points += [
            (there[k], after[k], (*chosen, int(k)))
            for k in np.argsort(-ahead, kind="stable")
            if allowed[k]
        ]
    return None


@dataclass(frozen=True)
class Staying:
    """Of flights that were first at rest: how many stay, and how many could."""

    contestants: Positional[tuple[str, ...]]
    """Agents and controllers, as `rans compare` names them; all of one task and spacecraft."""
    episodes: int = 256
    """Starts."""
    seed: int = SELECTION_SEED
    """Seed of the starts."""
    output: Path | None = None
    """JSON file to write."""

    def run(self) -> int:
        """Print and write it.

        Raises:
            ConfigError: nobody is named, or the craft's spins or velocities lie on no lattice.
        """
        if not self.contestants:
            raise ConfigError("name contestants, as in go-to-pose-2d-fast lqr:go-to-pose-2d.")
        found = {name: _of_contestant(name, self.episodes, self.seed) for name in self.contestants}
        allowed = np.array([row.pop("allowed") for row in found.values()])
        times = np.array([row.pop("times") for row in found.values()])
        soonest = np.where(allowed, times, np.inf).min(axis=0)
        anybody = {
            "can stay": 100.0 * float(np.isfinite(soonest).mean()),
            "first at rest": float(soonest[np.isfinite(soonest)].mean()),
        }
        if self.output:
            write_json(
                self.output,
                {"episodes": self.episodes, "seed": self.seed, "rows": found, "anybody": anybody},
            )
        rows = [
            (
                name,
                *(
                    f"{row[key]:.3g}"
                    for key in ("first at rest", "stays", "can stay", "undecided", "pulses")
                ),
            )
            for name, row in found.items()
        ]
        rows.append(
            (
                "soonest of these",
                f"{anybody['first at rest']:.3g}",
                "",
                f"{anybody['can stay']:.3g}",
                "",
                "",
            )
        )
        headings = (
            "contestant",
            "first at rest, s",
            "stays, %",
            "could stay, %",
            "undecided, %",
            "periods with pulses",
        )
        Terminal(room=110).print(table("Staying at rest", headings, rows))
        return 0


def _of_contestant(name: str, episodes: int, seed: int) -> dict[str, Any]:
    """What one does, in % of flights, s and periods; "allowed" and "times" are of each start."""
    run = contestant(name)
    craft, task, timing = run.judged[:3]
    contest = Contest(craft, task, timing, seed, episodes)
    entry = Entry(
        Contestant(name, run.controller, "", ""), contest.fly(run.controller).flight, np.zeros(0)
    )
    changes = balanced_changes(craft, timing.control_period)
    radius = task.tolerances()["position"]
    answers: list[np.ndarray | None] = []
    undecided = 0
    for episode in range(episodes):
        if not np.isfinite(entry.arrival[episode]):
            answers.append(None)
            continue
        first = int(entry.at_goal[:, episode].argmax())
        try:
            answers.append(
                commands_that_stay(
                    *_relative(entry, first, episode),
                    timing.episode_steps - first,
                    changes,
                    timing.control_period,
                    radius,
                )
            )
        except RuntimeError:
            undecided += 1
            answers.append(None)
    plans = [plan for plan in answers if plan is not None]
    there = np.isfinite(entry.arrival)
    return {
        "first at rest": float(entry.arrival[there].mean()) if there.any() else np.inf,
        "stays": 100.0 * float(entry.stays.mean()),
        "can stay": 100.0 * len(plans) / episodes,
        "undecided": 100.0 * undecided / episodes,
        "pulses": float(np.mean([plan.any(axis=1).sum() for plan in plans])) if plans else np.nan,
        "allowed": [plan is not None for plan in answers],
        "times": entry.arrival.tolist(),
    }


def _relative(entry: Entry, instant: int, episode: int) -> tuple[np.ndarray, np.ndarray]:
    """Position relative to the goal's (m) and velocity (m/s) in B, (d,) each."""
    shape = entry.at_goal.shape
    state, goal = (
        map_leaves(lambda x: float(np.broadcast_to(x, shape)[instant, episode]), one)
        for one in (entry.flight.states, entry.flight.goals)
    )
    attitude: Any = state.attitude
    into_body: Any = attitude.inverse()
    position, velocity = (
        np.array(into_body.rotate(vector).columns()) for vector in (state.p - goal.p, state.v)
    )
    return position, velocity


if __name__ == "__main__":
    import sys

    import tyro

    from campaigns.command import ended

    sys.exit(ended("python -m campaigns.staying", tyro.cli(Staying).run))
