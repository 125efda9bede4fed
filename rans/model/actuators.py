"""Descriptions of actuators: command modes of thrusters, reaction wheels, and propellant."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal

from rans.base.errors import ConfigError, brief, is_finite
from rans.model.fields import Field, ascending, at_least, floor, where

Command = Sequence[Field]
"""One field per thruster."""

STANDARD_GRAVITY = 9.80665
"""Standard acceleration of free fall, m/s^2: effective exhaust speed per second of specific impulse."""


@dataclass(frozen=True)
class Actuators:
    """Command mode of a craft's thrusters: `OnOff`, `Pulsed` or `Throttle`."""

    kind: ClassVar[str]
    """Name of the mode in spacecraft files."""
    is_continuous: ClassVar[bool] = True
    """Whether commands between 0 and 1 are valid."""
    dtype: ClassVar[Literal["int8", "float32"]] = "float32"
    """Number type in which commands are stored."""
    allowed: ClassVar[str]
    """Range of a command's entries, in words."""

    @property
    def low(self) -> float:
        """Least command of a thruster."""
        return 0.0

    @property
    def high(self) -> float:
        """Largest command of a thruster: the largest share of its full force."""
        return 1.0

    @property
    def shortest(self) -> float:
        """Shortest time for which a thruster is open, over the control period; 0 of throttled thrusters."""
        return float(not self.is_continuous)

    def levels(self, command: Command) -> Command:
        """Shares of full force under commands that are held: the commands themselves."""
        return command

    def opened(self, command: Command) -> Command:
        """Mean of each thruster in a control period: of a valve the share of time, of a throttle that of force."""
        return self.levels(command)

    def pulses(self, command: Command) -> Iterator[tuple[Field, Command]]:
        """Pieces of a control period, each with its share of the period and the thrusters' shares of full force."""
        yield 1.0, command

    def steady(self) -> Actuators:
        """Actuators that hold the mean force of each command for the control period: themselves, or a throttle."""
        return self


@dataclass(frozen=True)
class OnOff(Actuators):
    """On/off valves, which stay open or shut for a whole control period.

    >>> rans.load_spacecraft("floating-platform").actuators
    OnOff()
    """

    kind: ClassVar[str] = "on-off"
    is_continuous: ClassVar[bool] = False
    dtype: ClassVar[Literal["int8", "float32"]] = "int8"
    allowed: ClassVar[str] = "0 (shut) or 1 (open)"


@dataclass(frozen=True)
class Throttle(Actuators):
    """Throttled thrusters: they hold any share of their full force between two levels.

    >>> from rans.model.actuators import Throttle
    >>> dataclasses.replace(rans.load_spacecraft("floating-platform"), actuators=Throttle()).actuators
    Throttle(least=0.0, most=1.0, always_lit=False)

    A command is the share of full force. Engines that are always lit take commands from ``least`` to ``most``.
    Others take commands from 0 to ``most``: a command below half of ``least`` shuts the thruster, any other
    command gives at least ``least``.

    Raises:
        ConfigError: the levels are not numbers with 0 <= least <= most <= 1 and most > 0, or always_lit is
            not a boolean.
    """

    least: float = 0.0
    """Least share of full force of a lit thruster."""
    most: float = 1.0
    """Largest share of full force."""
    always_lit: bool = False
    """Whether thrusters cannot be shut."""
    kind: ClassVar[str] = "throttle"

    def __post_init__(self) -> None:
        for key in ("least", "most"):
            value = getattr(self, key)
            if not is_finite(value) or not 0.0 <= value <= 1.0:
                raise ConfigError(
                    f"{key} of throttle actuators must be a number from 0 to 1, a share of the full force, "
                    f"got {brief(value)}."
                )
        if self.least > self.most or self.most == 0.0:
            raise ConfigError(
                f"least of throttle actuators ({self.least:g}) must not exceed most ({self.most:g}), and most "
                "must be above 0."
            )
        if not isinstance(self.always_lit, bool):
            raise ConfigError(
                f"always_lit of throttle actuators must be true or false, got {brief(self.always_lit)}."
            )

    @property
    def low(self) -> float:
        """Least command of a thruster."""
        return float(self.least) if self.always_lit else 0.0

    @property
    def high(self) -> float:
        """Largest command of a thruster."""
        return float(self.most)

    @property
    def allowed(self) -> str:  # type: ignore[override]
        """Range of a command's entries, in words."""
        if self.always_lit:
            return f"{self.least:g} (least thrust) to {self.most:g} (most thrust)"
        label = "full thrust" if self.most == 1.0 else "most thrust"
        return f"0 (no thrust) to {self.most:g} ({label})"

    def levels(self, command: Command) -> Command:
        """Shares of full force under commands that are held: 0, or at least the least level."""
        if self.always_lit or self.least == 0.0:
            return command
        return [
            where(opening < 0.5 * self.least, opening * 0.0, at_least(opening, self.least))
            for opening in command
        ]


