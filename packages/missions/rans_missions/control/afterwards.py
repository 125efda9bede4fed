"""What guidance of missions on an orbit does once the mission is over: stay where it arrived, or plan again."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from rans.extend import Spacecraft, Timing
from rans_missions.control.tracking import Tracker
from rans_missions.guidance.arrival import TIME_ROUNDING

_NEAR = 2.0
"""Position tolerances within which a craft whose mission is over stays."""
_LEFT = 6.0
"""Position tolerances beyond which it no longer stays, but comes back by a new plan. A craft that docks at its
speed tolerance is up to four away before the command after the contact has stopped it."""


class Afterwards:
    """Stays at the goal of a mission after the arrival, and plans again after a deadline that was missed.

    A simulator of somebody else, or a robot, goes on after a success and after a deadline. Guidance that plans
    arrivals is not defined then: this law takes over. It stays (`OrbitalMission.staying`) from the arrival on, and
    where the deadline has passed far from the goal, it replaces the times in the goal by those of a new plan, with
    the latest deadline of the mission from now.

    Args:
        craft: what flies.
        mission: what it has flown, an `rans_missions.tasks.orbital.OrbitalMission`.
        timing: control period.
    """

    def __init__(self, craft: Spacecraft, mission: Any, timing: Timing) -> None:
        self._mission = mission
        self._period = timing.control_period
        self._tracker = Tracker(craft, self._period)
        latest = mission.deadline
        self._again = float(latest if isinstance(latest, int | float) else latest[1])
        self.reset(0)

    def reset(self, count: int) -> None:
        """Forget arrivals and plans: ``count`` new episodes begin."""
        self.stays = np.zeros(count, bool)
        """Whether each episode stays."""
        self._times = np.zeros((2, count))
        """Deadline and arrival of new plans, s from now."""
        self._tracker.reset(count)

    def goal(self, state: Any, goal: Any, exact: bool = True) -> Any:
        """The goal to fly to, with the times of new plans where there are; updates `stays`.

        It must be called once in every control period.

        Args:
            state: states (N,).
            goal: goals, with their `rans_missions.tasks.orbital.Plan`.
            exact: whether states are exact, so that a state within the tolerances is an arrival.
        """
        count = np.size(state.p.x)
        if len(self.stays) != count:
            self.reset(count)
        mission = self._mission
        plan = goal.notes
        deadline, won = (
            np.broadcast_to(np.asarray(x, float), count) for x in (plan.deadline, plan.won)
        )
        distance = np.broadcast_to((goal.p - state.p).norm(), count)
        over = (deadline < TIME_ROUNDING) | (won > 0.5)
        arrived = over & (distance < _NEAR * mission.position_tolerance)
        if exact:
            arrived = arrived | mission.reached(state, goal)
        self.stays = (self.stays | arrived) & (distance < _LEFT * mission.position_tolerance)
        again = over & ~self.stays
        expired = again & (self._times[0] < TIME_ROUNDING)
        if expired.any():
            new = mission.plan(state, goal, np.full(count, self._again))
            times = np.stack([new.notes.deadline, new.notes.arrival])
            self._times = np.where(expired, times, self._times)
        if again.any():
            begun = replace(
                plan,
                deadline=np.where(again, self._times[0], plan.deadline),
                arrival=np.where(again, self._times[1], plan.arrival),
                won=np.where(again, 0.0, plan.won),
            )
            goal = replace(goal, notes=begun)
        self._times = np.where(again, self._times - self._period, 0.0)
        return goal

    def commands(
        self, state: Any, goal: Any, others: np.ndarray, acceleration: Any = None
    ) -> np.ndarray:
        """Commands (N, commands) with which craft that stay do so, and ``others`` of those that do not.

        Args:
            state: states (N,).
            goal: goals.
            others: commands (N, commands).
            acceleration: constant acceleration of each in W beside the drift, m/s^2; None: none.
        """
        if not self.stays.any():
            return others
        change = self._mission.staying(state, goal, acceleration) - state.v
        staying = self._tracker.commands(state, change, self.stays)
        return np.where(self.stays[:, None], staying, others)
