"""Propellant over a control period: the mass that thrust consumes, and its effect on the motion."""

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
    """Propellant tank of a craft with a given mass.

    Mass and inertia decrease in the same proportion. A craft with a share s of its full mass therefore moves
    under a wrench as the full craft does under 1 / s times that wrench, and motion is computed in this way: the
    body is constant and wrenches are scaled. A disturbance acts on the mean mass of a piece of a period.
    """

    propellant: Propellant
    full_mass: Field
    """Mass of the craft with a full tank, kg."""

    @classmethod
    def of(cls, propellant: Propellant, body: Body) -> Tank:
        """Tank of a craft from its body with a full tank."""
        return cls(propellant, body.mass)

    def growth(self, left: Field) -> Field:
        """Full mass over the mass with ``left`` kilograms of propellant."""
        return self.full_mass / (self.full_mass - (self.propellant.mass - left))

    def growth_over(self, left: Field, after: Field) -> tuple[Field, Field]:
        """Growth at both ends of a part of a period, as a linear function of time with the right mean.

        Args:
            left: propellant at the start of the part, kg.
            after: propellant at its end, kg.
        """
        begins = self.growth(left)
        ends = self.growth(after)
        gone = (left - after) * (0.5 * (begins + ends)) * (1.0 / self.full_mass)
        factor = 1.0 - gone * gone * (1.0 / 6.0)
        return begins * factor, ends * factor

    def burned(self, piece: Piece, left: Field) -> Iterator[tuple[Piece, Field]]:
        """Divide a piece into parts with thrust and with an empty tank, each with the propellant left after it.

        Wrenches are scaled to the full craft. The acceleration is approximated as linear in time and reduced by
        (dm / m)^2 / 6, with the mass dm that the piece consumes, so that its mean is correct. The error of the
        velocity change is of order (dm / m)^4, that of the displacement (dm / m)^3. The instant at which the
        tank is empty is exact for constant thrust.

        Args:
            piece: piece of the thrusters, with their exhaust.
            left: propellant at the start of the piece, kg.
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
        begins, ends = self.growth_over(left, after)
        starts = grown(first, begins)
        stops = grown(end, ends)
        if last is not None:
            # If the thrust changes too, the mean of a product of two linear functions needs this term.
            change = (ends - begins) * (1.0 / 6.0)
            bent = map_leaves(lambda a, b: (b - a) * change, first, end)
            starts = map_leaves(operator.sub, starts, bent)
            stops = map_leaves(operator.sub, stops, bent)
        yield (duration * share, starts, stops, longest), after
        nothing = map_leaves(lambda x: x * 0.0, first)
        yield (duration * (1.0 - share), nothing, None, longest), after


@dataclass(frozen=True)
class PropellantTank(Effector):
    """Propellant as an effector: its state is the mass left, and it scales wrenches as the mass decreases."""

    propellant: Propellant
    store: Store

    @property
    def commands(self) -> tuple[CommandRange, ...]:
        """No commands."""
        return ()

    @property
    def stores(self) -> tuple[Store, ...]:
        """Propellant left, kg."""
        return (self.store,)

    def begin(self, begun: Begun) -> Action:
        """Action over a control period: consume propellant and scale wrenches."""
        return _Burning(Tank.of(self.propellant, begun.body), begun.stores[0])


class _Burning(Action):
    def __init__(self, tank: Tank, left: Field) -> None:
        self._tank = tank
        self._left = left

    def pushes(self, pushes: Iterable[Push]) -> Iterator[Push]:
        """Parts of the period with wrenches scaled to the full craft (`Tank.burned`)."""
        tank = self._tank
        for push in pushes:
            left = self._left
            piece = (push.duration, push.first, push.last, push.longest)
            for (duration, first, last, longest), after in tank.burned(piece, left):
                growth = tank.growth_over(left, after)
                self._left = left = after
                last = last if last is None else replace(last, exhaust=None)
                yield Push(duration, replace(first, exhaust=None), last, longest, growth)

    def stores(self, time: Field) -> tuple[Field, ...]:
        """Propellant left, kg."""
        return (self._left,)
