"""Propellant over one control period: what thrust uses up, and how much more it does to a lighter craft."""

from __future__ import annotations

import operator
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

from rans.effectors.effector import Action, Begun, Effector, Push, grown
from rans.model.body import Body
from rans.model.dynamics import Piece
from rans.model.fields import Field, at_least, map_leaves
from rans.model.spacecraft import CommandRange, Propellant, Store


@dataclass(frozen=True)
class Tank:
    """Tank of a craft that flies.

    Mass and inertia fall in the same proportion, so that a craft with a share s of its full mass moves under a
    wrench as the full craft does under 1 / s times that wrench. Motion is computed that way: the body stays,
    wrenches grow. A disturbance acts on the mean mass of a piece of a period.
    """

    propellant: Propellant
    full_mass: Field
    """Mass of the craft with a full tank, kg."""

    @classmethod
    def of(cls, propellant: Propellant, body: Body) -> Tank:
        """Tank of a craft whose body is that with a full tank."""
        return cls(propellant, body.mass)

    def growth(self, left: Field) -> Field:
        """Full mass over the mass with so much propellant left, kg."""
        return self.full_mass / (self.full_mass - (self.propellant.mass - left))

    def burned(self, piece: Piece, left: Field) -> Iterator[tuple[Piece, Field]]:
        """A piece of a control period as two, with thrust and after the tank is empty, each with what is left then.

        Wrenches are those of the full craft that moves alike. The thrust over the falling mass is taken as a
        straight line over time, lowered by (dm / m)^2 / 6 for the mass dm that the piece uses, so that its mean
        is right: the change of velocity is exact but for (dm / m)^4, the way but for (dm / m)^3. The instant at
        which a tank is empty is exact for constant thrust.

        Args:
            piece: of the thrusters, with their exhaust.
            left: propellant at its beginning, kg.
        """
        duration, first, last, longest = piece
        per_newton = 1.0 / self.propellant.exhaust_speed
        end = first if last is None else last
        exhaust: tuple[Field, Field] = first.exhaust, end.exhaust
        flow = exhaust[0] if last is None else 0.5 * (exhaust[0] + exhaust[1])
        needed = flow * duration * per_newton
        share = 1.0 - at_least(1.0 - left / at_least(needed, 1e-30), 0.0)
        used = needed * share
        if last is not None:
            end = map_leaves(lambda a, b: a + (b - a) * share, first, last)
            used = 0.5 * (exhaust[0] + end.exhaust) * (duration * share) * per_newton
        after = at_least(left - used, 0.0)
        begins = self.growth(left)
        ends = self.growth(after)
        gone = used * (0.5 * (begins + ends)) * (1.0 / self.full_mass)
        factor = 1.0 - gone * gone * (1.0 / 6.0)
        starts = grown(first, begins * factor)
        stops = grown(end, ends * factor)
        if last is not None:
            # Of a thrust that changes too, for the mean of the product of two straight lines.
            change = (ends - begins) * (1.0 / 6.0)
            bent = map_leaves(lambda a, b: (b - a) * change, first, end)
            starts = map_leaves(operator.sub, starts, bent)
            stops = map_leaves(operator.sub, stops, bent)
        yield (duration * share, starts, stops, longest), after
        nothing = map_leaves(lambda x: x * 0.0, first)
        yield (duration * (1.0 - share), nothing, None, longest), after


@dataclass(frozen=True)
class PropellantTank(Effector):
    """Propellant as an effector: it takes no commands, keeps what is left, and makes pushes grow as mass falls."""

    propellant: Propellant
    store: Store

    @property
    def commands(self) -> tuple[CommandRange, ...]:
        """None."""
        return ()

    @property
    def stores(self) -> tuple[Store, ...]:
        """Propellant left, kg."""
        return (self.store,)

    def begin(self, begun: Begun) -> Action:
        """See `Effector`."""
        return _Burning(Tank.of(self.propellant, begun.body), begun.stores[0])


class _Burning(Action):
    def __init__(self, tank: Tank, left: Field) -> None:
        self._tank = tank
        self._left = left

    def pushes(self, pushes: Iterable[Push]) -> Iterator[Push]:
        """Pushes as they move the full craft, each with its growth (`Tank.burned`)."""
        tank = self._tank
        for push in pushes:
            left = self._left
            piece = (push.duration, push.first, push.last, push.longest)
            for (duration, first, last, longest), after in tank.burned(piece, left):
                growth = tank.growth(left), tank.growth(after)
                self._left = left = after
                last = last if last is None else replace(last, exhaust=None)
                yield Push(duration, replace(first, exhaust=None), last, longest, growth)

    def stores(self, time: Field) -> tuple[Field, ...]:
        """Propellant left."""
        return (self._left,)
