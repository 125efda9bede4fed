"""Missions on an orbit with their bounds: contestants and optima from the same starts, and ratios of impulse.

Ratios are over proven bounds of the same starts, N s; a start without a flight is named and not averaged.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rans.evaluation.measure.metrics import won
from rans.extend import (
    Controller,
    Flight,
    Progress,
    Scenario,
    Spacecraft,
    Task,
    contestant,
    fly,
    fly_in_drake,
    impulses,
    scenarios,
)
from rans.optimal.control.lqr import LQR
from rans.scenario import each
from rans_missions.control.convex_guidance import ConvexGuidance
from rans_missions.control.corridor import Corridor
from rans_missions.control.mission_guidance import MissionGuidance
from rans_missions.convex.approach import PortMeeting, flight_to_port, least_to_approach
from rans_missions.convex.holding import flight_that_holds, least_to_hold
from rans_missions.convex.rendezvous import (
    Answer,
    Meeting,
    MeetingTransfer,
    rendezvous,
    state_of,
)
from rans_missions.script import Script
from rans_missions.tasks.final_approach import FinalApproach
from rans_missions.tasks.orbital import OrbitalMission


@dataclass(frozen=True)
class Row:
    """Results of one contestant from N starts with one deadline."""

    name: str
    docked: np.ndarray
    """(N,) bool: the mission was won in time, and no limit was broken at any check."""
    violated: np.ndarray
    """(N,) bool: a limit was broken at some check before the end."""
    impulse: np.ndarray
    """(N,) N s, to the end of the period in which the mission was won."""


@dataclass(frozen=True)
class TransferTable:
    """Contestants and bounds for the same starts and the same deadline."""

    deadline: float
    """Deadline, s."""
    lower: np.ndarray
    """(N,) N s: lower bound of the impulse of winning by the deadline, without limits."""
    upper: np.ndarray
    """(N,) N s: impulse of flights within the limits, replayed in both engines; infinite if there is none."""
    rows: tuple[Row, ...]

    @property
    def columns(self) -> tuple[str, ...]:
        """Headings of `cells`."""
        return ("", "won", "limit broken", "over the bound", "worst", "impulse")

    def cells(self) -> list[tuple[str, ...]]:
        """Cells of a table with a row for each contestant; ratios to the bound are of flights that won."""
        rows: list[tuple[str, ...]] = []
        for row in self.rows:
            ratios = self.ratios(row)
            has_ratios = len(ratios) > 0
            rows.append(
                (
                    row.name,
                    f"{100.0 * row.docked.mean():.1f} %",
                    f"{100.0 * row.violated.mean():.1f} %",
                    f"{ratios.mean():.3f}" if has_ratios else "-",
                    f"{ratios.max():.3f}" if has_ratios else "-",
                    f"{row.impulse[row.docked].mean():.3g} N s" if has_ratios else "-",
                )
            )
        return rows

    def to_json(self) -> dict[str, Any]:
        """Content of the JSON file, start by start: bounds and impulses in N s; null where no flight is known."""
        return {
            "deadline": self.deadline,
            "lower": self.lower.tolist(),
            "upper": [x if np.isfinite(x) else None for x in self.upper.tolist()],
            "rows": [
                {
                    "name": row.name,
                    "won": row.docked.tolist(),
                    "violated": row.violated.tolist(),
                    "impulse": row.impulse.tolist(),
                }
                for row in self.rows
            ],
        }

    def ratios(self, row: Row) -> np.ndarray:
        """Impulse over the lower bound of the same start, of flights that docked."""
        return (row.impulse / self.lower)[row.docked]


def contestants_of(
    craft: Spacecraft, mission: OrbitalMission, agents: Sequence[str] = ()
) -> dict[str, Callable[[OrbitalMission], Controller]]:
    """Makers of every guidance that keeps the limits of a mission, of LQR, and of agents by name.

    Names stand in tables and in optimal.json.
    """

    def flown_by(spec: str) -> Callable[[OrbitalMission], Controller]:
        agent = contestant(spec).controller
        return lambda task: agent

    makers: dict[str, Callable[[OrbitalMission], Controller]] = {
        **{spec: flown_by(spec) for spec in agents},
        "mission guidance": lambda task: MissionGuidance(craft, task, task.timing),
        "convex guidance": lambda task: ConvexGuidance(craft, task, task.timing),
        "LQR": lambda task: LQR(craft, task, task.timing),
    }
    if not MissionGuidance.keeps_limits(mission):
        del makers["mission guidance"]
    return makers


def judged_transfers(
    craft: Spacecraft,
    mission: OrbitalMission,
    contestants: Mapping[str, Callable[[OrbitalMission], Controller]],
    deadline: float,
    seed: int,
    episodes: int,
    progress: Progress | None = None,
) -> TransferTable:
    """Fly contestants and the optima from the same starts with one deadline.

    Args:
        craft: spacecraft.
        mission: mission, whose deadline is replaced.
        contestants: functions that make controllers for a mission, by name.
        deadline: deadline, s.
        seed: seed of the starts.
        episodes: number of starts.
        progress: reports bounds.
    """
    task = replace(mission, deadline=(deadline, deadline))
    starts = scenarios(task, craft, seed, episodes)
    answers = transfer_bounds(craft, task, starts, deadline, progress)
    rows = []
    with warnings.catch_warnings():
        # The table shows that it does not know the limits.
        warnings.filterwarnings("ignore", message=".* does not know the constraints .*")
        for name, make_controller in contestants.items():
            flight = fly(craft, task, make_controller(task), starts, task.timing)
            rows.append(row_of(name, flight))
    found = optimum(craft, task, starts, answers)
    return _table(deadline, [answer.lower for answer in answers], rows, found)


def judged_approaches(
    craft: Spacecraft,
    task: FinalApproach,
    seed: int,
    episodes: int,
    progress: Progress | None = None,
) -> TransferTable:
    """Fly guidance of final approaches and the cheapest flights found from the same starts, beside their bounds.

    Args:
        craft: spacecraft, whose thrusters do not turn it.
        task: the final approach.
        seed: seed of the starts.
        episodes: number of starts.
        progress: reports starts.

    Raises:
        ConfigError: see `rans_missions.convex.rendezvous.forces_in_w`.
    """
    timing = task.timing
    starts = scenarios(task, craft, seed, episodes)
    lower = []
    transfers = []
    for one in each(starts):
        meeting, state = PortMeeting.at_port(craft, task, timing, one.goal), state_of(one)
        lower.append(least_to_approach(meeting, state)[0])
        transfers.append(flight_to_port(meeting, state))
        if progress is not None:
            progress(1)
    guided = row_of("corridor", fly(craft, task, Corridor(craft, task, timing), starts, timing))
    found = _flown("cheapest found", craft, task, starts, transfers)
    return _table(timing.control_period * timing.episode_steps, lower, [guided], found)


def _table(
    deadline: float, lower: Sequence[float], rows: Sequence[Row], found: Row
) -> TransferTable:
    """Table with the row of the flights that were found below the others; these are the upper bounds."""
    upper = np.where(found.docked, found.impulse, np.inf)
    return TransferTable(deadline, np.array(lower), upper, (*rows, found))


def transfer_bounds(
    craft: Spacecraft,
    task: OrbitalMission,
    starts: Scenario,
    deadline: float,
    progress: Progress | None = None,
) -> list[Answer]:
    """Lower and upper bounds of the least impulse of every start; all have the same goal.

    Where a mission asks to stay, the lower bound has the stay; transfers and their upper bound arrive only.
    """
    every = list(each(starts))
    meeting = Meeting.of(craft, task, every[0].goal)
    answers = []
    for scenario in every:
        answer = rendezvous(meeting, state_of(scenario), deadline)
        if task.stay_seconds:
            stay = least_to_hold(meeting, state_of(scenario), deadline, task.stay_seconds)
            answer = replace(answer, lower=max(answer.lower, stay))
        answers.append(answer)
        if progress is not None:
            progress(1)
    return answers


def optimum(
    craft: Spacecraft, task: OrbitalMission, starts: Scenario, answers: Sequence[Answer]
) -> Row:
    """Row of the optima; a flight counts as docked if it docked in the fast engine and in Drake.

    A point is held by the flight of `rans_missions.convex.holding.flight_that_holds`.
    """
    transfers = [answer.transfer for answer in answers]
    if task.stay_seconds:
        meeting = Meeting.of(craft, task, next(each(starts)).goal)
        transfers = [
            flight_that_holds(meeting, state_of(one), task.deadline[1], task.stay_seconds)
            for one in each(starts)
        ]
    return _flown("optimum", craft, task, starts, transfers)


def _flown(
    name: str,
    craft: Spacecraft,
    task: Task,
    starts: Scenario,
    transfers: Sequence[MeetingTransfer | None],
) -> Row:
    """Row of transfers, which win where they win in the fast engine and in Drake."""
    commands = np.zeros((task.timing.episode_steps, len(transfers), craft.thruster_count))
    for k, transfer in enumerate(transfers):
        if transfer is not None:
            commands[: len(transfer.commands), k] = transfer.commands
    fast, drake = (
        row_of(name, flying(craft, task, Script(commands), starts, task.timing))
        for flying in (fly, fly_in_drake)
    )
    return replace(fast, docked=fast.docked & drake.docked)


def row_of(name: str, flight: Flight) -> Row:
    """Row of the flights of a contestant."""
    return Row(name, won(flight), flight.violated(), impulses(flight))
