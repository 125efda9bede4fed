"""Description of a spacecraft: mass properties and the geometry of its effectors.

A spacecraft is described in a body-fixed frame G with an origin of the author's choice. The body frame B of the
equations has the same axes and its origin at the centre of mass. Derived quantities such as wrenches are computed
from the description. Every trained network has the order of its commands; a new field needs a default, since files
of agents lack it.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, NamedTuple

import numpy as np

from rans.base.display import NotebookRepr
from rans.base.errors import ConfigError, RansWarning, brief, checked, counted, one_line
from rans.model.actuators import ON_OFF, Actuators, Propellant, Wheel

ThrustSharing = Literal["none", "split"]
Shape = Literal["sphere", "cylinder"]
Pair = tuple[float, float]
PlanarThruster = tuple[Pair, Pair, float]
"""Position and direction of the force in G, and force, N."""

_SMALLEST = 1e-9
_LARGEST = 1e9
"""Range of a mass, force, radius or principal moment, and bound of a coordinate (SI). Their products and the
determinant of the inertia tensor then stay within float32."""
_POSITIVE = f"a number from {_SMALLEST:g} to {_LARGEST:g}"
_TRIPLE = f"three numbers within +-{_LARGEST:g}"

_NO_TORQUE = 1e-12
"""Torque over lever arm times force up to which it is rounding: ten thousand times that of float64."""
_PLANE_TOLERANCE = 1e-9
"""Out-of-plane component of a position (m) or unit direction that is accepted as rounding."""

_FROM_THE_REST: Any = None
"""A value that is missing, and follows from all others."""


@dataclass(frozen=True)
class Thruster:
    """One thruster nozzle, fixed to the body.

    >>> rans.Thruster(position=(0.3, 0.0, 0.0), direction=(0.0, 1.0, 0.0), force=1.0).force
    1.0
    """

    position: tuple[float, float, float]
    """Point of application of the force in G, m."""
    direction: tuple[float, float, float]
    """Unit vector of the force on the spacecraft in G; the exhaust leaves in the opposite direction."""
    force: float
    """Full thrust, N."""
    supply: int = 0
    """Number of the supply that feeds it, such as a tank or a plenum. Open thrusters reduce the thrust of those
    of their own supply only."""


class CommandRange(NamedTuple):
    """Name, kind and bounds of one command of a craft."""

    name: str
    """Name such as "thruster 0" or "wheel 2"."""
    kind: str
    """Kind: "on-off", "pulsed", "throttle" or "wheel"."""
    low: float
    high: float


class Store(NamedTuple):
    """Name, unit and bounds of one state of an effector, such as the propellant left."""

    name: str
    unit: str
    initial: float
    """Value at the start of an episode."""
    low: float
    high: float


@dataclass(frozen=True)
class Spacecraft(NotebookRepr):
    """A rigid body with thrusters that moves in the plane (dimension 2) or in space (dimension 3).

    >>> rans.load_spacecraft("free-flyer")
    <Spacecraft free-flyer: 5.32 kg in space, thrusters 16 x 1 N>

    `planar` is a shorter constructor for the plane.

    Raises:
        ConfigError: a value is not physical; the message names the spacecraft, the key and the bound.
    """

    name: str
    dimension: Literal[2, 3]
    """2: x, y and heading (3DoF); 3: position and attitude (6DoF)."""
    mass: float
    """Mass with a full tank, kg."""
    inertia: tuple[tuple[float, float, float], ...]
    """Inertia tensor about the centre of mass, axes of G, kg m^2. A planar craft has one moment, the zz entry: the
    other principal moments become equal to it, whatever they were."""
    thrusters: tuple[Thruster, ...]
    centre_of_mass: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Centre of mass in G, m."""
    thrust_sharing: ThrustSharing = "none"
    """"none": each open thruster gives its full force. "split": the supply feeds the equivalent of one thruster,
    which the open ones share: F_i = F_max a_i / max(sum a, 1), as on the 2024 platform of the original system.
    Only a craft with one supply may have "split"; the droop of several is `ThrusterConditions.droop`."""
    radius: float = _FROM_THE_REST
    """Outer radius for drawings, m. By default that of the farthest thruster, or of a uniform ball with this mass
    and inertia where it is larger."""
    shape: Shape = "sphere"
    """Shape of the platform's tank or of the free flyer's body in drawings."""
    actuators: Actuators = ON_OFF
    """Command mode of all thrusters."""
    wheels: tuple[Wheel, ...] = ()
    """Reaction wheels; their commands come after those of the thrusters."""
    propellant: Propellant | None = None
    """Propellant of the thrusters; None: the mass is constant."""
    further_effectors: tuple[Any, ...] = ()
    """Effectors of other kinds (`rans.effectors.effector.Effector`); their commands and stores come last."""

    def __post_init__(self) -> None:
        if is_radius_missing := self.radius is None:
            object.__setattr__(self, "radius", 1.0)
        check_spacecraft(self)
        if is_radius_missing:
            object.__setattr__(self, "radius", _outer_radius(self))
        if self.dimension == 2:
            zz = self.inertia[2][2]
            object.__setattr__(self, "inertia", ((zz, 0.0, 0.0), (0.0, zz, 0.0), (0.0, 0.0, zz)))
        # Computed here because the compiler of torch cannot trace cached properties.
        _ = self.commands, self.stores, self.wheel_map, self.wrench_map, self.droop, self.supplies
        _ = self.command_count, self.thruster_commands, self.wheel_commands, self.has_only_thrusters
        _ = self.mounted

    @classmethod
    def planar(
        cls,
        name: str,
        mass: float,
        inertia: float,
        thrusters: Iterable[PlanarThruster],
        *,
        centre_of_mass: Pair = (0.0, 0.0),
        thrust_sharing: ThrustSharing = "none",
        radius: float = _FROM_THE_REST,
        shape: Shape = "sphere",
        actuators: Actuators = ON_OFF,
        wheels: tuple[Wheel, ...] = (),
        propellant: Propellant | None = None,
    ) -> Spacecraft:
        """Spacecraft in the plane, from vectors of two numbers and one moment of inertia.

        >>> rans.Spacecraft.planar("slider", 5.0, 0.1, [
        ...     ((-0.2, 0.1), (1, 0), 1.0), ((-0.2, -0.1), (1, 0), 1.0),
        ...     ((0.2, 0.1), (-1, 0), 1.0), ((0.2, -0.1), (-1, 0), 1.0),
        ...     ((0.0, -0.2), (0, 1), 1.0), ((0.0, 0.2), (0, -1), 1.0)])
        <Spacecraft slider: 5 kg in the plane, thrusters 6 x 1 N>

        Args:
            name: name of the spacecraft.
            mass: mass, kg.
            inertia: moment of inertia about the centre of mass, kg m^2.
            thrusters: position (x, y) in G, m, direction (x, y) of the force, of any length, and force, N.
            centre_of_mass: centre of mass (x, y) in G, m.
            thrust_sharing: "none" or "split", see `Spacecraft.thrust_sharing`.
            radius: outer radius for drawings, m; see `Spacecraft.radius` for the default.
            shape: shape for drawings.
            actuators: command mode of all thrusters.
            wheels: reaction wheels about z.
            propellant: propellant of the thrusters; None: the mass is constant.

        Raises:
            ConfigError: a value is not physical; the message names the spacecraft, the key and the bound.
        """
        try:
            planar = tuple(_in_plane(*thruster) for thruster in thrusters)
            x, y = centre_of_mass
        except (TypeError, ValueError) as error:
            raise ConfigError(
                f"spacecraft {name!r}: thrusters are ((x, y), (x, y), force) each, and the "
                f"centre of mass is (x, y): {error}."
            ) from error
        tensor = ((inertia, 0.0, 0.0), (0.0, inertia, 0.0), (0.0, 0.0, inertia))
        return cls(
            name,
            2,
            mass,
            tensor,
            planar,
            (x, y, 0.0),
            thrust_sharing,
            radius,
            shape,
            actuators,
            wheels=wheels,
            propellant=propellant,
        )

    def __repr__(self) -> str:
        where = "the plane" if self.dimension == 2 else "space"
        return f"<Spacecraft {self.name}: {self.mass:g} kg in {where}, {self._effectors}>"

    @property
    def _effectors(self) -> str:
        wheels = f", {counted(len(self.wheels), 'wheel')}" if self.wheels else ""
        tank = "" if self.propellant is None else f", {self.propellant.mass:g} kg propellant"
        further = "".join(f", {e.label}" for e in self.further_effectors)
        return f"thrusters {self.thrust}{wheels}{tank}{further}"

    @cached_property
    def commands(self) -> tuple[CommandRange, ...]:
        """Commands of a control period: one per thruster, one per wheel, then those of further effectors.

        Networks, files of flights and action spaces have this order.
        """
        actuators = self.actuators
        thrusters = (
            CommandRange(f"thruster {i}", actuators.kind, actuators.low, actuators.high)
            for i in range(len(self.thrusters))
        )
        wheels = (CommandRange(f"wheel {i}", "wheel", -1.0, 1.0) for i in range(len(self.wheels)))
        further = (command for effector in self.mounted for command in effector.commands)
        return (*thrusters, *wheels, *further)

    @cached_property
    def thruster_count(self) -> int:
        """Number of thrusters, each with one command."""
        return len(self.thrusters)

    @cached_property
    def wheel_count(self) -> int:
        """Number of reaction wheels, each with one command."""
        return len(self.wheels)

    @cached_property
    def command_count(self) -> int:
        """Number of commands of a control period, of all effectors."""
        return len(self.commands)

    @cached_property
    def thruster_commands(self) -> slice:
        """Positions of the thrusters' commands among `commands`."""
        return slice(0, self.thruster_count)

    @cached_property
    def wheel_commands(self) -> slice:
        """Positions of the wheels' commands among `commands`."""
        return slice(self.thruster_count, self.thruster_count + self.wheel_count)

    @cached_property
    def controls_every_direction(self) -> bool:
        """Whether the wrenches of thrusters and reaction wheels positively span all degrees of freedom."""
        return positively_spans(self.wrenches_either_way)

    @cached_property
    def wrenches_either_way(self) -> np.ndarray:
        """Wrench of each thruster, and of each wheel in both directions, N and N m: (3 or 6, effectors).

        A wheel has two columns, one for each sense, so that commands of all columns are 0 to 1.
        """
        size = self.dimension
        turns = np.array(
            [sign * np.array(column) for column in self.wheel_map for sign in (1.0, -1.0)]
        )
        wheels = np.zeros((len(turns), self.degrees_of_freedom))
        if len(turns):
            wheels[:, size:] = turns
        return np.vstack([self.wrenches, wheels]).T

    @cached_property
    def can_turn(self) -> bool:
        """Whether any effector gives a torque about the centre of mass.

        A craft whose thrusters all act through its centre of mass moves as a point mass with constant angular
        velocity. Torques below 1e-9 of the largest force times the longest lever arm are treated as rounding of
        positions and directions in a file.
        """
        if self.wheels or any(effector.largest_torque > 0.0 for effector in self.further_effectors):
            return True
        if not self.thrusters:
            return False
        arms = np.array([t.position for t in self.thrusters]) - np.array(self.centre_of_mass)
        largest = max(t.force for t in self.thrusters) * np.linalg.norm(arms, axis=1).max()
        torques = self.wrenches[:, self.dimension :]
        return bool(np.abs(torques).max() > 1e-9 * largest)

    @cached_property
    def is_steerable(self) -> bool:
        """Whether effectors accelerate the craft in every direction and, if any gives a torque, about every axis.

        This is true for a craft that `controls_every_direction`, for one without torque (`can_turn`) whose forces
        positively span the plane or space, and for one without thrusters whose wheels turn it about every axis.
        """
        if not self.thrusters:
            return bool(self.wheels) and positively_spans(
                self.wrenches_either_way[self.dimension :]
            )
        if self.can_turn:
            return self.controls_every_direction
        return positively_spans(self.wrenches_either_way[: self.dimension])

    @cached_property
    def has_only_thrusters(self) -> bool:
        """Whether no other effector takes commands."""
        return self.command_count == self.thruster_count

    @cached_property
    def stores(self) -> tuple[Store, ...]:
        """Entries of `rans.model.dynamics.State.stores`: propellant left, wheel momenta, further effectors.

        Propellant has an entry only if the craft has `propellant`.
        """
        tank = self.propellant
        left = (
            ()
            if tank is None
            else (Store(name="propellant", unit="kg", initial=tank.mass, low=0.0, high=tank.mass),)
        )
        wheels = (
            Store(
                name=f"momentum of wheel {i}",
                unit="N m s",
                initial=0.0,
                low=-wheel.max_momentum,
                high=wheel.max_momentum,
            )
            for i, wheel in enumerate(self.wheels)
        )
        further = (store for effector in self.mounted for store in effector.stores)
        return (*left, *wheels, *further)

    @cached_property
    def mounted(self) -> tuple[Any, ...]:
        """`further_effectors` as parts of this craft (`rans.effectors.effector.Effector.of_craft`)."""
        return tuple(effector.of_craft(self) for effector in self.further_effectors)

    @property
    def is_rigid(self) -> bool:
        """Whether no mass moves in the craft, such as a liquid; wheels and propellant count as rigid."""
        return not any(effector.moves_mass for effector in self.further_effectors)

    @property
    def acting_effectors(self) -> tuple[Any, ...]:
        """Further effectors that push, turn or take commands: all but those that only move a mass in the craft."""
        return tuple(
            effector
            for effector, mounted in zip(self.further_effectors, self.mounted, strict=True)
            if mounted.commands or not effector.moves_mass
        )

    @property
    def is_continuous(self) -> bool:
        """Whether any command may take values between its bounds."""
        return self.actuators.is_continuous or not self.has_only_thrusters

    @property
    def command_dtype(self) -> Literal["int8", "float32"]:
        """Number type in which commands are stored."""
        return self.actuators.dtype if self.has_only_thrusters else "float32"

    @property
    def lightest(self) -> float:
        """Mass with an empty tank over mass with a full tank."""
        return 1.0 if self.propellant is None else 1.0 - self.propellant.mass / self.mass

    @property
    def thrust(self) -> str:
        """Number of thrusters and their force, such as "8 x 1 N"."""
        if not self.thrusters:
            return "none"
        forces = sorted({t.force for t in self.thrusters})
        each = f"{forces[0]:g} N" if len(forces) == 1 else f"{forces[0]:g} to {forces[-1]:g} N"
        return f"{len(self.thrusters)} x {each}"

    @cached_property
    def droop(self) -> float:
        """Droop of the shared supply: 1 if thrusters share it (`thrust_sharing`), else 0."""
        return 1.0 if self.thrust_sharing == "split" else 0.0

    @cached_property
    def supplies(self) -> tuple[tuple[int, ...], ...]:
        """Indices of the thrusters that each supply feeds, in the order of the supplies' numbers."""
        numbers = sorted({thruster.supply for thruster in self.thrusters})
        return tuple(
            tuple(i for i, thruster in enumerate(self.thrusters) if thruster.supply == number)
            for number in numbers
        )

    @cached_property
    def wrench_map(self) -> tuple[tuple[float, ...], ...]:
        """Wrench of each thruster at full thrust about the centre of mass, in B, N and N m.

        Plane: (F_x, F_y, tau_z); space: (F_x, F_y, F_z, tau_x, tau_y, tau_z).
        """
        if not self.thrusters:
            return ()
        forces = np.array([np.array(t.direction) * t.force for t in self.thrusters])
        arms = np.array([t.position for t in self.thrusters]) - np.array(self.centre_of_mass)
        torques = np.cross(arms, forces)
        # A force through the centre of mass has no torque; rounding leaves some 1e-17 N m.
        largest = np.linalg.norm(arms, axis=1) * np.linalg.norm(forces, axis=1)
        torques[np.abs(torques) <= _NO_TORQUE * largest[:, None]] = 0.0
        wrenches = np.hstack([forces, torques])
        rows = wrenches[:, (0, 1, 5)] if self.dimension == 2 else wrenches
        return tuple(map(tuple, rows.tolist()))

    @property
    def wrenches(self) -> np.ndarray:
        """The rows of `wrench_map` as an array (thrusters, 3 or 6), also where there are no thrusters."""
        return np.array(self.wrench_map).reshape(self.thruster_count, self.degrees_of_freedom)

    @cached_property
    def wheel_map(self) -> tuple[tuple[float, ...], ...]:
        """Torque of each wheel on the craft at command 1, in B, N m: (tau_z,) in the plane, three in space."""
        torques = [[-wheel.max_torque * x for x in wheel.axis] for wheel in self.wheels]
        return tuple(tuple(t[2:] if self.dimension == 2 else t) for t in torques)

    @property
    def turns(self) -> bool:
        """Whether an effector of the craft as designed turns it; if none does, it has no attitude of its own.

        >>> rans.load_spacecraft("afrl-deputy").turns, rans.load_spacecraft("free-flyer").turns
        (False, True)
        """
        torques = (row[self.dimension :] for row in self.wrench_map)
        return bool(self.wheels or self.acting_effectors) or any(map(any, torques))

    @property
    def degrees_of_freedom(self) -> int:
        """Number of degrees of freedom: 3 in the plane, 6 in space."""
        return 3 if self.dimension == 2 else 6


