"""Go to a pose at a price that every episode draws and shows: one agent from fast to thrifty."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, replace

from rans.errors import ConfigError, brief
from rans.model.dynamics import State
from rans.model.fields import Field, exp, log
from rans.model.random import Random
from rans.renamed import renamed
from rans.tasks.go_to_pose import GoToPose
from rans.tasks.observation_terms import ObservationTerm, TradeOff
from rans.tasks.rewards import Transition

_PRICED = {
    name: f"{name}_weight" for name in ("misaligned", "thrust", "switching", "speed", "spin")
}
"""Terms of the reward that the price multiplies, and their weights."""


@renamed(knob="trade_off")
@dataclass(frozen=True)
class GoToPosePriced(GoToPose):
    """Go to a pose with a trade-off: every episode draws and shows at what price it is flown.

    >>> rans.GoToPosePriced(trade_off=(0.3, 0.3))
    GoToPosePriced(trade_off=(0.3, 0.3))

    The price is low (high / low)^trade_off, the trade-off uniform. The policy observes the trade-off, 0 (fast) to 1
    (thrifty), after what `GoToPose` shows; start and goal of an episode are that task's. So one agent learns
    every trade of time for thrust, and is judged at five positions, each by itself.

    Raises:
        ConfigError: the trade-off leaves 0 to 1, or a price is zero; and as `GoToPose`.
    """

    trade_off: tuple[float, float] = (0.0, 1.0)
    """Range of the trade-off that episodes draw from."""
    price: tuple[float, float] = (0.5, 8.0)
    """What thrust_weight and the other prices are multiplied by with the trade-off at 0 and at 1."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if isinstance(self.trade_off[1], float | int) and self.trade_off[1] > 1.0:
            raise ConfigError(
                f"trade_off must be a range within 0 (fast) to 1 (thrifty), got {self.trade_off!r}."
            )
        if isinstance(self.price[0], float | int) and self.price[0] == 0.0:
            raise ConfigError(f"price must be > 0, as it rises by factors, got {self.price!r}.")

    def parts(self) -> Mapping[str, GoToPosePriced]:
        """Every position of the trade-off; where it is held, nothing is left to name."""
        return TradeOffPositions(self) if self.draws_trade_off else {"": self}

    @property
    def draws_trade_off(self) -> bool:
        """Whether the range of the trade-off has any width."""
        return self.trade_off[0] != self.trade_off[1]

    @property
    def held_trade_off(self) -> float | None:
        """The only position in the range of the trade-off; None: the range has a width."""
        return None if self.draws_trade_off else self.trade_off[0]

    @property
    def is_held(self) -> bool:
        """Deprecated: whether `held_trade_off` is a number."""
        warnings.warn(
            "GoToPosePriced.is_held is deprecated and leaves with the next version: ask draws_trade_off.",
            DeprecationWarning,
            stacklevel=2,
        )
        return not self.draws_trade_off

    def with_trade_off(self, trade_off: float) -> GoToPosePriced:
        """The same at one position, 0 (fast) to 1 (thrifty), of the trade-off."""
        return replace(self, trade_off=(trade_off, trade_off))

    def plain(self) -> GoToPose:
        """What an agent flies whose trade-off is fixed: `GoToPose` with the price in its weights."""
        price = float(self.price_at(self.trade_off[0]))
        own = {one.name: getattr(self, one.name) for one in fields(GoToPose)}
        return GoToPose(**own | {name: price * own[name] for name in _PRICED.values()})

    def price_at(self, trade_off: Field) -> Field:
        """What the prices are multiplied by at this trade-off."""
        low, high = self.price
        ratio = high / low
        # NumPy's own would make arrays of single precision double, and torch's compiler cannot follow it.
        rise = math.log(ratio) if isinstance(ratio, float) else log(ratio)
        return exp(trade_off * rise) * low

    def sample(self, random: Random) -> tuple[State, State]:
        """As `GoToPose`; the goal notes the trade-off."""
        start, goal = super().sample(random)
        return start, replace(goal, notes=(random.uniform(*self.trade_off),))

    def observation_terms(self, state: State, goal: State) -> tuple[ObservationTerm, ...]:
        """As `GoToPose`, and the trade-off."""
        return (*super().observation_terms(state, goal), TradeOff("trade-off", "-", goal.notes[0]))

    def reward(self, transition: Transition) -> dict[str, Field]:
        """As `GoToPose`, with the price of the episode."""
        price = self.price_at(transition.goal.notes[0])
        return {
            name: term * price if name in _PRICED else term
            for name, term in super().reward(transition).items()
        }


@dataclass(frozen=True)
class TradeOffPositions(Mapping[str, GoToPosePriced]):
    """A task with its trade-off fixed: five positions to go through, and any other to pick, such as "0.3"."""

    task: GoToPosePriced

    def __getitem__(self, name: str) -> GoToPosePriced:
        """The task at this position; `ConfigError` if it is no number from 0 to 1."""
        try:
            return self.task.with_trade_off(float(name))
        except (ValueError, ConfigError):
            raise ConfigError(
                f"the trade-off ranges from 0 (fast) to 1 (thrifty), got {brief(name)}."
            ) from None

    def __iter__(self) -> Iterator[str]:
        return (f"{at:g}" for at in (0.0, 0.25, 0.5, 0.75, 1.0))

    def __len__(self) -> int:
        return 5
