"""Conditions: what an episode does not promise, as distributions that every engine draws from alike.

A `Range` is a number, or the two bounds of a uniform distribution. Everything is drawn anew for each episode;
the defaults are a perfect world, of which nothing is drawn, remembered or computed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace
from itertools import accumulate
from typing import Any, Literal, NamedTuple, get_args

from rans.display import Settings
from rans.errors import ConfigError, checked, fits, is_finite, one_of
from rans.model.fields import Field, where
from rans.model.spacecraft import Spacecraft
from rans.structure import Range, is_range

FaultKind = Literal["dead", "stuck-open", "stuck", "weak"]
"""Never open; always open; always open by a share; open by a share of what it is told."""
FaultChoice = Literal["any", "recoverable", "unrecoverable"]
"""Any thrusters, each in a way of its own; sets without which every push and turn stays possible (`rans
faults`), or sets without which not, each as likely as the next: their thrusters fail alike."""


class Varying(NamedTuple):
    """A range that is one of several, by episode."""

    low: Field
    high: Field
    bounds: tuple[float, float]
    """The least and the largest of them all."""


def bounds(values: Range | Varying) -> tuple[float, float]:
    """The least and the largest of a range."""
    if isinstance(values, Varying):
        return values.bounds
    return values if isinstance(values, tuple) else (values, values)


def largest(values: Range | Varying) -> float:
    """The largest of a range."""
    return bounds(values)[1]


@dataclass(frozen=True)
class BodyConditions(Settings):
    """What flies, beside what was designed."""

    mass: Range = 1.0
    """Factor on the mass."""
    inertia: Range = 1.0
    """Factor on all moments of inertia."""
    centre: Range = 0.0
    """How far the true centre of mass lies from the designed one, in any direction, m."""


@dataclass(frozen=True)
class ThrusterConditions(Settings):
    """What nozzles and valves do with a command."""

    thrust: Range = 1.0
    """Factor on the force of each thruster, drawn for each."""
    pressure: Range = 1.0
    """Factor on the force of all, by the pressure of their shared supply."""
    droop: Range | None = None
    """How much the supply gives way: with n valves open, each has 1 / (1 + droop (n - 1)) of its force. None:
    as the spacecraft says (0: an ample supply, 1: it feeds one thruster's worth)."""
    latency: Range = 0.0
    """From a command until valves begin to move, s."""
    command_delay: Range = 0.0
    """From a decision until the command arrives, s; adds to the latency."""
    rise: Range = 0.0
    """From then until full force, in which the force grows steadily, s."""
    fall: Range | None = None
    """The same when a valve shuts, s; None: as the rise, in the same episode."""
    least_on: Range = 0.0
    """Shortest time for which an on/off valve stays open, s."""
    least_off: Range = 0.0
    """Shortest time for which it stays shut, s."""


@dataclass(frozen=True)
class FaultConditions(Settings):
    """Thrusters that fail, each at most once."""

    count: Range = 0.0
    """How many fail, drawn as a whole number; up to two."""
    kinds: tuple[FaultKind, ...] = ("dead", "stuck-open")
    """How, each as likely as the next."""
    share: Range = (0.3, 1.0)
    """Of "stuck" and "weak" thrusters."""
    time: Range = 0.0
    """When, s from the start of the episode, to the instant: within a control period too."""
    among: FaultChoice = "any"
    """Which."""


@dataclass(frozen=True)
class DisturbanceConditions(Settings):
    """What else pushes and turns, in the world frame."""

    force: Range = 0.0
    """Steady force in any direction, N."""
    torque: Range = 0.0
    """Steady torque either way, or about any axis, N m."""
    slow_force: Range = 0.0
    """Amplitude of a force that swings to and fro, N."""
    slow_torque: Range = 0.0
    """The same of a torque, N m."""
    slow_period: Range = 25.0
    """Of both, s."""
    kicks: int = 0
    """How many sudden pushes come at random moments."""
    kick: Range = 0.0
    """Impulse of each, in any direction, N s."""
    kick_spin: Range = 0.0
    """Angular impulse of each, N m s."""


@dataclass(frozen=True)
class SensorConditions(Settings):
    """Of one measured quantity, in its unit: m, rad, m/s or rad/s."""

    noise: Range = 0.0
    """Standard deviation of each component, new in every control period."""
    bias: Range = 0.0
    """Size of a steady error in any direction."""
    dropout: Range = 0.0
    """Probability that a control period brings no new reading and the last one stands."""


@dataclass(frozen=True)
class SensorsConditions(Settings):
    """What the policy is told of the true state."""

    position: SensorConditions = field(default_factory=SensorConditions)
    attitude: SensorConditions = field(default_factory=SensorConditions)
    velocity: SensorConditions = field(default_factory=SensorConditions)
    spin: SensorConditions = field(default_factory=SensorConditions)
    delay: Range = 0.0
    """How old readings are, drawn as a whole number of control periods."""
    outage: Range = 0.0
    """For how long all sensors stop at a time, and their last readings stand, s; such as a motion capture
    that loses its markers."""
    outage_every: Range = 5.0
    """From the beginning of one outage to that of the next, s; the first begins at a random moment."""

    def each(self) -> tuple[SensorConditions, ...]:
        """In the order of a state's fields."""
        return self.position, self.attitude, self.velocity, self.spin


@dataclass(frozen=True)
class Conditions(Settings):
    """Distributions of everything that an episode does not promise.

    >>> rans.Conditions(rans.BodyConditions(mass=(0.7, 2.0)), rans.ThrusterConditions(latency=0.1)).delay
    0.1

    Raises:
        ConfigError: a range is not of finite numbers in order, or outside of what is possible.
    """

    body: BodyConditions = field(default_factory=BodyConditions)
    thrusters: ThrusterConditions = field(default_factory=ThrusterConditions)
    faults: FaultConditions = field(default_factory=FaultConditions)
    disturbances: DisturbanceConditions = field(default_factory=DisturbanceConditions)
    sensors: SensorsConditions = field(default_factory=SensorsConditions)
    description: str = ""
    """One line for lists."""
    weight: float = 1.0
    """How likely these are among others, relative to those."""
    others: tuple[Conditions, ...] = ()
    """That an episode may meet instead. They may differ in ranges only."""

    def __post_init__(self) -> None:
        _check(self, "")
        _require(
            fits(self.weight, lambda x: 0 < x < math.inf),
            "weight",
            self.weight,
            "a finite number > 0",
        )
        for other in self.others:
            checked("others", other, Conditions)
            _require(not other.others, "others", "others of others", "without others of their own")
            _check_alike(self, other, "")
        thrusters = self.thrusters
        pushes = self.disturbances
        for name, low in (("mass", self.body.mass), ("inertia", self.body.inertia)):
            _require(bounds(low)[0] > 0, f"body.{name}", low, "> 0")
        _require(largest(self.faults.count) <= 2, "faults.count", self.faults.count, "at most 2")
        _require(
            all(kind in get_args(FaultKind) for kind in self.faults.kinds) and self.faults.kinds,
            "faults.kinds",
            self.faults.kinds,
            f"among {', '.join(get_args(FaultKind))}",
        )
        _require(largest(self.faults.share) <= 1, "faults.share", self.faults.share, "at most 1")
        one_of("faults.among", self.faults.among, get_args(FaultChoice))
        _require(
            bounds(pushes.slow_period)[0] > 0,
            "disturbances.slow_period",
            pushes.slow_period,
            "> 0 s",
        )
        _require(
            0 <= pushes.kicks <= 8, "disturbances.kicks", pushes.kicks, "a whole number from 0 to 8"
        )
        _require(
            self.delay <= 30.0,
            "thrusters.latency and command_delay",
            self.delay,
            "together at most 30 s",
        )
        _require(
            largest(thrusters.least_on) <= 30 and largest(thrusters.least_off) <= 30,
            "thrusters.least_on and least_off",
            (thrusters.least_on, thrusters.least_off),
            "at most 30 s",
        )
        sensors = zip(
            ("position", "attitude", "velocity", "spin"), self.sensors.each(), strict=True
        )
        for name, sensor in sensors:
            _require(
                largest(sensor.dropout) < 1, f"sensors.{name}.dropout", sensor.dropout, "below 1"
            )
        every = self.sensors.outage_every
        _require(bounds(every)[0] > 0, "sensors.outage_every", every, "> 0 s")
        _require(
            largest(self.sensors.outage) < bounds(every)[0],
            "sensors.outage",
            self.sensors.outage,
            f"below the least of sensors.outage_every, {bounds(every)[0]:g} s",
        )

    def met(self, chance: Field) -> Conditions:
        """Those that an episode meets, which a number in [0, 1) decides: ranges that differ are `Varying`."""
        if not self.others:
            return self
        parts = (replace(self, others=()), *self.others)
        ends = list(accumulate(part.weight for part in parts))
        return _mixed(parts, [end / ends[-1] for end in ends[:-1]], chance)

    def check_valves(self, craft: Spacecraft) -> None:
        """Refuse what this spacecraft's valves cannot do.

        Raises:
            ConfigError: they must stay open or shut for a time, but are not on/off valves.
        """
        for name in ("least_on", "least_off"):
            asked = max(largest(getattr(part.thrusters, name)) for part in (self, *self.others))
            if asked > 0 and craft.actuators.is_continuous:
                raise ConfigError(
                    f"Conditions have thrusters.{name} up to {asked:g} s, which is for on/off "
                    f"valves; the thrusters of {craft.name!r} are {craft.actuators.kind}."
                )

    @property
    def or_none(self) -> Conditions | None:
        """None for a perfect world, in which nothing is drawn."""
        return None if replace(self, description="") == Conditions() else self

    @property
    def steady_torque(self) -> float:
        """The largest that stays for longer than a kick, N m."""
        every = (part.disturbances for part in (self, *self.others))
        return max(largest(part.torque) + largest(part.slow_torque) for part in every)

    @property
    def delay(self) -> float:
        """The longest time from a decision until a valve begins to move, s."""
        return largest(self.thrusters.latency) + largest(self.thrusters.command_delay)

    @property
    def lasting(self) -> float:
        """The longest time for which a command is still felt after the next one, s."""
        thrusters = self.thrusters
        return self.delay + max(largest(thrusters.rise), largest(thrusters.fall or 0.0))


def _check(conditions: Any, place: str) -> None:
    """Every range is of finite numbers >= 0, the least first."""
    for one in fields(conditions):
        value = getattr(conditions, one.name)
        name = place + one.name
        if str(one.type).endswith("Conditions"):
            _check(checked(name, value, globals()[str(one.type)]), name + ".")
        elif is_range(one) and value is not None:
            pair = bounds(value)
            numbers = len(pair) == 2 and all(map(is_finite, pair))
            _require(
                numbers and 0 <= pair[0] <= pair[1],
                name,
                value,
                "a number >= 0, or the least and the largest of two",
            )


def _check_alike(one: Any, other: Any, place: str) -> None:
    """What is no range is the same in both."""
    for known in fields(one):
        here = getattr(one, known.name)
        there = getattr(other, known.name)
        name = place + known.name
        if is_dataclass(here):
            _check_alike(here, there, name + ".")
        elif name not in ("description", "weight", "others"):
            free = is_range(known) and (here is None) == (there is None)
            _require(free or here == there, f"others: {name}", there, f"as in the first, {here!r}")


def _mixed(parts: Sequence[Any], ends: Sequence[float], chance: Field) -> Any:
    """The first part with its ranges those of the part in whose share of [0, 1) the chance lies."""
    changed: dict[str, Any] = {}
    for one in fields(parts[0]):
        values = [getattr(part, one.name) for part in parts]
        if is_dataclass(values[0]):
            changed[one.name] = _mixed(values, ends, chance)
        elif is_range(one) and any(value != values[0] for value in values):
            pairs = [bounds(value) for value in values]
            low, high = (piecewise(column, ends, chance) for column in zip(*pairs, strict=True))
            least = min(pair[0] for pair in pairs)
            most = max(pair[1] for pair in pairs)
            changed[one.name] = Varying(low, high, (least, most))
    return replace(parts[0], **changed)


def piecewise(values: Sequence[float], ends: Sequence[float], chance: Field) -> Field:
    """The value in whose share of [0, 1) the chance lies; all but the last share end somewhere."""
    zero = chance * 0.0
    last = values[0]
    result = zero + last
    for end, value in zip(ends, values[1:], strict=True):
        if value != last:
            result = where(chance >= end, zero + value, result)
        last = value
    return result


def _require(holds: Any, name: str, value: object, bound: str) -> None:
    if not holds:
        raise ConfigError(f"{name} must be {bound}, got {value!r}.")