MOST_WHEELS = 100
"""Largest number of wheels, well above that of any spacecraft."""
MOST_THRUSTERS = 1000
"""Largest number of thrusters, ten times that of any spacecraft; more would take minutes to check."""


def _outer_radius(craft: Spacecraft) -> float:
    """Radius of the farthest thruster, or of a uniform ball of the same mass and largest moment, m.

    A ball of radius r has the moment 2/5 m r^2.
    """
    arms = (math.dist(thruster.position, craft.centre_of_mass) for thruster in craft.thrusters)
    tensor = np.array(craft.inertia)
    moment = tensor[2, 2] if craft.dimension == 2 else np.linalg.eigvalsh(tensor).max()
    return max(*arms, math.sqrt(2.5 * float(moment) / craft.mass), _SMALLEST)


def check_spacecraft(craft: Spacecraft) -> None:
    """Reject spacecraft that are not physical, and warn about those that cannot be controlled.

    Raises:
        ConfigError: a value is not physical; the message names the spacecraft, the key and the bound.
    """
    one_line("the name of a spacecraft", craft.name)
    dimension = craft.dimension
    kinds = "OnOff(), Pulsed(counts, least) or Throttle()"
    for key, holds, bound in (
        ("dimension", type(dimension) is int and dimension in (2, 3), "2 (plane) or 3 (space)"),
        ("thrust_sharing", craft.thrust_sharing in ("none", "split"), '"none" or "split"'),
        ("shape", craft.shape in ("sphere", "cylinder"), '"sphere" or "cylinder"'),
        ("actuators", isinstance(craft.actuators, Actuators), kinds),
        ("mass", _positive(craft.mass), f"{_POSITIVE} kg"),
        ("radius", _positive(craft.radius), f"{_POSITIVE} m"),
        ("centre_of_mass", _triple(craft.centre_of_mass), f"{_TRIPLE} m"),
    ):
        _require(holds, craft, key, getattr(craft, key), bound)
    # Parts and their numbers, then what they give together.
    for key in ("thrusters", "wheels", "further_effectors"):
        _require(isinstance(getattr(craft, key), tuple), craft, key, getattr(craft, key), "a tuple")
    if not craft.command_count:
        raise ConfigError(
            f"spacecraft {craft.name!r} has nothing that takes commands: it needs a thruster, a reaction "
            "wheel, or another effector that takes commands."
        )
    for key, parts, most in (
        ("thruster", craft.thrusters, MOST_THRUSTERS),
        ("wheel", craft.wheels, MOST_WHEELS),
    ):
        _require(len(parts) <= most, craft, key, len(parts), f"at most {most} {key}s")
    _check_inertia(craft)
    _check_wheels(craft)
    _check_propellant(craft)
    _check_further(craft)
    for index, thruster in enumerate(craft.thrusters):
        checked(f"spacecraft {craft.name!r}: thruster {index}", thruster, Thruster)
        _check_thruster(craft, index, thruster)
    supplies = len(craft.supplies)
    _require(
        craft.thrust_sharing == "none" or supplies == 1,
        craft,
        "thrust_sharing",
        craft.thrust_sharing,
        f'"none" where thrusters have several supplies ({supplies} here); the droop of each of them is '
        "thrusters.droop of the conditions",
    )
    # Engines that cannot be shut are for flight against gravity, which replaces the missing directions.
    if craft.actuators.low == 0.0 and not craft.is_steerable:
        warnings.warn(
            f"spacecraft {craft.name!r}: its {_effectors(craft)} cannot push and turn it in "
            f"every direction of its {craft.degrees_of_freedom} degrees of freedom, so most tasks cannot be "
            "solved; the usual cause is a missing or reversed thruster.",
            RansWarning,
            stacklevel=3,
        )


