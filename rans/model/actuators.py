"""Descriptions of what pushes a craft: how thrusters take commands, reaction wheels, and propellant."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal

from rans.errors import ConfigError, brief
from rans.model.fields import Field, ascending, at_least, floor, where

Command = Sequence[Field]
"""One field per thruster."""

STANDARD_GRAVITY = 9.80665
"""Standard acceleration of free fall, m/s^2: effective exhaust speed per second of specific impulse."""


@dataclass(frozen=True)
class Actuators:
    """How thrusters take commands. The craft says which kind they are."""

    kind: ClassVar[str]
    """Its name in spacecraft files."""
    is_continuous: ClassVar[bool] = True
    """Whether commands between 0 and 1 mean something."""
    dtype: ClassVar[Literal["int8", "float32"]] = "float32"
    """In which a command is remembered."""
    has_gradient: ClassVar[bool] = False
    """Whether the force, where it is not at a limit, changes steadily with the command."""
    allowed: ClassVar[str]
    """What a command's entries may be, in words."""

    @property
    def low(self) -> float:
        """Least command of a thruster."""
        return 0.0

    @property
    def high(self) -> float:
        """Largest command of a thruster: the share of its full force that it can give."""
        return 1.0

    def levels(self, command: Command) -> Command:
        """Shares of full force that thrusters give of commands that are held: the commands themselves."""
        return command

    def pulses(self, command: Command) -> Iterator[tuple[Field, Command]]:
        """Pieces of a control period: their share of it, and that of its force which each thruster gives."""
        yield 1.0, command

    def steady(self) -> Actuators:
        """Actuators that hold each command's mean force for a whole control period: themselves, or a throttle."""
        return self


@dataclass(frozen=True)
class OnOff(Actuators):
    """Valves that stay open or shut for a whole control period.

    >>> rans.load_spacecraft("floating-platform").actuators
    OnOff()
    """

    kind: ClassVar[str] = "on-off"
    is_continuous: ClassVar[bool] = False
    dtype: ClassVar[Literal["int8", "float32"]] = "int8"
    allowed: ClassVar[str] = "0 (shut) or 1 (open)"


@dataclass(frozen=True)
class Throttle(Actuators):
    """Thrusters that give any share of their full force between two levels, steadily.

    >>> dataclasses.replace(rans.load_spacecraft("floating-platform"), actuators=rans.Throttle()).actuators
    Throttle(least=0.0, most=1.0, always_lit=False)

    A command is the share of full force. Engines that are always lit take least to most. Others may be shut:
    they take 0 to most, are shut by a command below half of their least level, and give at least that level
    otherwise.

    Raises:
        ConfigError: the levels are not numbers with 0 <= least <= most <= 1 and most > 0, or always_lit is
            no truth value.
    """

    least: float = 0.0
    """Least share of full force of a thruster that is lit."""
    most: float = 1.0
    """Largest share of full force."""
    always_lit: bool = False
    """Whether thrusters cannot be shut."""
    kind: ClassVar[str] = "throttle"
    has_gradient: ClassVar[bool] = True

    def __post_init__(self) -> None:
        for key in ("least", "most"):
            value = getattr(self, key)
            is_number = isinstance(value, int | float) and not isinstance(value, bool)
            if not is_number or not 0.0 <= value <= 1.0:
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
        """What a command's entries may be, in words."""
        if self.always_lit:
            return f"{self.least:g} (least thrust) to {self.most:g} (most thrust)"
        most = "full thrust" if self.most == 1.0 else "most thrust"
        return f"0 (no thrust) to {self.most:g} ({most})"

    def levels(self, command: Command) -> Command:
        """Shares of full force that thrusters give of commands that are held: 0, or the least level and more."""
        if self.always_lit or self.least == 0.0:
            return command
        return [
            where(share < 0.5 * self.least, share * 0.0, at_least(share, self.least))
            for share in command
        ]


@dataclass(frozen=True)
class Pulsed(Actuators):
    """Valves that open once a control period, at its beginning, for whole counts of it.

    >>> rans.Pulsed(counts=10, least=2)  # of a period of 0.1 s: in steps of 10 ms, for 20 ms at least
    Pulsed(counts=10, least=2)

    A duty of d opens a thruster at full force for the first round(d * counts) counts, halves rounded up, and
    not at all for fewer than ``least``.

    Raises:
        ConfigError: ``counts`` is not a whole number >= 1 or ``least`` none from 0 to ``counts``.
    """

    counts: int
    """In which a control period is divided."""
    least: int = 0
    """Shortest pulse a valve can give, counts."""
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

    def pulses(self, command: Command) -> Iterator[tuple[Field, Command]]:
        """See `Actuators.pulses`: pieces end where a valve may shut, or in order where each one does."""
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
            # Those open to the end do not shut, not even in a last piece of no length.
            begun = end
            past = end if regular else -at_least(-end, 0.5 - self.counts)

    def steady(self) -> Throttle:
        """A throttle, which gives every duty itself: whole counts and the least pulse are left out."""
        return Throttle()

    def _width(self, duty: Field) -> Field:
        """Counts for which a thruster is open."""
        whole = floor(duty * float(self.counts) + 0.5)
        return where(whole < self.least, whole * 0.0, whole) if self.least > 1 else whole


ON_OFF = OnOff()

KINDS: dict[str, type[Actuators]] = {kind.kind: kind for kind in (OnOff, Pulsed, Throttle)}


@dataclass(frozen=True)
class Wheel:
    """Reaction wheel: a rotor whose motor turns the craft the other way.

    >>> rans.Wheel(axis=(0.0, 0.0, 1.0), max_torque=0.007, max_momentum=0.0236, inertia=4.1e-5).max_torque
    0.007

    A command from -1 to 1 is the motor's torque on the wheel as a share of ``max_torque``; the craft is turned
    by the opposite torque. The motor gives less where the momentum would leave its limit by the end of the
    control period, so that a wheel at its limit only slows down.

    A wheel's momentum is its absolute one about its axis, inertia (w . axis + wheel speed): only the motor
    changes it. The craft's inertia is without the axial inertia of its wheels, and with all the rest of them.
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
    """What thrusters use up.

    >>> round(rans.Propellant(mass=400.0, specific_impulse=225.0).exhaust_speed, 3)
    2206.496

    Thrusters that give the forces F_i use sum(F_i) / exhaust_speed kilograms a second. The craft's mass and
    inertia are those with a full tank; both fall in the same proportion, and the centre of mass stays where it
    is. Thrust ends when the tank is empty.
    """

    mass: float
    """In a full tank, kg: a part of the craft's mass."""
    specific_impulse: float
    """Specific impulse of all thrusters, s."""

    @property
    def exhaust_speed(self) -> float:
        """Effective exhaust speed, m/s."""
        return self.specific_impulse * STANDARD_GRAVITY
