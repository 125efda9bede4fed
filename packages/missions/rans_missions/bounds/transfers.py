"""Least impulse of missions on an orbit from both sides: bounds, and flights that both engines repeat.

Bounds are proven, N s; a start without a flight is named and not averaged.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from rans.extend import (
    Flight,
    Progress,
    Scenario,
    Spacecraft,
    Table,
    Task,
    each,
    fly,
    impulses,
    unseen,
    won,
)
from rans.reference.flight import fly_in_drake
from rans_missions.convex.approach import PortMeeting, flight_to_port, least_to_approach
from rans_missions.convex.holding import (
    flight_that_holds,
    least_to_hold,
)
from rans_missions.convex.rendezvous import (
    Meeting,
    MeetingTransfer,
    rendezvous,
    state_of,
)
from rans_missions.script import Script
from rans_missions.tasks.final_approach import FinalApproach
from rans_missions.tasks.orbital import OrbitalMission


@dataclass(frozen=True)
class LeastImpulse:
    """Bounds of N starts."""

    lower: np.ndarray
    """(N,) N s: impulse below which the mission is not won."""
    upper: np.ndarray
    """(N,) N s: impulse of flights that win within the limits, in both engines; infinite if there is none."""
    flight: Flight
    """These flights in the fast engine; a start without one coasts."""

    def table(self, title: str) -> Table:
        """A row for each start."""
        rows = [
            (
                str(k),
                f"{upper:.4g}" if np.isfinite(upper) else "-",
                f"{lower:.4g}",
                f"{upper / lower:.3f}" if np.isfinite(upper) else "no flight",
            )
            for k, (lower, upper) in enumerate(zip(self.lower, self.upper, strict=True))
        ]
        columns = ("start", "impulse N s", "bound N s", "over the bound")
        return Table(columns, rows, title, right=columns)

    def to_json(self) -> dict[str, Any]:
        """Content of the JSON file, start by start, in N s; null where no flight is known."""
        return {
            "lower": self.lower.tolist(),
            "upper": [x if np.isfinite(x) else None for x in self.upper.tolist()],
        }


def least_of_transfers(
    craft: Spacecraft, task: OrbitalMission, starts: Scenario, progress: Progress = unseen
) -> LeastImpulse:
    """Bounds of a mission by its latest deadline, from starts with the same goal.

    A point is held by the flight of `rans_missions.convex.holding.flight_that_holds`.
    """
    deadline = task.deadline[1]
    meeting = Meeting.of(craft, task, next(each(starts)).goal)

    def solved(one: Scenario) -> tuple[float, MeetingTransfer | None]:
        """Lower bound of the impulse from a start, N s, and the cheapest flight that was computed."""
        state = state_of(one)
        if not task.stay_seconds:
            answer = rendezvous(meeting, state, deadline)
            return answer.lower, answer.transfer
        asked = meeting, state, deadline, task.stay_seconds
        return least_to_hold(*asked), flight_that_holds(*asked)

    return _flown(craft, task, starts, solved, progress)


def least_of_approaches(
    craft: Spacecraft, task: FinalApproach, starts: Scenario, progress: Progress = unseen
) -> LeastImpulse:
    """Bounds of final approaches by the end of the episode.

    Raises:
        ConfigError: see `rans_missions.convex.rendezvous.forces_in_w`.
    """

    def solved(one: Scenario) -> tuple[float, MeetingTransfer | None]:
        """Lower bound of the impulse from a start, N s, and the cheapest flight that was computed."""
        meeting, state = PortMeeting.at_port(craft, task, task.timing, one.goal), state_of(one)
        return least_to_approach(meeting, state)[0], flight_to_port(meeting, state)

    return _flown(craft, task, starts, solved, progress)


def _flown(
    craft: Spacecraft,
    task: Task,
    starts: Scenario,
    solved: Callable[[Scenario], tuple[float, MeetingTransfer | None]],
    progress: Progress,
) -> LeastImpulse:
    """Bounds, and transfers that win where they win in the fast engine and in Drake, of every start."""
    lower = []
    commands = np.zeros(
        (task.timing.episode_steps, np.size(starts.start.p.x), craft.thruster_count)
    )
    for k, one in enumerate(each(starts)):
        bound, transfer = solved(one)
        lower.append(bound)
        if transfer is not None:
            commands[: len(transfer.commands), k] = transfer.commands
        progress(1)
    fast, drake = (
        flying(craft, task, Script(commands), starts, task.timing) for flying in (fly, fly_in_drake)
    )
    upper = np.where(won(fast) & won(drake), impulses(fast), np.inf)
    return LeastImpulse(np.array(lower), upper, fast)