def _effectors(craft: Spacecraft) -> str:
    """Number of effectors as text, such as "8 thrusters and 1 reaction wheel"."""
    wheels = f" and {counted(len(craft.wheels), 'reaction wheel')}" if craft.wheels else ""
    return f"{counted(len(craft.thrusters), 'thruster')}{wheels}"


def _in_plane(position: Pair, direction: Pair, force: float) -> Thruster:
    """Thruster from vectors of two numbers; `check_spacecraft` rejects a direction of zero length."""
    (x, y) = position
    (a, b) = direction
    length = math.hypot(a, b) or 1.0
    return Thruster((x, y, 0.0), (a / length, b / length, 0.0), force)


def _require(holds: bool, craft: Spacecraft, key: str, value: object, bound: str) -> None:
    if not holds:
        raise ConfigError(f"spacecraft {craft.name!r}: {key} must be {bound}, got {brief(value)}.")


def _number(x: object) -> bool:
    """Whether this is a real number in range; NaN and booleans are not."""
    return isinstance(x, int | float) and not isinstance(x, bool) and -_LARGEST <= x <= _LARGEST


def _positive(x: float) -> bool:
    return _number(x) and x >= _SMALLEST


def _triple(vector: tuple[float, ...]) -> bool:
    return isinstance(vector, tuple) and len(vector) == 3 and all(_number(x) for x in vector)


