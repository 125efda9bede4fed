"""Parts of rewards: nearness to the goal, rest within the tolerances, and prices of every task.

Terms are fields; agents were trained with them, so that a change is another task.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial, reduce
from operator import add
from typing import Any, ClassVar

from rans.base.display import Settings
from rans.model.dynamics import State
from rans.model.fields import Field, absolute, exp, finite, sqrt, where
from rans.tasks.settings import check_settings

_SQUARINGS = 4
"""Number of times that numbers up to 256 may be squared in single precision."""


def nearness(error: Field, scale: float, rest: float = 0.0) -> Field:
    """exp(-error / scale): 1 at the goal, 1/e at the scale (original system, 2023).

    Errors below ``rest`` have a nearness of 1, so that chattering there gains nothing; the exponential is shifted
    by ``rest``.
    """
    if is_used(rest):
        beyond = error - rest
        error = 0.5 * (
            beyond + absolute(beyond)
        )  # no `where`: optimisers round absolute values off
    return exp(error * (-1.0 / scale))


def smooth_within(*shares: Field, sharpness: int) -> Field:
    """Smooth step: near 1 where every number is below 1, 0.5 where one of them is 1, near 0 where one is above 1.

    The sharpness is the number of times that the numbers are squared.
    """
    if sharpness > _SQUARINGS:  # large numbers would overflow single precision
        limit = 2.0 ** (120.0 / 2**sharpness)
        shares = tuple(where(ratio < limit, ratio, limit) for ratio in shares)
    for _ in range(sharpness):
        shares = tuple(ratio * ratio for ratio in shares)
    return 1.0 / (1.0 + sum(shares))


def speed(spin: tuple[Field, ...]) -> Field:
    """Length of an angular velocity, rad/s."""
    return sqrt(sum(w * w for w in spin))


@dataclass(frozen=True)
class Transition:
    """Inputs of a reward: states, goal and commands of one control period.

    The fields after ``previous`` may be left out where no reward reads them, as in tests of one term. Engines
    always provide them, and store only what some reward reads (`rans.episode.step`).
    """

    state: State
    """State at the end of the period."""
    goal: State
    """Goal at the end of the period, with the episode's data in its ``notes``."""
    command: tuple[Field, ...]
    """Command held during the period: one field per thruster, 0 (shut) to 1 (fully open)."""
    previous: tuple[Field, ...]
    """Command of the period before; all shut at the start of an episode."""
    before: State | None = None
    """State at the start of the period, for rewards by the difference of a potential."""
    period: float = 0.0
    """Length of the period, s."""
    forces: tuple[float, ...] | None = None
    """Full force of each thruster, N; None: every command is that of a thruster."""

    def __iter__(self) -> Iterator[Any]:
        """Iterator over state, goal, command and previous, so that a reward may unpack them."""
        return iter((self.state, self.goal, self.command, self.previous))

    @property
    def thrusters(self) -> Sequence[Field]:
        """Commands of the thrusters, without those of other effectors; all commands if ``forces`` is None."""
        return self.command if self.forces is None else self.command[: len(self.forces)]

    @property
    def beyond_thrusters(self) -> Sequence[Field]:
        """Commands of reaction wheels and further effectors; none if ``forces`` is None."""
        return () if self.forces is None else self.command[len(self.forces) :]

    @property
    def impulse(self) -> Field:
        """Commanded impulse, N s: force times time, summed over the thrusters.

        Thrusters that share a supply give less; `rans.evaluation.measure.metrics` counts the actual impulse.
        """
        if not self.forces:
            return 0.0
        spent = (c * f for c, f in zip(self.thrusters, self.forces, strict=True))
        return reduce(add, spent) * self.period


@dataclass(frozen=True)
class Prices:
    """Prices of thrust and spin, which are settings of every task.

    Both are linear, as in the original system of 2023. Terms of zero weight are neither computed nor logged.
    """

    thrust_weight: float = 0.02
    """Reward lost per step and open thruster; it also prevents chattering at the goal."""
    spin_weight: float = 0.0
    """Reward lost per step and rad/s of angular speed."""

    def prices(self, transition: Transition) -> dict[str, Field]:
        """Price terms whose weight is not zero, by name."""
        terms: dict[str, Field] = {}
        if is_used(self.thrust_weight) and transition.thrusters:
            terms["thrust"] = reduce(add, transition.thrusters) * -self.thrust_weight
        if is_used(self.spin_weight):
            terms["spin"] = speed(transition.state.spin()) * -self.spin_weight
        return terms


