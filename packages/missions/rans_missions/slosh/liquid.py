"""Liquid that sloshes in a tank, as one pendulum inside the spacecraft."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from rans.extend import (
    Action,
    Begun,
    Body,
    CommandRange,
    ConfigError,
    Drift,
    Effector,
    Spacecraft,
    Timing,
    brief,
    is_finite,
)
from rans_missions.slosh import checks, swinging
from rans_missions.slosh.checks import MOST
from rans_missions.slosh.swinging import LARGEST

_FIRST_ZERO = 1.841183781
"""First zero of the derivative of the Bessel function J1: the first lateral mode of an upright cylinder."""


SMALLEST = 1e-9
"""Least mass, kg, and length, m, as of a spacecraft."""
IN_PLANE = 1e-9
"""Component out of the plane, m, that is accepted as rounding."""


@dataclass(frozen=True)
class Slosh(Effector):
    """Liquid that sloshes in a tank, as a point mass on a massless rod with a hinge fixed to the spacecraft.

    The rod turns freely about its hinge, in the plane or in every direction of space, with viscous friction. Mass,
    inertia and centre of mass of the spacecraft include the liquid with the rod along ``direction``. Without thrust
    the rod stays where it is or turns on: nothing but the acceleration of the spacecraft acts as gravity. It is a
    further effector without commands (`rans.Spacecraft.further_effectors`), the table ``[slosh]`` of a file.

    A pendulum is the equivalent of the first lateral mode of a liquid under an acceleration that exceeds the effect
    of surface tension. Source: F. T. Dodge, "The new dynamic behavior of liquids in moving containers", Southwest
    Research Institute, 2000 (the revision of NASA SP-106, 1966), chapters 3 and 4.

    >>> slosh = rans.Slosh(mass=0.5, length=0.1, hinge=(0.05, 0.0, 0.0), direction=(-1.0, 0.0, 0.0), damping=2e-4)
    >>> round(slosh.frequency(acceleration=0.2), 4)  # rad/s
    1.4142
    """

    mass: float
    """Mass that swings, kg: a part of the spacecraft's mass."""
    length: float
    """Length of the rod, m."""
    hinge: tuple[float, float, float]
    """Hinge in G, m."""
    direction: tuple[float, float, float]
    """Unit vector from the hinge to the mass in G where the angle is zero."""
    damping: float = 0.0
    """Torque of the hinge's friction for each rad/s of the rod relative to the craft, N m s."""

    @classmethod
    def in_cylinder(
        cls,
        liquid: float,
        radius: float,
        depth: float,
        bottom: tuple[float, float, float],
        direction: tuple[float, float, float],
        damping_ratio: float,
        acceleration: float,
    ) -> Slosh:
        """Pendulum of the first lateral mode of a liquid in an upright cylinder with a flat bottom.

        Its length is R / (k tanh(k h / R)) and its mass 2 m tanh(k h / R) / ((k^2 - 1) k h / R), for the radius R,
        the depth h, the liquid m and k = 1.8412. The mass that swings is 2 R / k tanh(k h / 2 R) below the surface.
        The other liquid is a part of the rigid spacecraft. Source: as of the class. Length, mass and hinge agree
        with table 1 of P. K. Malhotra, T. Wenk and M. Wieland, "Simple procedure for seismic analysis of
        liquid-storage tanks", Structural Engineering International 10(3), 2000.

        Args:
            liquid: mass of all liquid in the tank, kg.
            radius: radius of the tank, m.
            depth: depth of the liquid, m.
            bottom: centre of the tank's bottom in G, m.
            direction: unit vector from the surface to the bottom in G: against the usual acceleration.
            damping_ratio: share of critical damping, such as 0.005 without baffles.
            acceleration: acceleration of the craft at which the damping has this ratio, m/s^2.

        Raises:
            ConfigError: a value is not a finite number above 0 (the damping ratio may be 0).
        """
        for name, value, unit in (
            ("the liquid in the tank", liquid, "kg"),
            ("the radius of the tank", radius, "m"),
            ("the depth of the liquid", depth, "m"),
            ("the acceleration", acceleration, "m/s^2"),
        ):
            if not is_finite(value) or value <= 0:
                raise ConfigError(f"{name} must be a finite number > 0 {unit}, got {value!r}.")
        if not is_finite(damping_ratio) or damping_ratio < 0:
            raise ConfigError(
                f"the damping ratio must be a finite number >= 0, got {damping_ratio!r}."
            )
        # Lengths and masses by the first mode.
        k = _FIRST_ZERO
        fullness = k * depth / radius
        length = radius / (k * math.tanh(fullness))
        mass = liquid * 2.0 * math.tanh(fullness) / ((k * k - 1.0) * fullness)
        # Heights above the bottom, along the tank's axis.
        height = depth - 2.0 * radius / k * math.tanh(0.5 * fullness) + length
        x, y, z = (b - height * d for b, d in zip(bottom, direction, strict=True))
        damping = 2.0 * damping_ratio * mass * length**2 * math.sqrt(acceleration / length)
        return cls(mass, length, (x, y, z), direction, damping)

    def frequency(self, acceleration: float) -> float:
        """Natural frequency of small swings under an acceleration (m/s^2) of a heavy spacecraft, rad/s."""
        return math.sqrt(acceleration / self.length)

    def point(self) -> tuple[float, float, float]:
        """Position of the mass in G where the angle is zero, m."""
        x, y, z = (h + self.length * d for h, d in zip(self.hinge, self.direction, strict=True))
        return (x, y, z)

    @property
    def commands(self) -> tuple[CommandRange, ...]:
        """No commands."""
        return ()

    @property
    def moves_mass(self) -> bool:
        """A mass moves."""
        return True

    @property
    def label(self) -> str:
        """Its mass."""
        return f"{self.mass:g} kg slosh"

    @property
    def summary(self) -> str:
        """Length of the rod, hinge and damping."""
        hinge = ", ".join(f"{x:.4g}" for x in self.hinge)
        return f"on a rod of {self.length:g} m, hinge ({hinge}) m, {self.damping:g} N m s"

    def of_craft(self, craft: Spacecraft) -> Effector:
        """The pendulum of this liquid in a craft, with its states."""
        return swinging.Pendulum(self, craft)

    def begin(self, begun: Begun) -> Action | None:
        """Nothing without a craft: see `rans_missions.slosh.swinging.Pendulum`."""
        return None

    def check_craft(self, craft: Spacecraft) -> None:
        """Refuse a pendulum that is out of range, or that leaves no rigid craft around it."""
        if craft.propellant is not None:
            raise ConfigError(
                f"spacecraft {craft.name!r} has [slosh], a pendulum of constant mass, and [propellant]: take one "
                "of them out of its file."
            )

        def require(holds: bool, key: str, value: object, bound: str) -> None:
            if not holds:
                raise ConfigError(
                    f"spacecraft {craft.name!r}: slosh {key} must be {bound}, got {brief(value)}."
                )

        # Numbers of the pendulum alone, then what it leaves of the craft.
        triple = f"three numbers within +-{LARGEST:g}"
        positive = f"a number from {SMALLEST:g} to {LARGEST:g}"
        require(_is_positive(self.length), "length", self.length, f"{positive} m")
        require(_is_triple(self.hinge), "hinge", self.hinge, f"{triple} m")
        require(_is_triple(self.direction), "direction", self.direction, triple)
        norm = math.hypot(*self.direction)
        bound = f"a unit vector (its length is {norm:.4g}; a zero vector has none)"
        require(abs(norm - 1) < 1e-9, "direction", self.direction, bound)
        height = craft.centre_of_mass[2]
        off = max(abs(self.hinge[2] - height), abs(self.direction[2]))
        bound = f"in the plane of the centre of mass (z = {height:g} m)"
        flat = craft.dimension == 3 or off <= IN_PLANE
        require(flat, "hinge and direction", (self.hinge, self.direction), bound)
        calm = is_finite(self.damping) and 0.0 <= self.damping <= LARGEST
        require(calm, "damping", self.damping, f"a number from 0 to {LARGEST:g} N m s")
        below = f"a number from {SMALLEST:g} kg to less than the craft's mass, {craft.mass:g} kg"
        possible = _is_positive(self.mass) and self.mass <= craft.mass * MOST
        require(possible, "mass", self.mass, below)
        self.check_body(craft, Body.of(craft))

    def check_body(self, craft: Spacecraft, body: Body) -> None:
        """See `rans_missions.slosh.checks.check_body`."""
        checks.check_body(self, craft, body)

    def check_conditions(self, craft: Spacecraft, conditions: Any) -> None:
        """See `rans_missions.slosh.checks.check_conditions`."""
        checks.check_conditions(self, craft, conditions)

    def check_flight(
        self, craft: Spacecraft, drift: Drift, period: float, conditions: Any = None
    ) -> None:
        """See `rans_missions.slosh.checks.check_flight`."""
        checks.check_flight(self, craft, drift, period, conditions)

    def inaccuracy(self, craft: Spacecraft, states: Any, going: Any, timing: Timing) -> str:
        """See `rans_missions.slosh.swinging.inaccuracy`."""
        return swinging.inaccuracy(self, craft, states, going, timing)


def _is_positive(x: object) -> bool:
    return is_finite(x) and SMALLEST <= x <= LARGEST  # type: ignore[operator]  # a finite number


def _is_triple(vector: tuple[float, ...]) -> bool:
    return (
        isinstance(vector, tuple)
        and len(vector) == 3
        and all(is_finite(x) and abs(x) <= LARGEST for x in vector)
    )