def _check_unit(craft: Spacecraft, key: str, vector: tuple[float, ...]) -> None:
    """Reject what is no unit vector."""
    _require(_triple(vector), craft, key, vector, _TRIPLE)
    length = math.hypot(*vector)
    bound = f"a unit vector (its length is {length:.4g}; a zero vector has none)"
    _require(abs(length - 1) < 1e-9, craft, key, vector, bound)


def _check_inertia(craft: Spacecraft) -> None:
    """Reject tensors of no rigid body: principal moments must be > 0, and none above the sum of the others.

    A planar craft may have any moment about z: it has no others.
    """

    def require(holds: bool, bound: str) -> None:
        _require(holds, craft, "inertia", rows, bound)

    rows = craft.inertia
    is_table = isinstance(rows, tuple) and [*map(np.shape, rows)] == [(3,)] * 3
    if craft.dimension == 2 and is_table:
        about_z = rows[2][2]
        _require(_positive(about_z), craft, "inertia", about_z, f"{_POSITIVE} kg m^2 about z")
    require(is_table and all(map(_triple, rows)), f"three rows of {_TRIPLE} kg m^2")
    if craft.dimension == 2:
        return
    tensor = np.array(rows)
    require(
        np.abs(tensor - tensor.T).max() <= 1e-9 * np.abs(tensor).max(),
        "symmetric (I_xy = I_yx, ...)",
    )
    low, middle, high = np.linalg.eigvalsh(tensor)
    require(
        low >= _SMALLEST,
        "positive definite: its smallest principal moment is "
        f"{low:.4g} kg m^2, the bound {_SMALLEST:g}",
    )
    require(
        high <= (low + middle) * (1 + 1e-9),
        "that of a rigid body: the largest principal moment "
        f"{high:.4g} may not exceed the sum of the other two, {low + middle:.4g} kg m^2",
    )


