"""Guidance by convex programs: plan the least impulse within a mission's limits, fly it, plan again when off it.

States are (2 d,) relative to the point, m and m/s in W; plans are those of `rans_missions.convex`, and flights stay
above its bounds.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from rans.errors import SolverFailed
from rans.extend import Ball, Spacecraft, Task, Timing, leaves, map_leaves
from rans.tasks.shapes import Cone, Shape, SpeedLimit
from rans_missions.control.afterwards import Afterwards
from rans_missions.control.planning import PlanningGuidance
from rans_missions.convex.holding import flight_that_holds
from rans_missions.convex.impulses import Impulses
from rans_missions.convex.rendezvous import (
    Meeting,
    MeetingTransfer,
    least_impulse,
    least_margins,
    rendezvous,
    trajectory,
    within_limits,
)
from rans_missions.tasks.orbital import OrbitalMission, last_check

_OFF = 0.1
"""Share of the tolerances by which a plan's arrival may be missed before it is made anew."""
_CHECKED = 40
"""Checks of a closed-form transfer at which its limits are checked."""
_EVERY = 4
"""Of an expert's control periods those with thrust, where its transfers need a conic program: every fourth."""
_LATER = (0.7, 0.8, 0.9, 1.0)
"""Shares of the time left at which arrivals are tried where none was possible at the planned one."""


@dataclass
class _Plan:
    """What one episode is about to do."""

    commands: np.ndarray
    """(periods, m) still to come."""
    states: np.ndarray
    """(checks + 1, 2 d) expected at every check from now on."""


