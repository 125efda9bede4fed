"""Guidance by convex programs: plan the least impulse within a mission's limits, fly it, plan again when off it.

States are (2 d,) relative to the point, m and m/s in W; plans are those of `rans_missions.convex`, and flights stay
above its bounds.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from rans.extend import Ball, Cone, ModelBased, Shape, SpeedLimit, map_leaves
from rans_missions.control.afterwards import Afterwards
from rans_missions.convex.cone_program import SolverFailed
from rans_missions.convex.holding import flight_that_holds
from rans_missions.convex.rendezvous import (
    Meeting,
    rendezvous,
    trajectory,
)
from rans_missions.tasks.orbital import OrbitalMission, last_check
from rans_missions.vectors import motion_of

_RESERVE = 0.005
"""Share of limits and tolerances that plans leave, so that small errors break none."""
_OFF = 0.1
"""Share of the tolerances by which a plan's arrival may be missed before it is made anew."""


@dataclass
class _Plan:
    """What one episode is about to do."""

    commands: np.ndarray
    """(periods, m) still to come."""
    states: np.ndarray
    """(checks + 1, 2 d) expected at every check from now on."""


class ConvexGuidance(ModelBased):
    """Flies the transfer of least impulse that keeps a mission's limits, planned by a conic program.

    >>> rans.ConvexGuidance("afrl-deputy", "dock")
    <convex: Dock for afrl-deputy>

    At first, and whenever an episode is so far off its plan that the arrival would be missed by a tenth of the
    tolerances, the program of `rans_missions.convex.rendezvous` is solved from the state as it is. Between, the
    planned commands are given, so that a perfect world needs one program an episode: 0.05 to 2 s of a core.
    Where no transfer is found, the craft coasts. After the arrival it stays at the goal, and after a deadline that
    was missed it plans again (`rans_missions.control.afterwards`). A mission that asks for a stay has it in its
    plan (`rans_missions.convex.holding`).

    Args:
        craft: by name, TOML file or as such; one whose thrusters do not turn it.
        task: a mission on an orbit, by name or as such.
        timing: control period, and length of the episode.

    Raises:
        ConfigError: the task is no mission on an orbit, or thrusters turn the craft.
    """

    name = "convex"
    slow = True
    heeds_constraints: ClassVar[bool] = True

    def _prepare(self) -> None:
        self._plans: list[_Plan | None] = []
        self._mission = OrbitalMission.expected(
            self._task, "convex guidance flies missions on an orbit"
        )
        self._afterwards = Afterwards(self._craft, self._mission, self._timing)
        self._holds = self._mission.stays
        self._meeting: Meeting | None = None

    def reset(self, count: int) -> None:
        """See `rans.episode.flight.Controller`; plans and arrivals are forgotten."""
        self._plans = [None] * count
        self._afterwards.reset(count)

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """Commands (N, n) from states and the times in the goal's notes; the observation is not read.

        Changes `_plans`, one a row.
        """
        relative_states = np.asarray(motion_of(state), float)
        if len(self._plans) != len(relative_states):
            self.reset(len(relative_states))
        goal = self._afterwards.goal(state, goal)
        if self._holds:
            # Plans contain the stay: the law of staying begins when they end.
            self._afterwards.stays &= np.array([plan is None for plan in self._plans])
        stays = self._afterwards.stays
        deadline = np.broadcast_to(np.asarray(goal.notes.deadline, float), len(relative_states))
        commands = np.zeros((len(relative_states), self._craft.command_count))
        checks = self._timing.checks
        # All episodes of a mission meet at one point: the goal is that of the first.
        meeting = self._meeting or self._cautious(map_leaves(lambda x: np.ravel(x)[:1], goal))
        self._meeting = meeting
        for k, now in enumerate(relative_states):
            plan = self._plans[k]
            # A plan that is still flown is that of a craft which has not arrived and is not off it.
            if plan is not None and (stays[k] or self._is_off(meeting, plan, now)):
                plan = None
            if plan is None and not stays[k]:
                plan = self._planned(meeting, now, float(deadline[k]))
            if plan is not None:
                commands[k] = plan.commands[0]
                # What is left of it once its first command has been given.
                goes_on = len(plan.states) > checks + 1 and len(plan.commands) > 1
                plan = _Plan(plan.commands[1:], plan.states[checks:]) if goes_on else None
            self._plans[k] = plan
        return self._afterwards.commands(state, goal, commands)

    def _cautious(self, goal: Any) -> Meeting:
        """The meeting with one episode's goal; tolerances and limits are tightened, since flights are not exact.

        Plans keep these limits, so that errors of a flight up to the reserve do not violate the mission's own.
        """
        meeting = Meeting.of(self._craft, self._mission, goal)
        remaining = 1.0 - _RESERVE
        return replace(
            meeting,
            timing=self._timing,
            position_tolerance=meeting.position_tolerance * remaining,
            velocity_tolerance=meeting.velocity_tolerance * remaining,
            limits=tuple(_tightened(limit, _RESERVE) for limit in meeting.limits),
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

    def _planned(self, meeting: Meeting, relative_state: np.ndarray, left: float) -> _Plan | None:
        """The cheapest plan from this state (2 d,), with so many s until the deadline; None counts a failure.

        Without a flight within limits, one beyond them.
        """
        if last_check(left, meeting.interval) < 1:
            return None
        try:
            transfer = None
            if self._holds:
                stay = self._mission.stay_seconds
                transfer = flight_that_holds(meeting, relative_state, left, stay)
            if transfer is None:
                answer = rendezvous(meeting, relative_state, left)
                transfer = answer.transfer or answer.free
        except SolverFailed:
            return None
        return _Plan(transfer.commands, trajectory(meeting, relative_state, transfer))


def _tightened(limit: Shape, reserve: float) -> Shape:
    """A limit made tighter by a share: speed and angle smaller, a ball larger; shapes of other kinds stay."""
    if isinstance(limit, SpeedLimit):
        return replace(limit, base=limit.base * (1.0 - reserve))
    if isinstance(limit, Ball):
        return replace(limit, radius=limit.radius * (1.0 + reserve))
    if isinstance(limit, Cone):
        return replace(limit, half_angle=limit.half_angle * (1.0 - reserve))
    return limit