def _check_thruster(craft: Spacecraft, index: int, thruster: Thruster) -> None:
    """Reject (`ConfigError`) a thruster with a wrong number, or outside the plane of a planar craft."""
    key = f"thruster {index} "
    _require(_triple(thruster.position), craft, key + "position", thruster.position, f"{_TRIPLE} m")
    _check_unit(craft, key + "direction", thruster.direction)
    _require(_positive(thruster.force), craft, key + "force", thruster.force, f"{_POSITIVE} N")
    whole = type(thruster.supply) is int and 0 <= thruster.supply < MOST_THRUSTERS
    bound = f"a whole number from 0 to {MOST_THRUSTERS - 1}"
    _require(whole, craft, key + "supply", thruster.supply, bound)
    if craft.dimension == 2:
        height = craft.centre_of_mass[2]
        line = thruster.position, thruster.direction
        bound = f"in the plane of the centre of mass (z = {height:g} m) when dimension = 2"
        off = max(abs(thruster.position[2] - height), abs(thruster.direction[2]))
        _require(off <= _PLANE_TOLERANCE, craft, key.strip(), line, bound)


def _check_wheels(craft: Spacecraft) -> None:
    """Refuse wheels whose numbers are out of range, or that do not turn a planar craft in its plane."""
    for index, wheel in enumerate(craft.wheels):
        key = f"wheel {index} "
        checked(f"spacecraft {craft.name!r}: wheel {index}", wheel, Wheel)
        _check_unit(craft, key + "axis", wheel.axis)
        # Limits of its motor, its store and its inertia.
        for name, unit in (
            ("max_torque", "N m"),
            ("max_momentum", "N m s"),
            ("inertia", "kg m^2"),
        ):
            value = getattr(wheel, name)
            _require(_positive(value), craft, key + name, value, f"{_POSITIVE} {unit}")
        if craft.dimension == 2:
            upright = math.hypot(*wheel.axis[:2]) <= _PLANE_TOLERANCE
            bound = "(0, 0, 1) or (0, 0, -1) when dimension = 2: only such a wheel turns it in the plane"
            _require(upright, craft, key + "axis", wheel.axis, bound)


