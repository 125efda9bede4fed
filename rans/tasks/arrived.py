"""Rewards of having arrived: at rest within the tolerances, and there for good (decision 018)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial, reduce
from operator import add

from rans.model.fields import Field
from rans.tasks.rewards import Transition, is_used, nearness, speed, within


@dataclass(frozen=True)
class Arrived:
    """Settings of a task whose goal stands still; by default nothing of this is computed or logged."""

    arrived_weight: float = 0.0
    """Weight of what only those get who are at rest within the tolerances: for agents that should be soon."""
    arrived_fine_weight: float = 0.0
    """Weight of the narrow rewards of position and attitude, for those only; with `arrived_weight`."""
    arrived_still_weight: float = 0.0
    """Weight of a narrow reward of low speed, for those only: who arrives stiller need not correct; with
    `arrived_weight`."""
    arrived_still_scale: float = 0.003
    """Speed at which it has fallen to 1/e, m/s."""
    arrived_thrust_weight: float = 0.0
    """Weight lost per open thruster, by those only: thrift for the stay, none for the way; with
    `arrived_weight`."""
    arrived_within: float = 1.0
    """Share of the tolerances within which one has arrived for it, and on whose verge one is outside; below 1
    who is there has some to spare."""
    verge_weight: float = 0.0
    """Weight lost outside of the tolerances, but within twice as much: the way there passes in a step or two,
    and who is there should not leave."""
    arrived_speed: float = 0.05
    """Speed that counts as rest for it, m/s."""
    arrived_spin: float = math.radians(5.0)
    """Rate that counts as rest for it, rad/s."""
    arrived_squarings: int = 2
    """How sharp the edges are: errors over their bounds are squared so often."""

    def arrived(
        self, transition: Transition, closest: tuple[Field, ...], *shares: Field
    ) -> dict[str, Field]:
        """The terms whose weight is not zero.

        Shares are the errors over the task's tolerances; what is closest, the narrow rewards of each.
        """
        state = transition.state
        inside = partial(within, squarings=self.arrived_squarings)
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
        if is_used(self.verge_weight):
            near = inside(*(0.5 * share for share in shares))
            terms["verge"] = near * (1.0 - inside(*shares)) * -self.verge_weight
        return terms
