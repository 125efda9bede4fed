"""Prediction of control periods by the engine's equations of motion."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

from rans.episode import World
from rans.model.body import Body
from rans.model.fields import Field, where
from rans.randomization.parameters import StepInputs
from rans.tasks.base import goal_after


class Arrival(NamedTuple):
    """Predicted state, goal and margins of a control period."""

    state: Any
    goal: Any
    margins: tuple[dict[str, Field], ...]
    """Margins at every check of the period."""

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

    def fly(self, state: Any, goal: Any, command: tuple[Field, ...]) -> Arrival:
        """Predict a control period in which a command is held."""
        world = self.world
        task = world.task
        apart = world.timing.control_period / world.timing.checks
        margins = []
        states = world.move(state, StepInputs(self.body, (command,)))
        for there in states:
            goal = goal_after(task, goal, there, apart)
            margins.append(task.constraints(there, goal))
        return Arrival(states[-1], goal, tuple(margins))
