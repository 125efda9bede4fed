"""Parts of rewards: nearness to the goal, rest within the tolerances, and prices that every task can charge."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial, reduce
from operator import add
from typing import Any

from rans.model.dynamics import State
from rans.model.fields import Field, absolute, exp, finite, sqrt, where
from rans.renamed import renamed

_SQUARINGS = 4
"""So often numbers up to 256 may be squared in single precision."""


def nearness(error: Field, scale: float, rest: float = 0.0) -> Field:
    """exp(-error / scale): 1 at the goal, 1/e at the scale (original system, 2023).

    Below an error of ``rest`` nothing is nearer, so that nothing is gained by chattering there; the shape is
    moved out by so much.
    """
    if is_used(rest):
        beyond = error - rest
        error = 0.5 * (
            beyond + absolute(beyond)
        )  # no `where`: optimisers round absolute values off
    return exp(error * (-1.0 / scale))


def within(*shares: Field, sharpness: int) -> Field:
    """Smooth step: 1 where every number is below 1, 0.5 where one is 1, 0 where one is above.

    The sharpness is how many times the numbers are squared.
    """
    if sharpness > _SQUARINGS:  # far away they would overflow single precision
        most = 2.0 ** (120.0 / 2**sharpness)
        shares = tuple(where(share < most, share, most) for share in shares)
    for _ in range(sharpness):
        shares = tuple(share * share for share in shares)
    return 1.0 / (1.0 + sum(shares))


def speed(spin: tuple[Field, ...]) -> Field:
    """Length of an angular velocity, rad/s."""
    return sqrt(sum(w * w for w in spin))


@dataclass(frozen=True)
class Transition:
    """One control period as a reward sees it.

    The fields after ``previous`` may be left out where no reward reads them, as in tests of one term. Engines
    always give them, and remember only what some reward reads (`rans.episode`).
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
    forces: tuple[float, ...] = ()
    """Full force of each thruster, N."""

    def __iter__(self) -> Iterator[Any]:
        """The first four fields, so that a reward may unpack state, goal, command and previous."""
        return iter((self.state, self.goal, self.command, self.previous))

    @property
    def thrusters(self) -> Sequence[Field]:
        """Commands of the thrusters alone, without those of reaction wheels; all, if nothing says how many."""
        return self.command[: len(self.forces)] if self.forces else self.command

    @property
    def impulse(self) -> Field:
        """Impulse that the command asks for, N s: force times time, summed over the thrusters.

        Thrusters that share a supply give less; `rans.evaluation.measure.metrics` counts what they give.
        """
        return reduce(add, (c * f for c, f in zip(self.thrusters, self.forces, strict=True))) * (
            self.period
        )


@dataclass(frozen=True)
class Prices:
    """Settings that every task has: what a step costs, wherever the goal is.

    Thrust, speed and spin are priced linearly, as by the original system of 2023; switching is ours.
    What has no price is neither computed nor logged.
    """

    thrust_weight: float = 0.02
    """Reward lost per step and open thruster; it also stops the chatter at the goal."""
    switching_weight: float = 0.0
    """Reward lost per valve that opens or shuts; all are shut before an episode."""
    speed_weight: float = 0.0
    """Reward lost per step and m/s of speed."""
    spin_weight: float = 0.0
    """Reward lost per step and rad/s of angular speed."""

    def prices(self, transition: Transition) -> dict[str, Field]:
        """The terms whose weight is not zero."""
        state = transition.state
        command = transition.command
        previous = transition.previous
        terms: dict[str, Field] = {}
        if is_used(self.thrust_weight):
            terms["thrust"] = reduce(add, transition.thrusters) * -self.thrust_weight
        if is_used(self.switching_weight):
            moved = [absolute(new - old) for new, old in zip(command, previous, strict=True)]
            terms["switching"] = reduce(add, moved) * -self.switching_weight
        if is_used(self.speed_weight):
            terms["speed"] = state.v.norm() * -self.speed_weight
        if is_used(self.spin_weight):
            terms["spin"] = speed(state.spin()) * -self.spin_weight
        return terms


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
    departed_weight: float = 0.0
    """Reward lost in a control period that begins at rest within the tolerances and does not end so: who has
    arrived should stay, and correct itself with pulses that leave it at rest."""
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
        terms: dict[str, Field] = {}  # not `dict[str, Field]()`, which torch's compiler cannot read
        if is_used(self.arrived_weight):
            worth = sum(closest) * self.arrived_fine_weight + self.arrived_weight
            if is_used(self.arrived_still_weight):
                worth = (
                    worth
                    + nearness(state.v.norm(), self.arrived_still_scale) * self.arrived_still_weight
                )
            if is_used(self.arrived_thrust_weight):
                worth = worth - reduce(add, transition.thrusters) * self.arrived_thrust_weight
            terms["arrived"] = self._at_rest(state, shares) * worth
        if is_used(self.boundary_weight):
            shares = tuple(share / self.arrived_within for share in shares)
            near = inside(*(0.5 * share for share in shares))
            terms["boundary"] = near * (1.0 - inside(*shares)) * -self.boundary_weight
        return terms

    def departed(
        self, transition: Transition, shares: Callable[[State], tuple[Field, ...]]
    ) -> dict[str, Field]:
        """The price of leaving rest within the tolerances; nothing where its weight is zero.

        Args:
            transition: control period.
            shares: errors of a state over the task's tolerances.
        """
        if not is_used(self.departed_weight):
            return {}
        after = transition.state
        before = after if transition.before is None else transition.before
        stayed = self._at_rest(after, shares(after))
        left = self._at_rest(before, shares(before)) * (1.0 - stayed)
        return {"departed": left * -self.departed_weight}

    def _at_rest(self, state: State, shares: tuple[Field, ...]) -> Field:
        """Smooth indicator of rest within the tolerances: 1 inside, 0 outside."""
        return within(
            *(share / self.arrived_within for share in shares),
            state.v.norm() / self.arrived_speed,
            speed(state.spin()) / self.arrived_spin,
            sharpness=self.arrived_sharpness,
        )


def is_used(setting: Any) -> bool:
    """Whether this setting matters; one that a curriculum moves does, whatever it is now."""
    return not isinstance(setting, int | float) or setting != 0


def paid(terms: dict[str, Field], terminated: Field) -> tuple[dict[str, Field], Field]:
    """Rewards by name, and their sum: zeros where an episode failed and left no number.

    A state that is lost has no reward, and a trainer could make nothing of NaN. In an episode that goes on
    NaN stays: there the task's reward is wrong, which a training tells.
    """
    total = sum(terms.values())
    known = finite(total) | ~terminated
    return {name: where(known, term, 0.0) for name, term in terms.items()}, where(known, total, 0.0)
