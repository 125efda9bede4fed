"""Conditions: distributions of domain randomization, faults, disturbances and sensor errors.

A `Range` is a number, or the two bounds of a uniform distribution. Every episode draws new values, the same in
every engine. The defaults are nominal: nothing is drawn, stored or computed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace
from itertools import accumulate, product
from operator import attrgetter
from typing import Any, ClassVar, Literal, NamedTuple, get_args

import numpy as np

from rans.base.display import Settings
from rans.base.errors import ConfigError, NamedArguments, checked, is_finite, one_of
from rans.base.structure import Range, is_range
from rans.model.body import Body, check_stores
from rans.model.fields import Field, where
from rans.model.spacecraft import Spacecraft

FaultKind = Literal["dead", "stuck-open", "stuck", "weak"]
"""Kinds of thruster faults: never open; always open; always open by a share; opens by a share of its command."""
FaultChoice = Literal["any", "recoverable", "unrecoverable"]
"""Which thrusters may fail. "any": any thrusters, each with a fault kind of its own. "recoverable" and
"unrecoverable": sets after whose failure every force and torque is, or is not, still possible (`rans faults`);
all sets are equally likely, and the thrusters of a set have the same fault kind."""


MOST_FAULTS = 8
"""Thrusters that may fail in an episode: more takes long kernels, and leaves few craft with anything to control."""


MOST_DELAY = 1_000
"""Control periods by which readings may be late: the states of all of them are remembered."""
_LARGEST = 1e9
"""Bound of every number in SI units, beyond which single precision has no sums of squares."""


class Varying(NamedTuple):
    """Range that differs between episodes, as one of several."""

    low: Field
    high: Field
    bounds: tuple[float, float]
    """Least lower bound and largest upper bound of all of them."""


def bounds(values: Range | Varying) -> tuple[float, float]:
    """Lower and upper bound of a range."""
    if isinstance(values, Varying):
        return values.bounds
    return values if isinstance(values, tuple) else (values, values)


def largest(values: Range | Varying) -> float:
    """Upper bound of a range."""
    return bounds(values)[1]


@dataclass(frozen=True)
class BodyConditions(Settings):
    """Randomization of the mass properties."""

    mass: Range = 1.0
    """Factor on the mass."""
    inertia: Range = 1.0
    """Factor on all moments of inertia."""
    centre: Range = 0.0
    """Distance between the true centre of mass and the designed one, in a random direction, m."""


@dataclass(frozen=True)
class ThrusterConditions(Settings):
    """Randomization of thrust, delays and dwell times of the thrusters."""

    thrust: Range = 1.0
    """Factor on the force of each thruster, drawn for each."""
    pressure: Range = 1.0
    """Factor on the force of all thrusters, from the pressure of their shared supply."""
    droop: Range | None = None
    """Droop of a supply: with n of its valves open, each gives 1 / (1 + droop (n - 1)) of its force. None: that
    of the spacecraft (0: an ample supply; 1: a supply for one thruster)."""
    latency: Range = 0.0
    """Time from a command until valves begin to move, s."""
    command_delay: Range = 0.0
    """Time from a decision until the command arrives, s; adds to the latency."""
    rise: Range = 0.0
    """Time of a linear rise of the force after an opening valve begins to move, s; a closing one takes as long."""
    least_on: Range = 0.0
    """Shortest time for which an on/off valve stays open, s."""
    noise: Range = 0.0
    """Standard deviation of the force of each thruster over that force, drawn anew in every control period. No
    force is negative, which raises the mean force from 0.4 on, by 8 % at 1."""
    misalignment: Range = 0.0
    """Angle between the true and the designed direction of each thruster, to a random side, rad."""


@dataclass(frozen=True)
class FaultConditions(Settings):
    """Fault injection: thrusters that fail, each at most once."""

    count: Range = 0.0
    """Number of thrusters that fail, drawn as a whole number; at most two, or eight among "any"."""
    kinds: tuple[FaultKind, ...] = ("dead", "stuck-open")
    """Fault kinds, all equally likely."""
    share: Range = (0.3, 1.0)
    """Share of full force of "stuck" thrusters, and share of the command of "weak" ones."""
    time: Range = 0.0
    """Time of the fault from the start of the episode, s; it may lie within a control period."""
    among: FaultChoice = "any"
    """Which thrusters may fail."""
    thrusters: tuple[int, ...] = ()
    """Numbers of the thrusters that fail in every episode, in the spacecraft's order from 0, each with a fault kind
    of its own. ``count`` and ``among`` are then left out. Empty: thrusters are drawn."""


@dataclass(frozen=True)
class DisturbanceConditions(Settings):
    """Disturbance forces and torques in the world frame."""

    force: Range = 0.0
    """Constant force in a random direction, N."""
    torque: Range = 0.0
    """Constant torque about z with a random sign (in space: about a random axis), N m."""
    slow_force: Range = 0.0
    """Amplitude of a sinusoidal force in a random direction, N."""
    kick: Range = 0.0
    """Impulsive disturbance at a random instant, in a random direction, N s."""

    slow_period: ClassVar[tuple[float, float]] = (5.0, 25.0)
    """Range of the period of the sinusoidal force, s: the paper's episode has one to five of them."""


