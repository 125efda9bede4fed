"""Protocol of effectors: anything that applies a force or torque to a craft, or modifies those of others."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from operator import add
from typing import Any, NamedTuple

from rans.model.body import Body
from rans.model.drift import Drift
from rans.model.dynamics import Emptied, Rule, Wrench
from rans.model.fields import Field, Vec2, Vec3, map_leaves
from rans.model.spacecraft import CommandRange, Spacecraft, Store
from rans.model.timing import Timing


@dataclass(frozen=True)
class Growth:
    """Full mass over mass in a part of a control period, in which propellant may leave.

    A craft moves under a load as the full craft does under the load times this growth. Such a product is replaced
    by the linear function of time with the same integral and the same first moment, so that changes of velocity
    and displacements of a craft that does not turn are exact.
    """

    constant: tuple[Field, Field]
    """Start and end of the linear function for a load of 1."""
    rising: tuple[Field, Field]
    """Start and end of the linear function for a load that goes from 0 to 1."""

    @classmethod
    def of(cls, values: Sequence[Field], rule: Rule) -> Growth:
        """Growth from values (fields) at the nodes of a quadrature rule (`rans.model.dynamics.RULES`).

        The second line is that of the growth times the elapsed share, which positions need.
        """
        mean, first, second = (
            reduce(
                add,
                (x * (weight * node**k) for x, (node, weight) in zip(values, rule, strict=True)),
            )
            for k in range(3)
        )
        # The line from a to b has the integral (a + b) / 2 and the first moment (a + 2 b) / 6.
        return cls(
            (4.0 * mean - 6.0 * first, 6.0 * first - 2.0 * mean),
            (4.0 * first - 6.0 * second, 6.0 * second - 2.0 * first),
        )

    @classmethod
    def steady(cls, value: Field) -> Growth:
        """Growth of a part in which the mass is constant."""
        return cls((value, value), (value * 0.0, value))

    def line(self, first: Any, last: Any = None) -> tuple[Any, Any]:
        """Start and end of a load times the growth.

        Args:
            first: load at the start: a number, vector or wrench.
            last: load at the end, linear in time from ``first``; None: constant.
        """
        ends = []
        for constant, rising in zip(self.constant, self.rising, strict=True):
            if last is None:
                ends.append(map_leaves(lambda x, k=constant: x * k, first))
            else:
                grow = lambda x, y, k=constant, up=rising: x * k + (y - x) * up  # noqa: E731
                ends.append(map_leaves(grow, first, last))
        return ends[0], ends[1]


@dataclass(frozen=True)
class Loss:
    """What the propellant that has left does to loads on a craft in a part of a control period.

    The craft moves as the full one does, under loads that are scaled (`rans.effectors.propellant.Tank`).
    """

    growth: Growth
    """Full mass over mass."""
    turning: Growth
    """Factor on torques: in the plane full inertia over inertia, as a tank may be off the centre of mass; in space
    the same as `growth`."""
    lever: Growth | None = None
    """Factor on the torque of a force at the tank's `arm`, by which the centre of mass moves; None: it does not."""
    arm: Any = None
    """From B's origin to the tank, m: a vector. None: what leaves is spread as the mass is."""

    def scaled(self, first: Wrench, last: Wrench | None) -> tuple[Wrench, Wrench]:
        """Start and end for the full craft of a wrench on the true one, linear in time; last None: constant."""
        begins, ends = self.growth.line(first, last)
        if self.lever is None:
            return begins, ends
        turns = self.turning.line(first.torque, None if last is None else last.torque)
        moments = self.lever.line(*(_moment(self.arm, x) for x in (first, last) if x is not None))
        begins, ends = (
            replace(wrench, torque=turn + moment)
            for wrench, turn, moment in zip((begins, ends), turns, moments, strict=True)
        )
        return begins, ends


@dataclass(frozen=True)
class Push:
    """Part of a control period in which wrench and mass are constant or linear in time.

    Effectors modify it one after the other (`Action.pushes`), by `plus`. Wrenches act at the centre of mass, in B.
    """

    duration: Field
    """Duration, s."""
    first: Wrench
    """Wrench at the start, scaled so that the craft with a full tank has the acceleration of the true craft."""
    last: Wrench | None
    """Wrench at the end, scaled likewise; None: constant."""
    longest: float
    """Upper bound on the duration, s."""
    loss: Loss | None = None
    """What lost propellant does to loads; None: the craft has no propellant."""
    tank: tuple[Emptied, Emptied] | None = None
    """What a craft with a tank at a place lacks at the start and at the end; None: there is none."""
    momentum: tuple[Any, Any] | None = None
    """Angular momentum of wheels inside the craft in B, N m s, at the start, and its change until the end; vectors
    in space, scalars about z in the plane. None: no wheels."""

    def plus(self, first: Wrench, last: Wrench | None = None) -> Push:
        """The part with one more wrench, which acts on the true craft.

        What the propellant that has left does to it, and that thrust beside it may rise or fall, is in the result.

        Args:
            first: in B about the centre of mass with a full tank, N and N m: vectors in space, a vector and a
                scalar about z in the plane. `Begun.wrench` makes one of a force and where it acts.
            last: at the end, linear in time from ``first``; None: constant.
        """
        begins, ends = (
            (first, last or first) if self.loss is None else self.loss.scaled(first, last)
        )
        steady = self.last is None and last is None
        after = None if steady else _sum(self.last or self.first, ends)
        return replace(self, first=_sum(self.first, begins), last=after)


