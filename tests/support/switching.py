"""A task of a user that charges for valves which open or shut, and so reads the command before."""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce
from operator import add

from rans import GoToPose
from rans.model.fields import Field, absolute
from rans.tasks.rewards import Transition, is_used


@dataclass(frozen=True)
class SwitchingGoToPose(GoToPose):
    """Go to a pose with a price of switching."""

    switching_weight: float = 0.1
    """Reward lost per valve that opens or shuts."""

    def reward(self, transition: Transition) -> dict[str, Field]:
        """Terms of `GoToPose`, and the price of switching unless its weight is zero."""
        terms = super().reward(transition)
        if is_used(self.switching_weight):
            pairs = zip(transition.command, transition.previous, strict=True)
            moved = reduce(add, [absolute(new - old) for new, old in pairs])
            terms["switching"] = moved * -self.switching_weight
        return terms