def _check_propellant(craft: Spacecraft) -> None:
    """Reject (`ConfigError`) a tank that leaves the craft no mass, or has no specific impulse."""
    if craft.propellant is None:
        return
    tank = checked(f"spacecraft {craft.name!r}: propellant", craft.propellant, Propellant)
    below = f"a number from {_SMALLEST:g} kg to less than the craft's mass with a full tank, {craft.mass:g} kg"
    possible = _positive(tank.mass) and tank.mass <= craft.mass * (1.0 - 1e-3)
    _require(possible, craft, "propellant mass", tank.mass, below)
    value = tank.specific_impulse
    _require(_positive(value), craft, "specific_impulse", value, f"{_POSITIVE} s")
    size = f"a number from 0 to {_LARGEST:g} m, and 0 for propellant without a position"
    sized = _number(tank.radius) and tank.radius >= 0.0
    possible = sized and (tank.position is not None or tank.radius == 0.0)
    _require(possible, craft, "propellant radius", tank.radius, size)
    if tank.position is None:
        return
    _require(_triple(tank.position), craft, "propellant position", tank.position, f"{_TRIPLE} m")
    off = craft.dimension == 2 and abs(tank.position[2] - craft.centre_of_mass[2])
    bound = f"in the plane of the centre of mass (z = {craft.centre_of_mass[2]:g} m)"
    _require(off <= _PLANE_TOLERANCE, craft, "propellant position", tank.position, bound)
    tensor = np.array(craft.inertia)
    moments = (tensor[2, 2],) if craft.dimension == 2 else tuple(tensor[np.triu_indices(3)])
    _, inertia, _ = emptied(craft, craft.mass, moments, (0.0,) * craft.dimension)
    bound = (
        "a place that leaves a rigid body when the tank is empty, whose moments of inertia are > 0 and none above "
        "the sum of the other two"
    )
    _require(bool(is_rigid_body(inertia)), craft, "propellant position", tank.position, bound)