@dataclass(frozen=True)
class SensorConditions(Settings):
    """Errors of one measured quantity, in its unit: m, rad, m/s or rad/s."""

    noise: Range = 0.0
    """Standard deviation of the noise of each component, drawn anew in every control period."""
    bias: Range = 0.0
    """Magnitude of a constant error in a random direction."""
    dropout: Range = 0.0
    """Probability that a control period has no new reading and the last one is kept."""


@dataclass(frozen=True)
class SensorsConditions(Settings):
    """Errors, delay and outages of the measured state that a policy observes."""

    position: SensorConditions = field(default_factory=SensorConditions)
    attitude: SensorConditions = field(default_factory=SensorConditions)
    velocity: SensorConditions = field(default_factory=SensorConditions)
    spin: SensorConditions = field(default_factory=SensorConditions)
    delay: Range = 0.0
    """Age of the readings, drawn as a whole number of control periods."""
    outage: Range = 0.0
    """Duration of an outage of all sensors, s, in which the last readings are kept, such as a motion capture that
    loses its markers. The first starts at a random instant, and one every 5 s from then on."""

    outage_every: ClassVar[float] = 5.0
    """Time from the start of one outage to that of the next, s: a fifth of the paper's episodes, so that each
    has some."""

    def each(self) -> tuple[SensorConditions, ...]:
        """Conditions of position, attitude, velocity and spin, in this order."""
        return self.position, self.attitude, self.velocity, self.spin


