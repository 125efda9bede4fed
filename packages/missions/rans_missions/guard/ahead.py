"""Prediction of control periods by the engine's equations of motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from rans.effectors.motion import states_at_checks
from rans.extend import Body, Field, StepInputs, World
from rans.tasks.base import goal_after
from rans_missions.guard.expected import Reserve

SLACK = 0.002
"""Least margin by default, in the unit of each margin, as a tolerance for rounding and model errors."""


class PredictedState(NamedTuple):
    """Predicted state, goal and least margin of a control period."""

    state: Any
    goal: Any
    least: Field
    """Least margin at all checks of the period, less reserves and what margins may fall between checks, (N,)."""


@dataclass(frozen=True)
class Ahead:
    """Predictor of a spacecraft's motion as designed, without faults, disturbances and delays."""

    world: World
    reserve: Reserve = ()
    """See `rans_missions.guard.expected.Expected`."""

    def margins(self, state: Any, goal: Any) -> dict[str, Field]:
        """Margins of the constraints, less the reserves."""
        reserves = dict(self.reserve)
        margins = self.world.task.constraints(state, goal).items()
        return {name: margin - reserves.get(name, 0.0) for name, margin in margins}

    def delayed(
        self, state: Any, goal: Any, before: Sequence[tuple[Field, ...]], delay: float
    ) -> tuple[Any, Any]:
        """State and goal when a command begins to act that is decided now.

        Until then the commands act that were decided before.

        Args:
            state: measured state.
            goal: goal at the same time.
            before: commands of earlier control periods, the latest first.
            delay: time from the reading until a command acts, s.
        """
        period = self.world.timing.control_period
        whole = int(delay / period + 1e-9)
        rest = delay - whole * period
        parts = [(k, period) for k in range(min(whole, len(before)) - 1, -1, -1)]
        if rest > 1e-9 * period and whole < len(before):
            parts.insert(0, (whole, rest))
        for k, seconds in parts:
            # With the usual checks, so that the same command is predicted with the same rounding as before.
            timing = replace(self.world.timing, control_period=seconds)
            *_, state = states_at_checks(
                state,
                self.world.craft,
                self.body,
                before[k],
                timing,
                self.world.task.drift_at(goal),
                self.world.nodes,
            )
            goal = self.world.task.later(goal, seconds)
        return state, goal

    @cached_property
    def body(self) -> Body:
        """Body of the craft as designed."""
        return Body.of(self.world.craft)

    def _between(self, before: Any, after: Any, goal: Any, apart: float) -> dict[str, Field]:
        """Margins halfway between two states with the goal at the first, a time (s) apart, on a cubic path."""
        p = (before.p + after.p).scale(0.5) + (before.v - after.v).scale(0.125 * apart)
        v = (after.p - before.p).scale(1.5 / apart) - (before.v + after.v).scale(0.25)
        return self.margins(replace(after, p=p, v=v), self.world.task.later(goal, 0.5 * apart))

    def fly(self, state: Any, goal: Any, command: tuple[Field, ...]) -> PredictedState:
        """Predict a control period in which a command is held.

        A margin with ends a and b and m halfway falls by at most half of a - 2 m + b below the line between them,
        if it is a parabola: near a ball of radius R this is the sagitta (v dt)^2 / (8 R) of the chord.
        """
        world = self.world
        task = world.task
        apart = world.timing.control_period / world.timing.checks
        least: Any = np.inf
        states = world.move(state, StepInputs(self.body, (command,), drift=task.drift_at(goal)))
        before = self.margins(state, goal)
        for reached in states:
            halfway = self._between(state, reached, goal, apart)
            goal = goal_after(task, goal, reached, apart)
            now = self.margins(reached, goal)
            for name, margin in now.items():
                bend = np.maximum(before[name] - 2.0 * halfway[name] + margin, 0.0)
                least = np.minimum(least, margin - 0.5 * bend)
            state = reached
            before = now
        return PredictedState(states[-1], goal, least)