def emptied(
    craft: Spacecraft, mass: Any, inertia: tuple[Any, ...], centre: tuple[Any, ...]
) -> tuple[Any, tuple[Any, ...], tuple[Any, ...]]:
    """Mass, inertia and offset of the centre of mass with an empty tank, from those with a full one.

    Args:
        craft: with propellant.
        mass: kg; a number or (N,), as all others.
        inertia: about the centre of mass, kg m^2: one moment in the plane, six entries in space.
        centre: offset of the centre of mass from the designed one, m: two or three entries.
    """
    tank = craft.propellant
    assert tank is not None
    left = 1.0 - tank.mass / mass
    if tank.position is None:
        return mass * left, tuple(x * left for x in inertia), centre
    places = zip(tank.position, craft.centre_of_mass, centre, strict=False)
    arm = [place - nominal - offset for place, nominal, offset in places]
    growth = 1.0 / left
    more = tank.excess(mass, inertia, arm, growth, growth * (growth - 1.0))
    moments = tuple((x + y) * left for x, y in zip(inertia, more, strict=True))
    moved = tuple(c - (growth - 1.0) * a for c, a in zip(centre, arm, strict=True))
    return mass * left, moments, moved


def is_rigid_body(inertia: tuple[Any, ...], tolerance: float = 1e-9) -> Any:
    """Whether moments of inertia (one in the plane, six entries in space; numbers or (N,)) are those of a body."""
    entries = np.stack(np.broadcast_arrays(*inertia), axis=-1)
    if len(inertia) == 1:
        return entries[..., 0] > 0.0
    low, middle, high = np.moveaxis(
        np.linalg.eigvalsh(entries[..., ((0, 1, 2), (1, 3, 4), (2, 4, 5))]), -1, 0
    )
    return (low > 0.0) & (high <= (low + middle) * (1.0 + tolerance))