@dataclass(frozen=True)
class Conditions(NamedArguments, Settings):
    """Distributions of domain randomization, faults, disturbances and sensor errors of an episode.

    >>> rans.Conditions(rans.BodyConditions(mass=(0.7, 2.0)), rans.ThrusterConditions(latency=0.1)).delay
    0.1

    Raises:
        ConfigError: a range is not of finite numbers in ascending order, or outside its bounds.
    """

    body: BodyConditions = field(default_factory=BodyConditions)
    thrusters: ThrusterConditions = field(default_factory=ThrusterConditions)
    faults: FaultConditions = field(default_factory=FaultConditions)
    disturbances: DisturbanceConditions = field(default_factory=DisturbanceConditions)
    sensors: SensorsConditions = field(default_factory=SensorsConditions)
    description: str = ""
    """Description in one line, for lists."""
    weight: float = 1.0
    """Relative probability of these conditions among ``others``."""
    others: tuple[Conditions, ...] = ()
    """Alternative conditions of a mixture: each episode has one of them. They may differ in ranges only."""

    def __post_init__(self) -> None:
        _check(self, "")
        for component in self.others:
            checked("others", component, Conditions)
            _require(
                not component.others, "others", "others of others", "without others of their own"
            )
            _check_alike(self, component, "")
        # Bounds other than "finite and not negative": of single settings, then of several together.
        for names, holds, bound in _BOUNDS:
            for name in names.split():
                value = attrgetter(name)(self)
                _require(holds(value), name, value, bound)
        name = "thrusters.latency and command_delay"
        _require(
            self.delay <= 30.0, name, self.delay, "together at most 30 s, as a time in ms is not"
        )
        _check_faults(self.faults)

    def met(self, chance: Field) -> Conditions:
        """Conditions of an episode, selected from the mixture by a number in [0, 1).

        Ranges that differ within the mixture become `Varying`.
        """
        if not self.others:
            return self
        parts = (replace(self, others=()), *self.others)
        ends = list(accumulate(part.weight for part in parts))
        return _mixed(parts, [end / ends[-1] for end in ends[:-1]], chance)

    def check_craft(self, craft: Spacecraft) -> None:
        """Reject conditions that do not apply to a spacecraft.

        Raises:
            ConfigError: there are shortest times open, but the thrusters are not on/off, more thrusters fail
                than there are, there is no thruster of a number that is to fail, no mass is left beside its
                propellant, or its further effectors refuse them.
        """
        self._check_propellant(craft)
        self._check_effectors(craft)
        count = craft.thruster_count
        failing = max(bounds(part.faults.count)[0] for part in (self, *self.others))
        named = self.faults.thrusters
        if failing > count or (named and not count):
            raise ConfigError(
                f"Conditions have faults of {max(failing, len(named)):g} thrusters in every episode, and "
                f"{craft.name!r} has {count or 'none'}."
            )
        if any(k >= count for k in named):
            raise ConfigError(
                f"Conditions have faults of thrusters {[*named]}; those of {craft.name!r} have the numbers 0 to "
                f"{count - 1}."
            )
        longest = max(largest(part.thrusters.least_on) for part in (self, *self.others))
        if longest > 0 and craft.actuators.is_continuous:
            raise ConfigError(
                f"Conditions have thrusters.least_on up to {longest:g} s, which is for on/off "
                f"valves; the thrusters of {craft.name!r} are {craft.actuators.kind}."
            )

    def _check_propellant(self, craft: Spacecraft) -> None:
        """Reject bodies that are nothing, or no rigid body, without the propellant of a full tank."""
        tank = craft.propellant
        if tank is None:
            return
        full = Body.of(craft)
        # The centre of mass as far as can be, away from the tank and in directions all around: a body that is thin
        # about an axis through the tank loses most where the centre moves across that axis.
        around = np.array(list(product((-1.0, 0.0, 1.0), repeat=craft.dimension)))
        if tank.position is not None:
            arm = np.subtract(craft.centre_of_mass, tank.position)[: craft.dimension]
            around = np.vstack([around, arm])
        lengths = np.linalg.norm(around, axis=1, keepdims=True)
        directions = around / np.maximum(lengths, 1e-12)
        for part in (self, *self.others):
            mass, inertia = (bounds(x)[0] for x in (part.body.mass, part.body.inertia))
            body = replace(
                full,
                mass=mass * craft.mass,
                inertia=tuple(inertia * x for x in full.inertia),
                centre=tuple(largest(part.body.centre) * directions.T),
            )
            try:
                check_stores(craft, body)
            except ConfigError as error:
                raise ConfigError(f"Conditions of body: {error} Or narrow their ranges.") from None

    def _check_effectors(self, craft: Spacecraft) -> None:
        """Reject conditions that a further effector refuses."""
        for effector in craft.further_effectors:
            effector.check_conditions(craft, self)

    @property
    def or_none(self) -> Conditions | None:
        """The conditions; None if they are nominal, so that nothing is drawn."""
        return None if replace(self, description="") == Conditions() else self

    @property
    def dead(self) -> tuple[int, ...]:
        """Numbers of the thrusters that are dead from the start in every episode."""
        faults = self.faults
        is_planned = faults.kinds == ("dead",) and all(
            largest(part.faults.time) == 0.0 for part in (self, *self.others)
        )
        return faults.thrusters if is_planned else ()

    @property
    def has_faults(self) -> bool:
        """Whether thrusters may fail in an episode."""
        return any(
            part.faults.thrusters or largest(part.faults.count) > 0.0
            for part in (self, *self.others)
        )

    @property
    def only_dead(self) -> bool:
        """Whether everything is nominal but thrusters that are `dead` in every episode."""
        if self.others or not self.dead:
            return False
        return replace(self, description="", faults=FaultConditions()) == Conditions()

    @property
    def steady_torque(self) -> float:
        """Largest constant disturbance torque, N m."""
        return max(largest(part.disturbances.torque) for part in (self, *self.others))

    @property
    def delay(self) -> float:
        """Longest time from a decision until a valve begins to move, s."""
        return largest(self.thrusters.latency) + largest(self.thrusters.command_delay)

    @property
    def lasting(self) -> float:
        """Longest time for which a command still affects the thrust after the next one, s."""
        return self.delay + largest(self.thrusters.rise)


def _check(conditions: Any, section: str) -> None:
    """Reject ranges that are not finite numbers >= 0 in ascending order."""
    for range_field in fields(conditions):
        value = getattr(conditions, range_field.name)
        name = section + range_field.name
        if str(range_field.type).endswith("Conditions"):
            _check(checked(name, value, globals()[str(range_field.type)]), name + ".")
        elif is_range(range_field) and value is not None:
            pair = bounds(value)
            numbers = len(pair) == 2 and all(map(is_finite, pair))
            _require(
                numbers and 0 <= pair[0] <= pair[1] <= _LARGEST,
                name,
                value,
                f"a number >= 0 and <= {_LARGEST:g}, or the least and the largest of two",
            )