def _sum(a: Wrench, b: Wrench) -> Wrench:
    """Sum of two wrenches, with the exhaust of the first."""
    return replace(a, force=a.force + b.force, torque=a.torque + b.torque)


def _moment(arm: Any, wrench: Wrench) -> Any:
    """Torque of a wrench's force at an arm."""
    force: Any = wrench.force
    return arm.cross(force) if isinstance(arm, Vec3) else arm.x * force.y - arm.y * force.x


_NOTHING = Vec3(0.0, 0.0, 0.0)


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

    def wrench(
        self, torque: Vec3, force: Vec3 = _NOTHING, arm: tuple[float, float, float] = (0.0,) * 3
    ) -> Wrench:
        """Wrench in B about the true centre of mass, as `Push.plus` takes it.

        Vectors have three components in the plane too, where those play no part that nothing in it can feel.

        Args:
            torque: in B, N m.
            force: in B, N.
            arm: from the designed centre of mass to where the force acts, axes of B, m.
        """
        flat = len(self.body.inertia) == 1
        centre = (*(self.body.centre or (0.0, 0.0)), 0.0)[:3]
        away = Vec3(*(a - c for a, c in zip(arm, centre, strict=True)))
        turn = torque if force is _NOTHING else torque + away.cross(force)
        return Wrench(Vec2(force.x, force.y), turn.z) if flat else Wrench(force, turn)


class Action:
    """Action of an effector over one control period; by default none."""

    def pushes(self, pushes: Iterable[Push]) -> Iterator[Push]:
        """Parts of the period as modified by this effector, lazily and in order; it may divide them."""
        yield from pushes

    def stores(self, time: Field) -> tuple[Field, ...]:
        """States of the effector at a time since the start of the period (s); called after the parts before it."""
        return ()


class JointMotion(Action):
    """Action of an effector that integrates the motion of the craft itself, in place of adding to wrenches.

    It is for a mass that moves in the craft, and for loads that depend on the craft's motion, such as drag.
    A craft has one such action at most: its effector sets `Effector.moves_mass`, by which a second is refused.
    """

    @abstractmethod
    def steps(self, longest: float) -> int:
        """Least number of integration steps in a part of the period that lasts so long at most, s."""

    @abstractmethod
    def advance(self, *arguments: Any, **options: Any) -> Any:
        """State of the craft after a load has acted; arguments and result as of `rans.model.dynamics.advance`.

        The states of the effector move with it: `stores` returns those at the end.
        """


class Effector(ABC):
    """Base class of effectors: thrusters, propellant, reaction wheels, or a kind of your own.

    Derive a frozen dataclass of numbers, write its `commands` (a property; an empty tuple: none) and `begin`, and
    put an instance into `rans.Spacecraft.further_effectors`: action spaces, policies, kernels, exports and figures
    follow from `commands` and `stores`. Drake needs a description of its own
    (`rans.reference.further.DrakeEffector`). All methods are pure functions over fields.

    Effectors of packages have a name in `rans.model.spacecraft_file.EFFECTORS`, and a table of that name in the
    file of a spacecraft.
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

    @property
    def moves_mass(self) -> bool:
        """Whether its action is a `JointMotion`, as where a mass moves in the craft; by default not.

        Certified bounds and optimal trajectories refuse such a craft. Agents fly it. Controllers fly it as if it
        were rigid, and refuse it if the effector has commands.
        """
        return False

    @property
    def label(self) -> str:
        """Short text in lists, such as "0.5 kg slosh"; by default the name of the class."""
        return type(self).__name__

    @property
    def summary(self) -> str:
        """Its numbers in a line of `rans list SPACECRAFT`; by default empty: it has no line."""
        return ""

    @abstractmethod
    def begin(self, begun: Begun) -> Action | None:
        """Action of the effector over the control period; None if it changes neither parts nor states."""

    def of_craft(self, craft: Spacecraft) -> Effector:
        """The effector as a part of a craft, where its action depends on the craft; by default itself."""
        return self

    # Checks; each raises `ConfigError`, or returns nothing.

    def check_craft(self, craft: Spacecraft) -> None:
        """Refuse spacecraft on which it cannot be; by default none."""
        return

    def check_body(self, craft: Spacecraft, body: Body) -> None:
        """Refuse bodies, of numbers or of arrays (N,), with which it cannot be; by default none."""
        return

    def check_conditions(self, craft: Spacecraft, conditions: Any) -> None:
        """Refuse `rans.randomization.conditions.Conditions` with which it cannot be; by default none."""
        return

    def check_flight(
        self, craft: Spacecraft, drift: Drift, period: float, conditions: Any = None
    ) -> None:
        """Refuse drifts, control periods (s) and conditions for which it is not computed; by default none."""
        return

    def inaccuracy(self, craft: Spacecraft, states: Any, going: Any, timing: Timing) -> str:
        """What made its motion inaccurate in flights, as the end of a sentence; by default empty: nothing did.

        Args:
            craft: that flew.
            states: states of the flights, fields (T + 1, N).
            going: states that count, (T + 1, N).
            timing: timing of the flights with its number of substeps.
        """
        return ""


def times(amount: Any, factor: Field) -> Any:
    """Product of a vector or scalar with a scalar factor."""
    return amount.scale(factor) if isinstance(amount, Vec2 | Vec3) else amount * factor