def _check_further(craft: Spacecraft) -> None:
    """Refuse further effectors that cannot be on this craft, or whose names are no names, and two moving masses."""
    for effector in craft.further_effectors:
        effector.check_craft(craft)
        one_line(f"spacecraft {craft.name!r}: the label of an effector", effector.label)
    if craft.propellant is not None and craft.propellant.position and not craft.is_rigid:
        raise ConfigError(
            f"spacecraft {craft.name!r} has a tank with a position, whose emptying moves the centre of mass, and "
            "an effector that moves the craft itself: take the position out of [propellant], or the effector."
        )
    for part in (*craft.commands, *craft.stores):
        one_line(f"spacecraft {craft.name!r}: the name of a command or store", part.name)
    moving = [e.label for e in craft.further_effectors if e.moves_mass]
    if len(moving) > 1:
        raise ConfigError(
            f"spacecraft {craft.name!r} has {' and '.join(moving)}: one effector of a craft may move a mass in it."
        )


def check_rigid(craft: Spacecraft, what: str) -> None:
    """Refuse a craft that an effector moves itself, such as a mass in it.

    Args:
        craft: any.
        what: what is of rigid craft only, as the subject of a sentence in the plural.

    Raises:
        ConfigError: it is not `Spacecraft.is_rigid`.
    """
    if not craft.is_rigid:
        moving = " and ".join(e.label for e in craft.further_effectors if e.moves_mass)
        raise ConfigError(
            f"{what} are those of a rigid craft, and {craft.name!r} has {moving}, which moves in it or depends on "
            "its motion: take its table, such as [slosh] or [[effector]], out of the file to compute them without."
        )


def positively_spans(columns: np.ndarray) -> bool:
    """Whether the columns (n, m) positively span R^n: sums with factors >= 0 give every vector.

    This is the case if and only if they span R^n and zero is a combination of them with strictly positive factors
    (Davis, "Theory of positive linear dependence", 1954). It decides which craft are warned about, and which
    `Allocation` takes.
    """
    columns = columns / np.linalg.norm(columns, axis=0)
    if np.linalg.matrix_rank(columns, tol=1e-9) < len(columns):
        return False
    ones = np.ones(columns.shape[1])
    # The factors nearest to one that give zero; for most craft this avoids the import of SciPy (0.3 s).
    if np.all(ones - np.linalg.lstsq(columns, columns @ ones)[0] > 1e-9):
        return True
    from scipy.optimize import linprog  # `nnls` of SciPy 1.17 gives wrong residuals of such columns

    # The least factors from 1 on that give zero.
    best = linprog(ones, A_eq=columns, b_eq=np.zeros(len(columns)), bounds=(1.0, None))
    return bool(best.success and np.linalg.norm(columns @ best.x) < 1e-9 * np.linalg.norm(best.x))