def _check_alike(first: Any, second: Any, section: str) -> None:
    """Reject conditions of a mixture that differ in anything but ranges."""
    for range_field in fields(first):
        value = getattr(first, range_field.name)
        other_value = getattr(second, range_field.name)
        name = section + range_field.name
        if is_dataclass(value):
            _check_alike(value, other_value, name + ".")
        elif name not in ("description", "weight", "others"):
            free = is_range(range_field) and (value is None) == (other_value is None)
            _require(
                free or value == other_value,
                f"others: {name}",
                other_value,
                f"as in the first, {value!r}",
            )


def _mixed(parts: Sequence[Any], ends: Sequence[float], chance: Field) -> Any:
    """The first part with the ranges of the part to whose share of [0, 1) the field ``chance`` belongs.

    Ranges that are alike in all parts stay as they are, without an operation.
    """
    changed: dict[str, Any] = {}
    for range_field in fields(parts[0]):
        values = [getattr(part, range_field.name) for part in parts]
        if is_dataclass(values[0]):
            changed[range_field.name] = _mixed(values, ends, chance)
        elif is_range(range_field) and any(value != values[0] for value in values):
            pairs = [bounds(value) for value in values]
            low, high = (piecewise(column, ends, chance) for column in zip(*pairs, strict=True))
            least = min(pair[0] for pair in pairs)
            highest = max(pair[1] for pair in pairs)
            changed[range_field.name] = Varying(low, high, (least, highest))
    return replace(parts[0], **changed)


def piecewise(values: Sequence[float], ends: Sequence[float], chance: Field) -> Field:
    """Value (field) to whose share of [0, 1) ``chance`` belongs; ``ends`` are those of all shares but the last."""
    zero = chance * 0.0
    last = values[0]
    result = zero + last
    for end, value in zip(ends, values[1:], strict=True):
        if value != last:
            result = where(chance >= end, zero + value, result)
        last = value
    return result


_BOUNDS: tuple[tuple[str, Callable[[Any], Any], str], ...] = (
    ("weight", lambda x: is_finite(x) and x > 0, "a finite number > 0"),
    ("body.mass body.inertia", lambda x: bounds(x)[0] >= 1e-9, ">= 1e-9"),
    (
        "thrusters.thrust thrusters.pressure",
        lambda x: largest(x) > 0,
        "above 0 at its upper bound, a factor",
    ),
    ("thrusters.least_on", lambda x: largest(x) <= 30, "at most 30 s"),
    ("thrusters.noise", lambda x: largest(x) <= 1, "at most 1, all of the force"),
    ("thrusters.misalignment", lambda x: largest(x) <= math.pi / 2, "at most pi / 2 rad"),
    (
        "faults.kinds",
        lambda kinds: kinds and all(kind in get_args(FaultKind) for kind in kinds),
        f"among {', '.join(get_args(FaultKind))}",
    ),
    (
        "faults.thrusters",
        lambda named: (
            isinstance(named, tuple)
            and all(type(k) is int and k >= 0 for k in named)
            and len({*named}) == len(named) <= MOST_FAULTS
        ),
        f"at most {MOST_FAULTS} different numbers of thrusters, from 0",
    ),
    ("faults.share", lambda x: largest(x) <= 1, "at most 1"),
    (
        "sensors.delay",
        lambda x: largest(x) <= MOST_DELAY,
        f"at most {MOST_DELAY:,} control periods, which are all remembered",
    ),
    (
        "sensors.position.dropout sensors.attitude.dropout sensors.velocity.dropout sensors.spin.dropout",
        lambda x: largest(x) < 1,
        "below 1",
    ),
    (
        "sensors.outage",
        lambda x: largest(x) < SensorsConditions.outage_every,
        f"below {SensorsConditions.outage_every:g} s, after which the next begins",
    ),
)
"""Names of settings, with the bound that each must keep."""


def _check_faults(faults: FaultConditions) -> None:
    """Reject (`ConfigError`) more faults than are possible, and named thrusters beside drawn ones."""
    one_of("faults.among", faults.among, get_args(FaultChoice))
    limit = MOST_FAULTS if faults.among == "any" else 2
    bound = f'at most {limit} with faults.among = "{faults.among}"'
    _require(largest(faults.count) <= limit, "faults.count", faults.count, bound)
    _require(
        not faults.thrusters or (faults.count == 0.0 and faults.among == "any"),
        "faults.count and faults.among",
        (faults.count, faults.among),
        "left out where faults.thrusters are named",
    )


def _require(holds: Any, name: str, value: object, bound: str) -> None:
    if not holds:
        raise ConfigError(f"{name} must be {bound}, got {value!r}.")
