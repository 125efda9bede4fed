"""Go to a pose and stay there, in the plane (GoToPose-2D) or in space (GoToPose-3D)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from typing import ClassVar

from rans.model.dynamics import State
from rans.model.fields import Field
from rans.model.random import Random
from rans.tasks.base import Arriving
from rans.tasks.observation_terms import ObservationTerm, RelativeRotation, VectorInW
from rans.tasks.rewards import RestReward, Transition, is_used, nearness

_NONE = RestReward()


@dataclass(frozen=True)
class GoToPose(Arriving):
    """Go to a pose and stay there (paper: Table 1, rows "Go to pose"; sections 3.2 and 4.1).

    >>> rans.Engine("floating-platform", rans.GoToPose(thrust_weight=0.05), num_envs=4)
    <Engine: 4 x floating-platform, GoToPose, on cpu>

    Goal: the origin of W with any attitude. Start: at rest, any bearing, any attitude.

    Observed task data, plane: p_goal - p in W (2 columns, m), cos and sin of goal heading - heading.
    Space: p_goal - p in W (3 columns, m), first two rows of R_WB^T R_WGoal (6 columns).
    """

    misaligned_weight: float = 0.0
    """Weight of a penalty for a wrong attitude at the goal's position (narrow copies)."""
    rest_attitude: float = 0.0
    """Attitude error below which the attitude reward is constant, so that thrust gains nothing, rad."""
    arrived: RestReward = _NONE
    """Reward for rest within the tolerances."""
    attitude_tolerance: float = math.radians(5.0)
    """Attitude error that counts as reached, rad."""

    attitude_scale: ClassVar[float] = 0.25
    """Error at which the attitude reward has fallen to 1/e, rad (original system, 2023)."""
    turn_scale: ClassVar[float] = 1.0
    """Attitude error at which the turn reward has fallen to 1/e, rad: a third of the largest error."""

    flag = 1

    def sample(self, random: Random) -> tuple[State, State]:
        """Start around the goal at the origin; the order of draws is part of every recorded flight."""
        start = random.around(*self.spawn_distance)
        return start, random.at_rest(random.origin(), random.attitude())

    def observation_terms(self, state: State, goal: State) -> tuple[ObservationTerm, ...]:
        """Vector in W, m, and rotation to the goal; agents' files record kinds and order of terms."""
        return (
            VectorInW("d", "m", goal.p - state.p),
            RelativeRotation("d", "-", state.attitude.to(goal.attitude)),
        )

    def reward(self, transition: Transition) -> dict[str, Field]:
        """Terms exp(-distance / scale) and exp(-angle / scale) of the original system, wider and narrower copies.

        Without the wide "turn" term some seeds keep the position with any attitude and remain in that local
        optimum. Without "approach" training takes twice as long (docs/decisions/learning.md).

        Shipped agents were trained with it, so that another term or scale needs a setting whose default leaves it
        out.
        """
        distance, angle, *_ = self.errors(transition.state, transition.goal).values()
        near = partial(nearness, distance, rest=self.rest_position)
        aligned = partial(nearness, angle, rest=self.rest_attitude)
        closest = near(self.fine_scale), aligned(self.fine_scale)
        terms = {
            "position": near(self.position_scale),
            "attitude": aligned(self.attitude_scale),
            "approach": near(self.approach_scale) * self.approach_weight,
            "turn": aligned(self.turn_scale) * self.approach_weight,
        }
        if is_used(self.fine_weight):
            terms["fine position"] = closest[0] * self.fine_weight
            terms["fine attitude"] = closest[1] * self.fine_weight
        if is_used(self.misaligned_weight):
            terms["misaligned"] = closest[0] * (closest[1] - 1.0) * self.misaligned_weight
        relative = partial(self._relative_errors, goal=transition.goal)
        return {
            **terms,
            **self.arrived.terms(transition, closest, *relative(transition.state)),
            **self.prices(transition),
        }

    def _relative_errors(self, state: State, goal: State) -> tuple[Field, ...]:
        """Errors over their tolerances."""
        distance, angle, *_ = self.errors(state, goal).values()
        return distance / self.position_tolerance, angle / self.attitude_tolerance