class ConvexGuidance(PlanningGuidance[_Plan]):
    """Flies the transfer of least impulse that keeps a mission's limits, planned by a conic program.

    >>> rans.ConvexGuidance("afrl-deputy", "dock")
    <convex: Dock for afrl-deputy>

    At first, and whenever an episode is so far off its plan that the arrival would be missed by a tenth of the
    tolerances, the program of `rans_missions.convex.rendezvous` is solved from the state as it is. Between, the
    planned commands are given, so that a perfect world needs one program an episode: 0.05 to 2 s of a core.
    Where no transfer is found, the craft coasts. After the arrival it stays at the goal, and after a deadline that
    was missed it plans again (`rans_missions.control.afterwards`). With ``search``, a mission that asks for a stay
    has it in its plan (`rans_missions.convex.holding`).

    Args:
        craft: by name, TOML file or as such; one whose thrusters do not turn it.
        task: a mission on an orbit, by name or as such.
        timing: control period, and length of the episode.
        search: whether the best of all arrivals up to the deadline is looked for, by branch and bound, instead of
            the arrival that the task plans, which is several times faster.
        reserve: share of limits and tolerances that plans leave, so that small errors break none.

    Raises:
        ConfigError: the task is no mission on an orbit, thrusters turn the craft, or the reserve is not at least
            0 and below 0.5.
    """

    name = "convex"
    follows_orbits: ClassVar[bool] = True

    def __init__(
        self,
        craft: str | Path | Spacecraft,
        task: str | Task,
        timing: Timing | None = None,
        search: bool = True,
        reserve: float = 0.005,
    ) -> None:
        super().__init__(craft, task, timing, reserve)
        self._mission = OrbitalMission.expected(
            self._task, "convex guidance flies missions on an orbit"
        )
        self._afterwards = Afterwards(self._craft, self._mission, self._timing)
        self._search = search
        # In a drift that changes a program of arrival and stay takes minutes.
        self._holds = search and self._mission.stays and self._mission.drift.steady
        # Speeds of arrival are no equations of the closed form, and nor is a drift that changes.
        self._closed_form = not (search or self._mission.brakes) and self._mission.drift.steady
        self._later: tuple[float, ...] = _LATER
        self._every = 1
        self._meeting: Meeting | None = None
        self._impulses: Impulses | None = None

    @classmethod
    def as_expert(cls, craft: Spacecraft, task: Task, timing: Timing) -> ConvexGuidance:
        """Whom agents imitate: it flies to the arrival that agents observe, and leaves them room for errors."""
        expert = cls(craft, task, timing, search=False, reserve=0.03)
        expert._later = (1.0,)
        expert._every = _EVERY
        return expert

    def reset(self, count: int) -> None:
        """See `rans.flight.Controller`; plans and arrivals are forgotten."""
        super().reset(count)
        self._afterwards.reset(count)

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """Commands (N, n) from states and the times in the goal's notes; the observation is not read.

        Changes `_plans`, one a row, and makes the meeting of the first episode that of all in a steady drift.
        """
        relative_states = np.stack(
            [np.asarray(x, float) for x in (*leaves(state.p), *leaves(state.v))], axis=1
        )
        if len(self._plans) != len(relative_states):
            self.reset(len(relative_states))
        goal = self._afterwards.goal(state, goal)
        if self._holds:
            # Plans contain the stay: the law of staying begins when they end.
            self._afterwards.stays &= np.array([plan is None for plan in self._plans])
        stays = self._afterwards.stays
        deadline, arrival = (
            np.broadcast_to(np.asarray(x, float), len(relative_states))
            for x in (goal.notes.deadline, goal.notes.arrival)
        )
        # Plans that are still flown: of craft that have not arrived and are not off their plan.
        if self._meeting is None:
            self._meeting = self._cautious(_episode(goal, 0))
            self._impulses = Impulses(self._meeting)
        meetings = [self._meeting] * len(self._plans)
        if not self._mission.drift.steady:
            meetings = [self._cautious(_episode(goal, k)) for k in range(len(self._plans))]
        commands = np.zeros((len(relative_states), self._craft.command_count))
        for k, plan in enumerate(self._plans):
            if plan is not None and (
                stays[k] or self._is_off(meetings[k], plan, relative_states[k])
            ):
                self._plans[k] = None
        # New plans, in closed form where that serves.
        lost = np.array([plan is None for plan in self._plans])
        open_ = np.flatnonzero(lost & ~stays)
        if self._closed_form:
            open_ = self._fired(self._meeting, relative_states, arrival, open_, commands)
        for k in open_:
            self._plans[k] = self._planned(meetings[k], relative_states[k], deadline[k], arrival[k])
        # The commands of this period of every plan.
        for k, plan in enumerate(self._plans):
            if plan is not None:
                commands[k] = plan.commands[0]
                self._plans[k] = self._one_period_later(plan)
        return self._afterwards.commands(state, goal, commands)

    def _fired(
        self,
        meeting: Meeting,
        relative_state: np.ndarray,
        arrival: np.ndarray,
        rows: np.ndarray,
        commands: np.ndarray,
    ) -> np.ndarray:
        """Rows that closed-form transfers do not serve; the commands (N, m) of the others are written.

        Arrivals are s from now. Rows that are left need a program each.
        """
        assert self._impulses is not None
        left = []
        # Whole periods, no later than planned: that may be the deadline.
        periods = np.floor(arrival[rows] / self._timing.control_period + 1e-6).astype(int)
        for count in np.unique(periods):
            ours = rows[periods == count]
            if count < 1:
                left.append(ours)
                continue
            states = relative_state[ours]
            firings = self._impulses.firings(states, int(count))
            feasible = (firings.command <= 1.0).all(axis=1)
            last = int(count) * self._timing.checks
            checks = np.unique(np.linspace(1, last, min(last, _CHECKED)).astype(int))
            flown = self._impulses.flown(states, firings, checks)
            # Nobody can do better than to go on where a limit is broken already.
            broken = least_margins(meeting.limits, states[:, None]) < 0.0
            feasible &= broken | (least_margins(meeting.limits, flown) >= 0.0)
            commands[ours[feasible]] = firings.now(commands.shape[1])[feasible]
            left.append(ours[~feasible])
        return np.concatenate(left) if left else rows

    def _cautious(self, goal: Any) -> Meeting:
        """The meeting with one episode's goal; tolerances and limits are tightened, since flights are not exact.

        Plans keep these limits, so that errors of a flight up to the reserve do not violate the mission's own.
        """
        meeting = Meeting.of(self._craft, self._mission, goal)
        remaining = 1.0 - self._reserve
        return replace(
            meeting,
            timing=self._timing,
            every=self._every,
            position_tolerance=meeting.position_tolerance * remaining,
            velocity_tolerance=meeting.velocity_tolerance * remaining,
            limits=tuple(_tightened(limit, self._reserve) for limit in meeting.limits),
        )

    def _is_off(self, meeting: Meeting, plan: _Plan, relative_state: np.ndarray) -> bool:
        """Whether a plan that is flown on from this state (2 d,), relative to the point, would miss its arrival.

        Too strict a test plans in every period, which takes seconds; too loose a one misses.
        """
        size = len(meeting.point)
        free = meeting.transition(len(plan.states) - 1)
        missed = free @ (relative_state - plan.states[0])
        return bool(
            np.linalg.norm(missed[:size]) > _OFF * meeting.position_tolerance
            or np.linalg.norm(missed[size:]) > _OFF * meeting.velocity_tolerance
        )

    def _planned(
        self, meeting: Meeting, relative_state: np.ndarray, left: float, arrival: float
    ) -> _Plan | None:
        """A plan from this state (2 d,), with so many s until the deadline and the task's planned arrival.

        Counts failures.
        """
        last = last_check(left, meeting.interval)
        if last < 1:
            return None
        try:
            transfer = (
                self._searched(meeting, relative_state, left)
                if self._search
                else self._direct(meeting, relative_state, last, arrival)
            )
        except SolverFailed:
            transfer = None
        if transfer is None:
            self.failures += 1
            return None
        return _Plan(transfer.commands, trajectory(meeting, relative_state, transfer))

    def _searched(
        self, meeting: Meeting, relative_state: np.ndarray, left: float
    ) -> MeetingTransfer:
        """The cheapest transfer from this state (2 d,) within so many s.

        Without a flight within limits, one beyond them.
        """
        if self._holds:
            held = flight_that_holds(meeting, relative_state, left, self._mission.stay_seconds)
            if held is not None:
                return held
        answer = rendezvous(meeting, relative_state, left)
        return answer.free if answer.transfer is None else answer.transfer

    def _direct(
        self, meeting: Meeting, relative_state: np.ndarray, last: int, arrival: float
    ) -> MeetingTransfer | None:
        """The transfer to the planned arrival (s), or to the first later one that keeps the limits.

        Where none keeps them, it is the first one without limits; None: there is no transfer.
        """
        planned = round(arrival / meeting.interval)
        checks = [planned, *(max(1, round(fraction * last)) for fraction in self._later)]
        unlimited: MeetingTransfer | None = None
        for check in dict.fromkeys(check for check in checks if 1 <= check <= last):
            free = least_impulse(meeting, relative_state, check)
            if free is None:
                continue
            feasible = within_limits(meeting, relative_state, free)
            if feasible is not None:
                return feasible
            unlimited = unlimited or free
        return unlimited

    def _one_period_later(self, plan: _Plan | None) -> _Plan | None:
        """What is left of a plan once its first command has been given."""
        checks = self._timing.checks
        if plan is None or len(plan.states) <= checks + 1 or len(plan.commands) < 2:
            return None
        return _Plan(plan.commands[1:], plan.states[checks:])


def _episode(goal: Any, number: int) -> Any:
    """The goal of an episode, in fields of one element; goals that all have are floats."""

    def chosen(x: Any) -> np.ndarray:
        flat = np.ravel(x)
        return flat[number : number + 1] if len(flat) > 1 else flat

    return map_leaves(chosen, goal)


def _tightened(limit: Shape, reserve: float) -> Shape:
    """A limit made tighter by a share: speed and angle smaller, a ball larger; shapes of other kinds stay."""
    if isinstance(limit, SpeedLimit):
        return replace(limit, base=limit.base * (1.0 - reserve))
    if isinstance(limit, Ball):
        return replace(limit, radius=limit.radius * (1.0 + reserve))
    if isinstance(limit, Cone):
        return replace(limit, half_angle=limit.half_angle * (1.0 - reserve))
    return limit
