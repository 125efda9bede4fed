"""Go to a pose with an observed trade-off between time and thrust: one agent for the whole Pareto front."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, replace

from rans.base.errors import ConfigError, NoSuchKey, brief
from rans.model.dynamics import State
from rans.model.fields import Field, exp, log
from rans.model.random import Random
from rans.tasks.go_to_pose import GoToPose
from rans.tasks.observation_terms import ObservationTerm, TradeOff
from rans.tasks.rewards import Transition

_PRICED = {name: f"{name}_weight" for name in ("misaligned", "thrust", "spin")}
"""Terms of the reward that are multiplied by the price, and the settings of their weights."""


@dataclass(frozen=True)
class DrawnTradeOff:
    """What a goal of `GoToPosePriced` notes."""

    trade_off: Field
    """Trade-off between time and impulse, 0 (fast) to 1 (thrifty)."""


@dataclass(frozen=True)
class GoToPosePriced(GoToPose):
    """Go to a pose with a trade-off between time and thrust, which every episode draws and the policy observes.

    >>> rans.GoToPosePriced(trade_off=(0.3, 0.3))
    GoToPosePriced(trade_off=(0.3, 0.3))

    The trade-off is uniform from 0 (fast) to 1 (thrifty), and the price is low (high / low)^trade_off. The policy
    observes the trade-off after the terms of `GoToPose`; starts and goals are those of that task. One agent thus
    learns all trade-offs, and it is evaluated at five of them separately.

    Raises:
        ConfigError: the trade-off is outside 0 to 1, or a price is zero; and as for `GoToPose`.
    """

    trade_off: tuple[float, float] = (0.0, 1.0)
    """Range from which episodes draw the trade-off."""
    price: tuple[float, float] = (0.5, 8.0)
    """Factor on thrust_weight and the other prices at a trade-off of 0 and of 1."""

    goal_notes = DrawnTradeOff

    def __post_init__(self) -> None:
        super().__post_init__()
        if isinstance(self.trade_off[1], float | int) and self.trade_off[1] > 1.0:
            raise ConfigError(
                f"trade_off must be a range within 0 (fast) to 1 (thrifty), got {self.trade_off!r}."
            )
        if isinstance(self.price[0], float | int) and self.price[0] == 0.0:
            raise ConfigError(f"price must be > 0, as it rises by factors, got {self.price!r}.")

    def parts(self) -> Mapping[str, GoToPosePriced]:
        """Tasks at fixed trade-offs by name; the task itself as "" if its trade-off is fixed."""
        return TradeOffPositions(self) if self.draws_trade_off else {"": self}

    @property
    def draws_trade_off(self) -> bool:
        """Whether episodes draw the trade-off: its range is not a single number."""
        return self.trade_off[0] != self.trade_off[1]

    @property
    def held_trade_off(self) -> float | None:
        """Fixed trade-off; None if episodes draw it."""
        return None if self.draws_trade_off else self.trade_off[0]

    def with_trade_off(self, trade_off: float) -> GoToPosePriced:
        """The task with a fixed trade-off from 0 (fast) to 1 (thrifty)."""
        return replace(self, trade_off=(trade_off, trade_off))

    def plain(self) -> GoToPose:
        """`GoToPose` with the weights of the fixed trade-off, for agents that do not observe it."""
        price = float(self.price_at(self.trade_off[0]))
        settings = {field.name: getattr(self, field.name) for field in fields(GoToPose)}
        return GoToPose(**settings | {name: price * settings[name] for name in _PRICED.values()})

    def price_at(self, trade_off: Field) -> Field:
        """Factor on the prices at a trade-off."""
        low, high = self.price
        ratio = high / low
        # NumPy's log would turn float32 arrays into float64, and torch's compiler cannot trace it.
        rise = math.log(ratio) if isinstance(ratio, float) else log(ratio)
        return exp(trade_off * rise) * low

    def sample(self, random: Random) -> tuple[State, State]:
        """As `GoToPose`, and a trade-off in the goal's notes, drawn last to leave the start as it is."""
        start, goal = super().sample(random)
        return start, replace(goal, notes=DrawnTradeOff(random.uniform(*self.trade_off)))

    def observation_terms(self, state: State, goal: State) -> tuple[ObservationTerm, ...]:
        """Terms of `GoToPose`, then the trade-off; agents' files record the kinds and order of terms."""
        trade_off = TradeOff("trade-off", "-", goal.notes.trade_off)
        return (*super().observation_terms(state, goal), trade_off)

    def reward(self, transition: Transition) -> dict[str, Field]:
        """Terms (fields) of `GoToPose` with the price of the episode, from the goal's notes."""
        price = self.price_at(transition.goal.notes.trade_off)
        return {
            name: term * price if name in _PRICED else term
            for name, term in super().reward(transition).items()
        }


@dataclass(frozen=True)
class TradeOffPositions(Mapping[str, GoToPosePriced]):
    """Tasks at fixed trade-offs by name: five to iterate over, and any other as a key, such as "0.3"."""

    task: GoToPosePriced

    def __getitem__(self, name: str) -> GoToPosePriced:
        """Task at the trade-off of this name.

        Raises:
            NoSuchKey: the name is not a number from 0 to 1.
        """
        try:
            return self.task.with_trade_off(float(name))
        except (ValueError, TypeError, ConfigError):
            raise NoSuchKey(
                f"the trade-off ranges from 0 (fast) to 1 (thrifty), got {brief(name)}."
            ) from None

    def __iter__(self) -> Iterator[str]:
        return (f"{at:g}" for at in (0.0, 0.25, 0.5, 0.75, 1.0))

    def __len__(self) -> int:
        return 5
