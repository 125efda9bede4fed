"""Prediction of control periods by the engine's equations of motion."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

from rans.episode import World
from rans.model.body import Body
from rans.model.fields import Field, at_least, where
from rans.randomization.parameters import StepInputs
from rans.tasks.base import goal_after


class Arrival(NamedTuple):
    """Predicted state, goal and margins of a control period."""

    state: Any
    goal: Any
    margins: tuple[dict[str, Field], ...]
    """Margins at every check of the period, less what a margin may fall below them between the checks."""

    @property
    def least(self) -> Field:
        """Least of all margins, (N,)."""
        result = None
        for margins in self.margins:
            for margin in margins.values():
                result = margin if result is None else where(margin < result, margin, result)
        return result


@dataclass(frozen=True)
class Ahead:
    """Predictor of a spacecraft's motion as designed, without faults, disturbances and delays."""

    world: World

    @cached_property
    def body(self) -> Body:
        """Body of the craft as designed."""
        return Body.of(self.world.craft)

    def _between(self, before: Any, after: Any, goal: Any, apart: float) -> dict[str, Field]:
        """Margins halfway between two states with the goal at the first, a time (s) apart, on a cubic path."""
        p = (before.p + after.p).scale(0.5) + (before.v - after.v).scale(0.125 * apart)
        v = (after.p - before.p).scale(1.5 / apart) - (before.v + after.v).scale(0.25)
        task = self.world.task
        return task.constraints(replace(after, p=p, v=v), task.later(goal, 0.5 * apart))

    def fly(self, state: Any, goal: Any, command: tuple[Field, ...]) -> Arrival:
        """Predict a control period in which a command is held.

        A margin with ends a and b and m halfway falls by at most half of a - 2 m + b below the line between them,
        if it is a parabola: near a ball of radius R this is the sagitta (v dt)^2 / (8 R) of the chord.
        """
        world = self.world
        task = world.task
        apart = world.timing.control_period / world.timing.checks
        margins = []
        states = world.move(state, StepInputs(self.body, (command,)))
        before = task.constraints(state, goal)
        for there in states:
            halfway = self._between(state, there, goal, apart)
            goal = goal_after(task, goal, there, apart)
            now = task.constraints(there, goal)
            margins.append(
                {
                    name: margin - 0.5 * at_least(before[name] - 2.0 * halfway[name] + margin, 0.0)
                    for name, margin in now.items()
                }
            )
            state = there
            before = now
        return Arrival(states[-1], goal, tuple(margins))
