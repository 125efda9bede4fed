"""What an effector is: anything that pushes or turns a craft, or changes how others do."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from rans.model.body import Body
from rans.model.dynamics import Wrench
from rans.model.fields import Field, Vec2, Vec3, map_leaves
from rans.model.spacecraft import CommandRange, Store


@dataclass(frozen=True)
class Push:
    """A part of a control period in which everything that effectors do is steady, or a straight line over time.

    Effectors change it one after the other (`Action.pushes`). Wrenches act on the centre of mass, in B.
    """

    duration: Field
    """How long it lasts, s."""
    first: Wrench
    """Wrench at its beginning, of the craft with a full tank that moves alike."""
    last: Wrench | None
    """Wrench at its end; None: it stays."""
    longest: float
    """How long it may last at most, s."""
    growth: tuple[Field, Field] | None = None
    """Full mass over the mass at its beginning and at its end; None: mass stays."""
    momentum: tuple[Any, Any] | None = None
    """Angular momentum inside the craft in B, N m s, at its beginning and what is added until its end; a vector
    in space, a scalar about z in the plane. None: nothing inside it spins."""

    def with_torque(self, torque: Any) -> Push:
        """The part with a torque in B more, N m, that is steady."""
        begins = ends = torque
        if self.growth is not None:
            begins, ends = (times(torque, growth) for growth in self.growth)
        last = self.last
        return replace(
            self,
            first=replace(self.first, torque=self.first.torque + begins),
            last=last if last is None else replace(last, torque=last.torque + ends),
        )

    def with_force(self, force: Any) -> Push:
        """The part with a force in B through the centre of mass more, N, that is steady."""
        begins = ends = force
        if self.growth is not None:
            begins, ends = (times(force, growth) for growth in self.growth)
        last = self.last
        return replace(
            self,
            first=replace(self.first, force=self.first.force + begins),
            last=last if last is None else replace(last, force=last.force + ends),
        )


class Begun(NamedTuple):
    """What an effector knows at the beginning of a control period."""

    command: Sequence[Field]
    """Its own commands."""
    stores: Sequence[Field]
    """Its own stores."""
    body: Body
    """Mass properties of the craft with a full tank."""
    period: float
    """Length of the control period, s."""


class Action:
    """What an effector does in one control period: by default nothing."""

    def pushes(self, pushes: Iterable[Push]) -> Iterator[Push]:
        """Parts of the period as this effector changes them, lazily and in order; it may divide them."""
        yield from pushes

    def stores(self, time: Field) -> tuple[Field, ...]:
        """Its stores at a time since the period began, s, after all parts until then were asked for."""
        return ()


class Effector(ABC):
    """Thrusters, propellant, reaction wheels, or a kind of your own.

    Derive a frozen dataclass of numbers, and put one into `rans.Spacecraft.further_effectors`: action spaces,
    policies, kernels, exports and figures follow from `commands` and `stores`. Drake needs its own description
    of it (`rans.reference.further.DrakeEffector`). Everything is a pure function over fields.
    """

    @property
    @abstractmethod
    def commands(self) -> tuple[CommandRange, ...]:
        """Numbers that it takes in every control period, with their kinds and ranges."""

    @property
    def stores(self) -> tuple[Store, ...]:
        """Numbers that it keeps in the state of the craft: by default none."""
        return ()

    @property
    def largest_torque(self) -> float:
        """The largest torque about the centre of mass that it can give, N m: by default none."""
        return 0.0

    @abstractmethod
    def begin(self, begun: Begun) -> Action | None:
        """What it does in a control period that begins like this; None: nothing that changes parts or stores."""


def times(amount: Any, factor: Field) -> Any:
    """A vector or a scalar times a factor."""
    return amount.scale(factor) if isinstance(amount, Vec2 | Vec3) else amount * factor


def grown(wrench: Wrench, factor: Field) -> Wrench:
    """A wrench times a factor."""
    return map_leaves(lambda x: x * factor, wrench)
