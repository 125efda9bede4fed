"""Rewards for being at rest in the goal set, and for staying there (decision 018)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial, reduce
from operator import add

from rans.model.fields import Field
from rans.renamed import renamed
from rans.tasks.rewards import Transition, is_used, nearness, speed, within


@renamed(verge_weight="boundary_weight", arrived_squarings="arrived_sharpness")
@dataclass(frozen=True)
class Arrived:
    """Settings of a task whose goal stands still; by default nothing of this is computed or logged."""

    arrived_weight: float = 0.0
    """Reward for being at rest within the tolerances, which makes agents arrive early."""
    arrived_fine_weight: float = 0.0
    """Weight of the narrow rewards of position and attitude while at rest within the tolerances; needs
    `arrived_weight`."""
    arrived_still_weight: float = 0.0
    """Weight of a narrow reward of low speed while at rest within the tolerances: a slower arrival needs no
    correction; needs `arrived_weight`."""
    arrived_still_scale: float = 0.003
    """Speed at which it has fallen to 1/e, m/s."""
    arrived_thrust_weight: float = 0.0
    """Reward lost per open thruster while at rest within the tolerances, which saves propellant there but not on
    the way; needs `arrived_weight`."""
    arrived_within: float = 1.0
    """Fraction of the tolerances that counts as arrived; below 1 leaves a margin."""
    boundary_weight: float = 0.0
    """Reward lost outside of the tolerances, but within twice as much: a flight to the goal passes through in a
    step or two, and one that has arrived should not leave."""
    arrived_speed: float = 0.05
    """Speed below which a craft counts as at rest, m/s."""
    arrived_spin: float = math.radians(5.0)
    """Angular speed below which a craft counts as at rest, rad/s."""
    arrived_sharpness: int = 2
    """Sharpness of the edges: how many times errors over their bounds are squared."""

    def arrived(
        self, transition: Transition, closest: tuple[Field, ...], *shares: Field
    ) -> dict[str, Field]:
        """Terms whose weight is not zero, by name.

        Args:
            transition: control period.
            closest: narrow rewards of each error.
            shares: errors over the task's tolerances.
        """
        state = transition.state
        inside = partial(within, sharpness=self.arrived_sharpness)
        shares = tuple(share / self.arrived_within for share in shares)
        terms: dict[str, Field] = {}  # not `dict[str, Field]()`, which torch's compiler cannot read
        if is_used(self.arrived_weight):
            rest = state.v.norm() / self.arrived_speed, speed(state.spin()) / self.arrived_spin
            worth = sum(closest) * self.arrived_fine_weight + self.arrived_weight
            if is_used(self.arrived_still_weight):
                worth = (
                    worth
                    + nearness(state.v.norm(), self.arrived_still_scale) * self.arrived_still_weight
                )
            if is_used(self.arrived_thrust_weight):
                worth = worth - reduce(add, transition.thrusters) * self.arrived_thrust_weight
            terms["arrived"] = inside(*shares, *rest) * worth
        if is_used(self.boundary_weight):
            near = inside(*(0.5 * share for share in shares))
            terms["boundary"] = near * (1.0 - inside(*shares)) * -self.boundary_weight
        return terms
