"""Propellant over a control period: the mass that thrust consumes, and its effect on the motion."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

from rans.effectors.effector import Action, Begun, Effector, Growth, Loss, Push
from rans.model.body import Body
from rans.model.dynamics import RULES, Emptied, Piece
from rans.model.fields import Field, Vec2, Vec3, at_least, fraction_of, map_leaves, sqrt
from rans.model.spacecraft import Propellant, Store

_MOST_BURNED = 0.01
"""Largest share of its mass that a craft may burn in one part of a period: 5 s are then within 4e-8 m and 7e-9 rad
for craft that burn a third of their mass in them (`tests.effectors.test_pairs`), and errors fall with its fourth
power. All craft that come with RANS burn less in a whole period."""
_MOST_PARTS = 16
"""Largest number of parts, which bounds the length of generated programs."""


@dataclass(frozen=True)
class Tank:
    """Propellant tank of a craft.

    A craft with a share s of its full mass moves under a load as the full craft does under 1 / s times that load,
    and motion is computed in this way: the body is constant, and thrust, disturbances, motor torques and momenta
    of wheels are scaled. Inertia decreases in the same proportion, unless the tank has a place: with g = 1 / s
    the centre of mass is then at (1 - g) a from B's origin and g times the inertia is that of the full craft
    I + (g - 1) (I - k M) - g (g - 1) M (a.a 1 - a a'), with the tank's arm a, the full mass M and the liquid's
    own inertia k for each kilogram. What leaves takes no momentum but that of a part of the craft.
    """

    propellant: Propellant
    body: Body
    """With a full tank."""
    arm: tuple[Field, ...] | None
    """From B's origin to the liquid, m: two entries in the plane; None: it is spread as the craft's mass is."""

    def growth(self, left: Field) -> Field:
        """Full mass over the mass with ``left`` kilograms of propellant."""
        return self.body.mass / (self.body.mass - (self.propellant.mass - left))

    def _push(
        self,
        piece: Piece,
        values: Sequence[Field],
        grown: Callable[[Sequence[Field]], Growth],
    ) -> Push:
        """A part of a period under a wrench, in which full mass over mass has these values.

        Args:
            piece: the part, with the wrench on the true craft about the centre of mass with a full tank.
            values: at the nodes of a rule, or one that does not change.
            grown: lines of such values.
        """
        duration, first, last, longest = piece
        first = replace(first, exhaust=None)
        last = None if last is None else replace(last, exhaust=None)
        growth = turning = grown(values)
        if self.arm is None:
            loss = Loss(growth, turning)
            return Push(duration, *loss.scaled(first, last), longest, loss)
        # The lever arms of thrusters change by (g - 1) a.
        levers = [g * (g - 1.0) for g in values]
        arm: Any = (Vec2 if len(self.arm) == 2 else Vec3)(*self.arm)
        flat = len(self.arm) == 2

        def excess(g: Field, lever: Field) -> tuple[Field, ...]:
            body = self.body
            return self.propellant.excess(body.mass, body.inertia, self.arm or (), g, lever)

        if flat:
            inertia = self.body.inertia[0]
            shares = [
                inertia / (inertia + excess(g, lever)[0])
                for g, lever in zip(values, levers, strict=True)
            ]
            levers, values = (
                [x * share for x, share in zip(one, shares, strict=True)]
                for one in (levers, values)
            )
            turning = grown(values)
        lever = grown(levers)
        loss = Loss(growth, turning, lever, arm)
        lacks = [
            Emptied(arm.scale(1.0 - g), () if flat else excess(g, x), turn)
            for g, x, turn in zip(growth.constant, lever.constant, turning.constant, strict=True)
        ]
        return Push(duration, *loss.scaled(first, last), longest, loss, (lacks[0], lacks[1]))

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
        lit = (duration * open_part, first, None if last is None else end, longest)
        values = [self.growth(mass) for mass in masses]
        yield self._push(lit, values, lambda values: Growth.of(values, rule)), after
        nothing = map_leaves(lambda x: x * 0.0, first)
        empty = (duration * (1.0 - open_part), nothing, None, longest)
        push = self._push(empty, [self.growth(after)], lambda values: Growth.steady(*values))
        yield replace(push, first=replace(nothing, exhaust=None), last=None), after


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
    arm: tuple[float, ...] | None = None
    """From the designed centre of mass with a full tank to the tank, axes of G, m; None: it has no place."""
    commands = ()

    @property
    def stores(self) -> tuple[Store, ...]:
        """Propellant left, kg."""
        return (self.store,)

    def begin(self, begun: Begun) -> Action:
        """Action over a control period: consume propellant and scale wrenches."""
        body = begun.body
        arm: Any = self.arm
        if arm is not None:
            centre = body.centre or arm[:0]
            arm = arm[: 2 if len(body.inertia) == 1 else 3]
            arm = tuple(a - b for a, b in zip(arm, centre, strict=True)) if centre else arm
        return _Burning(Tank(self.propellant, body, arm), begun.stores[0], self.fastest)


@dataclass(eq=False)
class _Burning(Action):
    tank: Tank
    left: Field
    fastest: float

    def pushes(self, pushes: Iterable[Push]) -> Iterator[Push]:
        """Parts of the period with wrenches scaled to the full craft (`Tank.burned`).

        Takes the propellant of each part from what is left: iterate once, and read `stores` afterwards.
        """
        tank = self.tank
        for push in pushes:
            parts = math.ceil(push.longest * self.fastest / _MOST_BURNED - 1e-9)
            piece = (push.duration, push.first, push.last, push.longest)
            for part in divided(piece, min(max(parts, 1), _MOST_PARTS)):
                for burning, after in tank.burned(part, self.left):
                    self.left = after
                    yield burning

    def stores(self, time: Field) -> tuple[Field, ...]:
        """Propellant left, kg."""
        return (self.left,)
