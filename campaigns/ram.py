"""A task that rewards entering keep-out zones: it trains agents to break the safety filter.

``rans train campaigns.ram:Ram --set guard=true`` trains one behind the filter, and
``rans compare RUN --guard`` flies it.
"""

from __future__ import annotations

from dataclasses import dataclass

from rans_missions.tasks.avoid import Avoid

from rans.model.dynamics import State
from rans.model.fields import Field, where
from rans.tasks.rewards import Transition, nearness


@dataclass(frozen=True)
class Ram(Avoid):
    """Fly into a keep-out zone: zones, starts and observation of `Avoid`, with the opposite reward.

    Rewarded are the decrease of the distance from the nearest rim, being close to it, and being inside, which
    ends the episode.
    """

    violation_weight: float = 0.0
    towards_weight: float = 5.0
    """Reward for every metre by which the nearest rim comes nearer."""
    near_weight: float = 0.1
    """Reward per step at the rim of a zone."""
    entered_weight: float = 50.0
    """Reward once when a zone is entered."""

    def reward(self, transition: Transition) -> dict[str, Field]:
        """Of the nearest zone, before and after the control period."""
        assert transition.before is not None  # engines always give it
        before = self._nearest_gap(transition.before, transition.goal)
        after = self._nearest_gap(transition.state, transition.goal)
        inside = after < 0.0
        return {
            "towards": (before - after) * self.towards_weight,
            "near": nearness(where(inside, after * 0.0, after), self.zone_scale) * self.near_weight,
            "entered": where(inside, after * 0.0 + self.entered_weight, after * 0.0),
        }

    def _nearest_gap(self, state: State, goal: State) -> Field:
        """Distance from the nearest rim, m; negative inside."""
        gaps = list(self.constraints(state, goal).values())
        nearest = gaps[0]
        for gap in gaps[1:]:
            nearest = where(gap < nearest, gap, nearest)
        return nearest