@dataclass(frozen=True)
class RestReward(Settings):
    """Reward for rest within the tolerances of a fixed goal; by default there is none, and no term is logged.

    >>> rans.GoToPose(arrived=rans.RestReward(weight=6.0, thrust_weight=1.5))
    GoToPose(arrived=RestReward(weight=6.0, thrust_weight=1.5))

    Raises:
        ConfigError: a number is out of its range.
    """

    weight: float = 0.0
    """Reward for rest within the tolerances, which makes agents arrive early."""
    fine_weight: float = 0.0
    """Weight of the narrow rewards of position and attitude while at rest within the tolerances; needs
    `weight`."""
    still_weight: float = 0.0
    """Weight of a narrow reward of low speed while at rest within the tolerances, so that no corrections follow;
    needs `weight`."""
    thrust_weight: float = 0.0
    """Reward lost per open thruster while at rest within the tolerances, which saves propellant there without
    slowing the approach; needs `weight`."""
    boundary_weight: float = 0.0
    """Reward lost between the tolerances and twice the tolerances. An approach passes this region in a step or two,
    and an agent that has arrived should not return to it."""
    within: float = 1.0
    """Fraction of the tolerances that counts as arrived; below 1 leaves a margin."""
    spin: float = math.radians(5.0)
    """Angular speed below which a craft counts as at rest, rad/s. Under disturbances it must exceed the change of
    spin by one pulse."""
    sharpness: int = 2
    """Sharpness of the edges: number of times that errors over their bounds are squared."""

    still_scale: ClassVar[float] = 0.003
    """Speed at which the reward of low speed has fallen to 1/e, m/s: 0.6 mm in a control period of 0.2 s."""
    speed: ClassVar[float] = 0.05
    """Speed below which a craft counts as at rest, m/s, as in the goal set (`rans.tasks.goal_set.REST_SPEED`)."""

    def __post_init__(self) -> None:
        check_settings(self)

    def terms(
        self, transition: Transition, closest: tuple[Field, ...], *errors: Field
    ) -> dict[str, Field]:
        """Terms of the reward at the end of a control period whose weight is not zero, by name.

        Args:
            transition: states and commands of the control period.
            closest: narrow rewards of each error.
            errors: errors divided by the task's tolerances.
        """
        state = transition.state
        inside = partial(smooth_within, sharpness=self.sharpness)
        terms: dict[str, Field] = {}  # not `dict[str, Field]()`, which torch's compiler cannot read
        if is_used(self.weight):
            worth = sum(closest) * self.fine_weight + self.weight
            if is_used(self.still_weight):
                worth = worth + nearness(state.v.norm(), self.still_scale) * self.still_weight
            if is_used(self.thrust_weight) and transition.thrusters:
                worth = worth - reduce(add, transition.thrusters) * self.thrust_weight
            terms["arrived"] = self._at_rest(state, errors) * worth
        if is_used(self.boundary_weight):
            scaled = tuple(error / self.within for error in errors)
            near = inside(*(0.5 * error for error in scaled))
            terms["boundary"] = near * (1.0 - inside(*scaled)) * -self.boundary_weight
        return terms

    def _at_rest(self, state: State, errors: tuple[Field, ...]) -> Field:
        """Smooth indicator of rest within the tolerances: 1 inside, 0 outside."""
        return smooth_within(
            *(error / self.within for error in errors),
            state.v.norm() / self.speed,
            speed(state.spin()) / self.spin,
            sharpness=self.sharpness,
        )


def is_used(setting: Any) -> bool:
    """Whether a setting has an effect: it is not zero, or a curriculum changes it."""
    return not isinstance(setting, int | float) or setting != 0


def paid(terms: dict[str, Field], terminated: Field) -> tuple[dict[str, Field], Field]:
    """Reward terms by name and their sum, with zeros where an episode has failed and the sum is not finite.

    The reward of a lost state is not defined, and trainers cannot use NaN. In an episode that continues NaN is
    kept, because there the reward of the task is wrong, which trainers report. Values are fields.
    """
    total = sum(terms.values())
    is_paid = finite(total) | ~terminated
    return {name: where(is_paid, term, 0.0) for name, term in terms.items()}, where(
        is_paid, total, 0.0
    )
