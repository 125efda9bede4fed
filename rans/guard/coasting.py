"""Where nothing needs to be done: states from which a spacecraft may shut all valves for good."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

from rans.episode import World
from rans.guard.rows import grid, is_array, like
from rans.model.drift import FREE
from rans.model.fields import Field, absolute, at_least, map_leaves
from rans.tasks.shapes import Ball

_CHUNK = 2**22
"""Instants times spacecraft that are asked at once."""


@dataclass(frozen=True)
class Coasting:
    """Whether a craft that coasts keeps every margin of a task's constraints.

    Where nothing pulls and all constraints are keep-out balls, the answer is exact and for all times: a point
    and a ball that both move straight come closest at t = -(r . u) / (u . u), for their relative position r and
    velocity u. Otherwise margins are asked at the ends of control periods up to a horizon, of the exact drift
    and the goal's own motion, and must exceed half of their largest second difference there: a margin that is
    smooth, or the larger one of two smooth margins, is then not negative between two instants either.
    """

    world: World
    slack: float
    """Least margin, in its unit."""
    horizon: int
    """Control periods that are asked where the answer is not for all times."""

    def safe(self, state: Any, goal: Any) -> Field:
        """(N,) bool of states and goals of arrays or tensors (N,)."""
        balls = self._balls(goal)
        if balls is not None:
            result = None
            for ball in balls:
                clear = _closest(ball, state) >= self.slack
                result = clear if result is None else result & clear
            return result
        return self._sampled(state, goal)

    def _balls(self, goal: Any) -> tuple[Ball, ...] | None:
        """The balls that are all of the task's constraints; None: there are others."""
        task = self.world.task
        shapes = task.scenery(goal)
        if self.world.task.drift != FREE or not all(isinstance(one, Ball) for one in shapes):
            return None
        if len(shapes) != len(task.constraints(_anywhere(goal), goal)):
            return None
        return shapes  # pyright: ignore[reportReturnType]

    def _sampled(self, state: Any, goal: Any) -> Field:
        task = self.world.task
        period = self.world.timing.control_period
        size = len(next(x for x in (*state.p.columns(), *state.v.columns()) if is_array(x)))
        chunk = max(4, _CHUNK // size)
        result = like(state, size) >= 0.0
        # Consecutive parts share two instants, so that every instant has a second difference.
        for begin in range(0, self.horizon, chunk):
            last = min(self.horizon, begin + chunk + 2)
            times = grid(state, [k * period for k in range(begin, last + 1)])
            p, v = task.drift.carry(state.p, state.v, times)
            there = task.later(goal, times)
            spread = map_leaves(lambda x, t=times: x + 0.0 * t if is_array(x) else x, state)
            moved = replace(spread, p=p, v=v)
            for margin in task.constraints(moved, there).values():
                margin = margin + 0.0 * times
                bend = absolute(margin[2:] - 2.0 * margin[1:-1] + margin[:-2])
                sag = 0.5 * bend
                # The ends have their neighbours' second difference.
                result = result & (margin[1:-1] - sag >= self.slack).all(0)
                result = result & (margin[:-2] - sag >= self.slack).all(0)
                result = result & (margin[2:] - sag >= self.slack).all(0)
            if last == self.horizon:
                break
        return result


def _closest(ball: Ball, state: Any) -> Field:
    """Least margin of a ball from now on, m, of points that fly straight."""
    way = state.p - ball.centre
    speed = state.v - ball.v
    square = at_least(speed.dot(speed), 1e-20)
    time = at_least((0.0 - way.dot(speed)) / square, 0.0)
    nearest = way + speed.scale(time)
    return nearest.norm() - ball.radius


def _anywhere(goal: Any) -> Any:
    """A state to ask the names of constraints with."""
    return replace(goal, notes=())


def periods_of(seconds: float, period: float) -> int:
    """Whole control periods that last so long, at least three."""
    return max(3, math.ceil(seconds / period - 1e-9))
