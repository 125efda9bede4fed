"""Safety of coasting: states from which a spacecraft may keep all valves shut without violating a constraint."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rans.extend import FREE, Ball, Field, absolute, at_least, map_leaves
from rans_missions.guard.ahead import Ahead
from rans_missions.guard.rows import count, is_array

_CHUNK = 2**22
"""Largest number of instants times spacecraft that are evaluated at once."""


@dataclass(frozen=True)
class Coasting:
    """Check whether a coasting craft keeps every margin of a task's constraints.

    In free flight among keep-out balls the result is exact and for all times: a point and a ball on straight lines
    are closest at t = -(r . u) / (u . u), with their relative position r and velocity u. Otherwise margins are
    evaluated at the ends of control periods up to a horizon, with the exact drift and motion of the goal. They
    exceed half of their second difference, so that a smooth margin, or the larger of two smooth margins, is not
    negative between two instants either.
    """

    ahead: Ahead
    """Spacecraft, task and reserves of its constraints."""
    horizon: int
    """Number of control periods that are evaluated if the result is not for all times."""

    def least(self, state: Any, goal: Any) -> Field:
        """Least margin of coasting from states (N,) with goals (N,), less the largest reserve, (N,).

        From the filter's slack on it is a promise that all valves may be shut: it may be too low, never too high.
        """
        balls = self._balls(goal)
        if balls is None:
            return self._sampled(state, goal)
        result = None
        for ball in balls:
            margin = _closest(ball, state)
            result = margin if result is None else np.minimum(result, margin)
        assert result is not None
        return result - max((reserve for _, reserve in self.ahead.reserve), default=0.0)

    def _balls(self, goal: Any) -> tuple[Ball, ...] | None:
        """Balls of the constraints; None if there are other constraints or a drift.

        A constraint that is no ball of the scenery makes it None, and `least` then samples.
        """
        task = self.ahead.world.task
        shapes = task.scenery(goal)
        if task.drift != FREE or not all(isinstance(shape, Ball) for shape in shapes):
            return None
        if len(shapes) != len(task.constraints(goal, goal)):
            return None
        return shapes  # pyrefly: ignore[bad-return]

    def _sampled(self, state: Any, goal: Any) -> Field:
        """Least margin (N,) of a coast over the horizon, from samples and what the margin may sag between them.

        Second differences bound the sag of smooth margins only: they must not be cut off or switched between
        samples.
        """
        period = self.ahead.world.timing.control_period
        size = count(state)
        chunk = max(4, _CHUNK // size)
        result = np.full(size, np.inf)
        # Consecutive chunks share two instants, so that every instant has a second difference.
        for begin in range(0, self.horizon, chunk):
            last = min(self.horizon, begin + chunk + 2)
            times = period * np.arange(begin, last + 1)[:, None]
            for margin in self._margins(state, goal, times):
                margin = margin + 0.0 * times
                bend = absolute(margin[2:] - 2.0 * margin[1:-1] + margin[:-2])
                sag = 0.5 * bend
                # The ends use the second difference of their neighbours.
                for part in (margin[1:-1], margin[:-2], margin[2:]):
                    result = np.minimum(result, (part - sag).min(axis=0))
            if last == self.horizon:
                break
        return result

    def _margins(self, state: Any, goal: Any, times: Field) -> tuple[Field, ...]:
        """Margins of coasting craft after times (T, 1), (T, N)."""
        task = self.ahead.world.task
        p, v = task.drift_at(goal).carry(state.p, state.v, times)
        spread = map_leaves(lambda x, t=times: x + 0.0 * t if is_array(x) else x, state)
        later = replace(spread, p=p, v=v)
        return tuple(self.ahead.margins(later, task.later(goal, times)).values())


def _closest(ball: Ball, state: Any) -> Field:
    """Least margin of a ball from now on for points in free flight, m."""
    offset = state.p - ball.centre
    speed = state.v - ball.v
    square = at_least(speed.dot(speed), 1e-20)
    time = at_least((0.0 - offset.dot(speed)) / square, 0.0)
    nearest = offset + speed.scale(time)
    return nearest.norm() - ball.radius


def periods_of(seconds: float, period: float) -> int:
    """Number of control periods that cover a time (s), at least three."""
    return max(3, math.ceil(seconds / period - 1e-9))
