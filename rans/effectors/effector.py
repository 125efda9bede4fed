"""Protocol of effectors: anything that applies a force or torque to a craft, or modifies those of others."""

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
    """Part of a control period in which wrench and mass are constant or linear in time.

    Effectors modify it one after the other (`Action.pushes`). Wrenches act at the centre of mass, in B.
    """

    duration: Field
    """Duration, s."""
    first: Wrench
    """Wrench at the start, scaled so that the craft with a full tank has the acceleration of the true craft."""
    last: Wrench | None
    """Wrench at the end, scaled likewise; None: constant."""
    longest: float
    """Upper bound on the duration, s."""
    growth: tuple[Field, Field] | None = None
    """Full mass over mass at the start and at the end; None: the mass is constant."""
    momentum: tuple[Any, Any] | None = None
    """Angular momentum of wheels inside the craft in B, N m s, at the start, and its change until the end; vectors
    in space, scalars about z in the plane. None: no wheels."""

    def with_torque(self, torque: Any) -> Push:
        """The part with an additional constant torque in B, N m."""
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
        """The part with an additional constant force through the centre of mass in B, N."""
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
    """Inputs of an effector at the start of a control period."""

    command: Sequence[Field]
    """Commands of the effector."""
    stores: Sequence[Field]
    """States of the effector."""
    body: Body
    """Mass properties of the craft with a full tank."""
    period: float
    """Length of the control period, s."""


class Action:
    """Action of an effector over one control period; by default none."""

    def pushes(self, pushes: Iterable[Push]) -> Iterator[Push]:
        """Parts of the period as modified by this effector, lazily and in order; it may divide them."""
        yield from pushes

    def stores(self, time: Field) -> tuple[Field, ...]:
        """States of the effector at a time since the start of the period (s); called after the parts before it."""
        return ()


class Effector(ABC):
    """Base class of effectors: thrusters, propellant, reaction wheels, or a kind of your own.

    Derive a frozen dataclass of numbers and put an instance into `rans.Spacecraft.further_effectors`: action
    spaces, policies, kernels, exports and figures follow from `commands` and `stores`. Drake needs a description
    of its own (`rans.reference.further.DrakeEffector`). All methods are pure functions over fields.
    """

    @property
    @abstractmethod
    def commands(self) -> tuple[CommandRange, ...]:
        """Commands of the effector in every control period, with their kinds and ranges."""

    @property
    def stores(self) -> tuple[Store, ...]:
        """States of the effector, which are part of the craft's state; by default none."""
        return ()

    @property
    def largest_torque(self) -> float:
        """Largest torque of the effector about the centre of mass, N m; by default 0."""
        return 0.0

    @abstractmethod
    def begin(self, begun: Begun) -> Action | None:
        """Action of the effector over the control period; None if it changes neither parts nor states."""


def times(amount: Any, factor: Field) -> Any:
    """Product of a vector or scalar with a scalar factor."""
    return amount.scale(factor) if isinstance(amount, Vec2 | Vec3) else amount * factor


def grown(wrench: Wrench, factor: Field) -> Wrench:
    """Product of a wrench with a scalar factor."""
    return map_leaves(lambda x: x * factor, wrench)