@dataclass(frozen=True)
class Pulsed(Actuators):
    """Pulse-width modulated valves: each opens at the start of a control period for a whole number of counts.

    >>> from rans.model.actuators import Pulsed
    >>> Pulsed(counts=10, least=2)  # with a period of 0.1 s: steps of 10 ms, pulses of 20 ms or more
    Pulsed(counts=10, least=2)

    A duty cycle d opens a thruster at full force for the first round(d * counts) counts, with halves rounded up.
    A pulse shorter than ``least`` is not given.

    Raises:
        ConfigError: ``counts`` is not a whole number >= 1, or ``least`` is not one from 0 to ``counts``.
    """

    counts: int
    """Number of counts in a control period."""
    least: int = 0
    """Shortest pulse of a valve, counts."""
    kind: ClassVar[str] = "pulsed"
    allowed: ClassVar[str] = "0 (shut) to 1 (open all the time)"

    def __post_init__(self) -> None:
        for key, low, high in (("counts", 1, 2**20), ("least", 0, self.counts)):
            value = getattr(self, key)
            if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
                raise ConfigError(
                    f"{key} of pulsed actuators must be a whole number from {low} to {high:,}, "
                    f"got {value!r}."
                )

    @property
    def shortest(self) -> float:
        """Shortest pulse of a valve over the control period."""
        return max(1, self.least) / self.counts

    def opened(self, command: Command) -> Command:
        """Share of a control period for which each thruster is open."""
        return [self._width(duty) * (1.0 / self.counts) for duty in command]

    def pulses(self, command: Command) -> Iterator[tuple[Field, Command]]:
        """Pieces that end at every count, or at the closing times if fewer; see `Actuators.pulses`.

        Widths are fields, so that they are sorted without a branch.
        """
        widths = [self._width(duty) for duty in command]
        begun = past = 0.0
        regular = self.counts <= len(widths) + 1
        ends = [float(k) for k in range(1, self.counts)] if regular else ascending(widths)
        for end in (*ends, float(self.counts)):
            zero = [width * 0.0 for width in widths]
            open_ = [
                where(width > past, none + 1.0, none)
                for width, none in zip(widths, zero, strict=True)
            ]
            yield (end - begun) * (1.0 / self.counts), open_
            # Valves that are open to the end do not shut, even if the last piece has zero length.
            begun = end
            past = end if regular else -at_least(-end, 0.5 - self.counts)

    def steady(self) -> Throttle:
        """Throttle with the same mean forces, without rounding to counts and without the least pulse."""
        return Throttle()

    def _width(self, duty: Field) -> Field:
        """Counts for which a thruster is open under a duty cycle from 0 to 1."""
        whole = floor(duty * float(self.counts) + 0.5)
        return where(whole < self.least, whole * 0.0, whole) if self.least > 1 else whole


ON_OFF = OnOff()

