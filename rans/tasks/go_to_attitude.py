"""Turn to an attitude and stay there at rest, in space (GoToAttitude-3D)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import reduce
from operator import add
from typing import ClassVar

from rans.model.drift import FREE, ClohessyWiltshire, Drift
from rans.model.dynamics import State
from rans.model.fields import Field
from rans.model.random import Random
from rans.model.timing import Timing
from rans.tasks.base import SingleTask
from rans.tasks.observation_terms import Dimension, ObservationTerm, RelativeRotation
from rans.tasks.rewards import Transition, is_used, nearness
from rans.tasks.tracking import Tracking


@dataclass(frozen=True)
class GoToAttitude(SingleTask):
    """Turn to an attitude and stay there at rest; the position is free.

    >>> rans.Engine("innocube", rans.GoToAttitude(), num_envs=4)
    <Engine: 4 x innocube, GoToAttitude, on cpu>

    Reaction wheels suffice: it is the task for craft without thrusters. Goal: any attitude, at rest. Start: any
    attitude, with a spin about any axis.

    Observed task data: first two rows of R_WB^T R_WGoal (6 columns).
    """

    start_spin: ClassVar[tuple[float, float]] = (0.0, 0.1)
    """Range of the angular rate at the start, rad/s."""
    turn_scale: ClassVar[float] = 1.0
    """Attitude error at which the wide attitude reward has fallen to 1/e, rad: a third of the largest error."""
    attitude_scale: ClassVar[float] = 0.25
    """Attitude error at which the attitude reward has fallen to 1/e, rad, as in go-to-pose."""
    fine_scale: float = 0.02
    """Attitude error at which the narrow attitude reward has fallen to 1/e, rad."""
    rest_weight: ClassVar[float] = 1.0
    """Weight of the reward of low spin near the goal."""
    rest_scale: ClassVar[float] = 0.02
    """Angular rate at which the reward of low spin has fallen to 1/e, rad/s."""
    torque_weight: float = 0.02
    """Reward lost per step and wheel, times its squared command; it also prevents chattering at the goal."""
    attitude_tolerance: float = math.radians(1.0)
    """Attitude error that counts as reached, rad."""
    spin_tolerance: float = math.radians(0.5)
    """Angular rate that counts as rest, rad/s."""
    mean_motion: float | None = None
    """Mean motion of a circular orbit, rad/s, such as 0.00113 at 400 km: the goal rests in its Hill frame, and the
    gradient of gravity turns the craft. None: no planet."""
    fail_spin: float = 4.0
    """Angular rate beyond which an episode fails, rad/s, as in go-to-pose."""

    symmetric = False
    timing: ClassVar[Timing] = Timing(control_period=1.0, substeps=4, episode_steps=120)
    """1 Hz as InnoCube's attitude control. Wheels with their largest momenta would need 23 substeps; turns at
    0.2 rad/s with four differ by 1e-12 rad from those with 16."""
    dimensions: ClassVar[tuple[Dimension, ...]] = (3,)
    spacecraft: ClassVar[str | None] = "innocube"

    @property
    def drift(self) -> Drift:
        """Free flight, or the motion near a target on a circular orbit with the gradient of gravity."""
        if self.mean_motion is None:
            return FREE
        return ClohessyWiltshire(self.mean_motion, gravity_gradient=True)

    def sample(self, random: Random) -> tuple[State, State]:
        """Start, which spins, and goal at the origin; seeds rely on the order of draws."""
        spin = random.turn(self.start_spin)
        start = random.moving(random.origin(), random.attitude(), spin)
        return start, random.at_rest(random.origin(), random.attitude())

    def observation_terms(self, state: State, goal: State) -> tuple[ObservationTerm, ...]:
        """Rotation to the goal's attitude; agents' files record the kinds and order of terms."""
        return (RelativeRotation("d", "-", state.attitude.to(goal.attitude)),)

    def reward(self, transition: Transition) -> dict[str, Field]:
        """Terms (fields) exp(-angle / scale) at three scales, low spin near the goal, and prices.

        Shipped agents were trained with it: a further term needs a setting whose default leaves it out.
        """
        angle, spin, *_ = self.errors(transition.state, transition.goal).values()
        close = nearness(angle, self.attitude_scale)
        terms = {
            "turn": nearness(angle, self.turn_scale),
            "attitude": close,
            "fine attitude": nearness(angle, self.fine_scale),
            "rest": close * nearness(spin, self.rest_scale) * self.rest_weight,
        }
        wheels = transition.beyond_thrusters
        if is_used(self.torque_weight) and wheels:
            terms["torque"] = reduce(add, (u * u for u in wheels)) * -self.torque_weight
        return {**terms, **self.prices(transition)}

    failed = Tracking.failed
