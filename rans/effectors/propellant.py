"""Propellant over a control period: the mass that thrust consumes, and its effect on the motion."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

from rans.effectors.effector import Action, Begun, Effector, Growth, Push
from rans.model.body import Body
from rans.model.dynamics import RULES, Piece, Wrench
from rans.model.fields import Field, at_least, fraction_of, map_leaves, sqrt
from rans.model.spacecraft import CommandRange, Propellant, Store

_MOST_BURNED = 0.02
"""Largest share of its mass that a craft may burn in one part of a period: 25 s are then within 1e-5 m and 1e-5 rad
for craft that turn by up to 1.5 rad in a period (`tests.effectors.test_pairs`). All craft that come with RANS
burn less in a whole period."""
_MOST_PARTS = 16
"""Largest number of parts, which bounds the length of generated programs."""


@dataclass(frozen=True)
class Tank:
    """Propellant tank of a craft with a given mass.

    Mass and inertia decrease in the same proportion. A craft with a share s of its full mass therefore moves
    under a load as the full craft does under 1 / s times that load, and motion is computed in this way: the
    body is constant, and thrust, disturbances, motor torques and momenta of wheels are scaled.
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

    def burned(self, piece: Piece, left: Field) -> Iterator[tuple[Push, Field]]:
        """Divide a piece into parts with thrust and with an empty tank, each with the propellant left after it.

        Wrenches are scaled to the full craft (`Growth`). With the mass dm that the piece consumes of the mass m,
        the error of the velocity change is of order (dm / m)^6 for thrust that does not turn, and of order (dm /
        m)^2 times the square of the angle turned for thrust that does. Recorded flights of craft with propellant
        change with any other order of these operations.

        Args:
            piece: piece of the thrusters, with their exhaust.
            left: propellant at the start of the piece, kg.
        """
        duration, first, last, longest = piece
        end = first if last is None else last
        # A nozzle does not suck: the thrust of shut valves is a rounding of either sign.
        flow: Field = at_least(first.exhaust, 0.0)
        mean = flow if last is None else 0.5 * (flow + at_least(end.exhaust, 0.0))

        # Until the tank is empty: a share of the propellant that the piece needs, and of its time.
        needed = mean * duration * (1.0 / self.propellant.exhaust_speed)
        enough = fraction_of(left, needed)
        used = needed * enough
        open_part = enough
        if last is not None:
            # The root of flow s + (end - flow) s^2 / 2 = mean * enough, in the form without cancellation.
            squared = flow * flow + 4.0 * enough * mean * (mean - flow)
            root = sqrt(at_least(squared, 1e-30))  # above 0, where the slope of a root is infinite
            open_part = fraction_of(2.0 * enough * mean, flow + root)
            end = map_leaves(lambda a, b: a + (b - a) * open_part, first, last)
        after = at_least(left - used, 0.0)

        # Mass falls linearly under constant thrust, else quadratically.
        rule = RULES[3]
        masses = (left - used * node for node, _ in rule)
        if last is not None:
            pace = duration * open_part * (1.0 / self.propellant.exhaust_speed)
            bend = 0.5 * (end.exhaust - flow)
            masses = (left - pace * (flow * node + bend * (node * node)) for node, _ in rule)
        growth = Growth.of([self.growth(mass) for mass in masses], rule)
        starts, stops = growth.line(first, None if last is None else end)
        yield (
            Push(
                duration * open_part,
                _without_exhaust(starts),
                _without_exhaust(stops),
                longest,
                growth,
            ),
            after,
        )
        nothing = _without_exhaust(map_leaves(lambda x: x * 0.0, first))
        empty = Growth.steady(self.growth(after))
        yield Push(duration * (1.0 - open_part), nothing, None, longest, empty), after


def _without_exhaust(wrench: Wrench) -> Wrench:
    return replace(wrench, exhaust=None)


def divided(piece: Piece, count: int) -> Iterator[Piece]:
    """``count`` equal parts of a piece, in order; wrenches at their ends lie on the piece's line.

    `Tank.burned` takes one part at a time, within which mass falls.
    """
    duration, first, last, longest = piece
    for k in range(count):
        begins, ends = first, last
        if last is not None:
            begins, ends = (
                map_leaves(lambda a, b, x=x: a + (b - a) * x, first, last)
                for x in (k / count, (k + 1) / count)
            )
        yield duration * (1.0 / count), begins, ends, longest / count


@dataclass(frozen=True)
class PropellantTank(Effector):
    """Propellant as an effector: its state is the mass left, and it scales wrenches as the mass decreases."""

    propellant: Propellant
    store: Store
    fastest: float
    """Largest loss of mass of the nearly empty craft with all thrusters open, a share of its mass per second."""

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
        return _Burning(Tank.of(self.propellant, begun.body), begun.stores[0], self.fastest)


class _Burning(Action):
    def __init__(self, tank: Tank, left: Field, fastest: float) -> None:
        self._tank = tank
        self._left = left
        self._fastest = fastest

    def pushes(self, pushes: Iterable[Push]) -> Iterator[Push]:
        """Parts of the period with wrenches scaled to the full craft (`Tank.burned`).

        Takes the propellant of each part from what is left: iterate once, and read `stores` afterwards.
        """
        tank = self._tank
        for push in pushes:
            parts = math.ceil(push.longest * self._fastest / _MOST_BURNED - 1e-9)
            piece = (push.duration, push.first, push.last, push.longest)
            for part in divided(piece, min(max(parts, 1), _MOST_PARTS)):
                for burning, after in tank.burned(part, self._left):
                    self._left = after
                    yield burning

    def stores(self, time: Field) -> tuple[Field, ...]:
        """Propellant left, kg."""
        return (self._left,)
