"""Go to a position and stay there with any attitude, in the plane (GoToXY) or in space (GoToXYZ)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

from rans.model.dynamics import State
from rans.model.fields import Field
from rans.model.random import Random
from rans.tasks.base import Arriving
from rans.tasks.observation_terms import ObservationTerm, VectorInW
from rans.tasks.rewards import Transition, is_used, nearness, speed


@dataclass(frozen=True)
class GoToPosition(Arriving):
    """Go to a position and stay there (paper: Table 1, rows "Go to position"; sections 3.2 and 4.3).

    >>> rans.GoToPosition(position_tolerance=0.02).tolerances()
    {'position': 0.02}

    Goal: the origin of W. Start: at rest, any bearing, any attitude.

    Observed task data: p_goal - p in W (2 or 3 columns, m).
    """

    stillness_weight: float = 0.5
    """Weight of the reward for low spin; without it agents spin at 3 to 7 rad/s."""
    stillness_scale: float = 0.25
    """Angular speed at which the stillness reward has fallen to 1/e, rad/s."""
    rest_spin: float = 0.0
    """Angular speed below which the stillness reward is constant, so that thrust gains nothing, rad/s."""

    flag = 0

    def sample(self, random: Random) -> tuple[State, State]:
        """Start around the goal at the origin; the order of draws is part of every recorded flight."""
        start = random.around(*self.spawn_distance)
        return start, random.at_rest(random.origin(), random.no_rotation())

    def observation_terms(self, state: State, goal: State) -> tuple[ObservationTerm, ...]:
        """Vector to the goal in W, m; agents' files record the kinds and order of terms."""
        return (VectorInW("d", "m", goal.p - state.p),)

    def errors(self, state: State, goal: State) -> dict[str, Field]:
        """Distance from the goal, m, and angular speed, rad/s."""
        return {"position": (goal.p - state.p).norm(), "spin": speed(state.spin())}

    def reward(self, transition: Transition) -> dict[str, Field]:
        """Terms (fields): exp(-distance / scale) of the original system, two more scales, and low spin.

        Shipped agents were trained with it, so that another term or scale needs a setting whose default leaves it
        out.
        """
        distance, spin = self.errors(transition.state, transition.goal).values()
        near = partial(nearness, distance, rest=self.rest_position)
        still = nearness(spin, self.stillness_scale, self.rest_spin)
        terms = {
            "position": near(self.position_scale),
            "approach": near(self.approach_scale) * self.approach_weight,
            "stillness": still * self.stillness_weight,
        }
        if is_used(self.fine_weight):
            terms["fine"] = near(self.fine_scale) * self.fine_weight
        return {**terms, **self.prices(transition)}
