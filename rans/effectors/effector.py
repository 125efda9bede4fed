"""Protocol of effectors: anything that applies a force or torque to a craft, or modifies those of others."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
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
    growth: Growth | None = None
    """Full mass over mass; None: the craft has no propellant."""
    turning: Growth | None = None
    """Factor on torques: in the plane full inertia over inertia, as a tank may be off the centre of mass; in space
    the same as `growth`. None: the craft has no propellant."""
    tank: tuple[Emptied, Emptied] | None = None
    """What a craft with a tank at a place lacks at the start and at the end; None: there is none."""
    momentum: tuple[Any, Any] | None = None
    """Angular momentum of wheels inside the craft in B, N m s, at the start, and its change until the end; vectors
    in space, scalars about z in the plane. None: no wheels."""


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