WHOLE_PERIODS = (
    "they are open or shut for whole control periods, the shortest opening is `least_on` in [thrusters] of "
    "conditions, and shorter pulses are those of the kind pulsed"
)
"""Why on/off valves take no length of a pulse, and where to give it, as the end of a sentence."""

KINDS: dict[str, type[Actuators]] = {kind.kind: kind for kind in (OnOff, Pulsed, Throttle)}


@dataclass(frozen=True)
class Wheel:
    """Reaction wheel: a rotor whose motor turns the craft in the opposite direction.

    >>> from rans.model.actuators import Wheel
    >>> Wheel(axis=(0.0, 0.0, 1.0), max_torque=0.007, max_momentum=0.0236, inertia=4.1e-5).max_torque
    0.007

    A command from -1 to 1 is the motor's torque on the wheel as a share of ``max_torque``; the craft is turned
    by the opposite torque. The motor gives less where the momentum would leave its limit by the end of the
    control period, so that a wheel at its limit only slows down.

    The momentum of a wheel is its absolute angular momentum about its axis, inertia (w . axis + wheel speed);
    only the motor changes it. The inertia of the craft excludes the axial inertia of its wheels and includes
    their mass and transverse inertia.
    """

    axis: tuple[float, float, float]
    """Unit vector of the spin axis, in G; in the plane (0, 0, 1) or (0, 0, -1)."""
    max_torque: float
    """Largest torque of the motor, N m."""
    max_momentum: float
    """Largest absolute angular momentum about the axis, N m s."""
    inertia: float
    """Moment of inertia about the axis, kg m^2."""


@dataclass(frozen=True)
class Propellant:
    """Propellant of the thrusters: mass in a full tank and specific impulse.

    >>> from rans.model.actuators import Propellant
    >>> round(Propellant(mass=400.0, specific_impulse=225.0).exhaust_speed, 3)
    2206.496

    Thrusters with the forces F_i use sum(F_i) / exhaust_speed kilograms per second. Mass, inertia and centre of
    mass of the craft are those with a full tank. Thrust ends when the tank is empty.
    """

    mass: float
    """Propellant in a full tank, kg: a part of the craft's mass."""
    specific_impulse: float
    """Specific impulse of all thrusters, s."""
    position: tuple[float, float, float] | None = None
    """Centre of the tank in G, m: centre of mass and inertia follow as it empties. None: the propellant is spread
    as the craft's mass is, so that inertia decreases in proportion about a centre that does not move."""
    radius: float = 0.0
    """Radius of a spherical tank there, m, which the propellant fills evenly, as gas does; 0: a point."""

    @property
    def exhaust_speed(self) -> float:
        """Effective exhaust speed, m/s."""
        return self.specific_impulse * STANDARD_GRAVITY

    def excess(
        self,
        mass: Field,
        inertia: Sequence[Field],
        arm: Sequence[Field],
        growth: Field,
        lever: Field,
    ) -> tuple[Field, ...]:
        """What full mass over mass times the inertia exceeds the full inertia by, kg m^2, with a tank at a place.

        Args:
            mass: with a full tank, kg.
            inertia: with a full tank, about its centre of mass: one moment in the plane, six entries in space.
            arm: from this centre to the tank, m: two entries or three.
            growth: full mass over mass.
            lever: growth (growth - 1), or a line that stands for it.
        """
        x, y, z = (*arm, 0.0)[:3]
        away: tuple[Field, ...] = (x * x + y * y,)
        if len(arm) == 3:
            away = (y * y + z * z, -(x * y), -(x * z), x * x + z * z, -(y * z), x * x + y * y)
        own = 0.4 * self.radius**2
        balls = (own,) if len(arm) == 2 else (own, 0.0, 0.0, own, 0.0, own)
        return tuple(
            (growth - 1.0) * (moment - ball * mass) - lever * (square * mass)
            for moment, ball, square in zip(inertia, balls, away, strict=True)
        )
