"""Liquid that sloshes in a tank, as one pendulum inside the spacecraft."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rans.extend import (
    Action,
    Begun,
    Body,
    ConfigError,
    Drift,
    Effector,
    Spacecraft,
    Timing,
    bounds,
    brief,
    is_finite,
    largest,
    positive,
)
from rans.model.body import numbers
from rans_missions.slosh import swinging
from rans_missions.slosh.pendulum import Rod
from rans_missions.slosh.swinging import DECAY, LARGEST, MOST_STEPS, STEP

_FIRST_ZERO = 1.841183781
"""First zero of the derivative of the Bessel function J1: the first lateral mode of an upright cylinder."""


SMALLEST = 1e-9
"""Least mass, kg, and length, m, as of a spacecraft."""
IN_PLANE = 1e-9
"""Component out of the plane, m, that is accepted as rounding."""
MOST = 1.0 - 1e-3
"""Largest fraction of a mass or an inertia that the liquid may have."""
_STABLE = 2.5
"""Longest step times the rate at which friction stops the rod under conditions, whose steps are those of the
designed craft; the method is stable up to 2.78."""


@dataclass(frozen=True)
class Slosh(Rod, Effector):
    """Liquid that sloshes in a tank, as a point mass on a massless rod with a hinge fixed to the spacecraft.

    The rod turns freely about its hinge, in the plane or in every direction of space, with viscous friction. Mass,
    inertia and centre of mass of the spacecraft include the liquid with the rod along ``direction``. Without thrust
    the rod stays where it is or turns on: nothing but the acceleration of the spacecraft acts as gravity. It is a
    further effector without commands (`rans.Spacecraft.further_effectors`), the table ``[slosh]`` of a file.

    A pendulum is the equivalent of the first lateral mode of a liquid under an acceleration that exceeds the effect
    of surface tension. Source: F. T. Dodge, "The new dynamic behavior of liquids in moving containers", Southwest
    Research Institute, 2000 (the revision of NASA SP-106, 1966), chapters 3 and 4.

    >>> slosh = rans.Slosh(mass=0.5, length=0.1, hinge=(0.05, 0.0, 0.0), direction=(-1.0, 0.0, 0.0), damping=2e-4)
    >>> round((0.2 / slosh.length) ** 0.5, 4)  # rad/s of small swings at 0.2 m/s^2, of a heavy craft
    1.4142
    """

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
            positive(f"{name}, {unit},", value)
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

    commands = ()

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
                f"spacecraft {craft.name!r} has [slosh], a pendulum of constant mass, and [propellant], which "
                "empties: take [propellant] out of its file for a short flight, or [slosh] for a long one."
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
        """Refuse bodies that leave no rigid craft around the liquid; see `Effector.check_body`."""
        # As in the check of the spacecraft, with what each body has of mass, inertia and centre of mass.
        mass = numbers(body.mass)
        fraction = self.mass / craft.mass
        offsets = body.centre or (0.0,) * craft.dimension
        away = [
            point - centre - numbers(offset)
            for point, centre, offset in zip(
                self.point(), craft.centre_of_mass, (*offsets, 0.0)[:3], strict=True
            )
        ]
        adds = fraction * mass * sum(x**2 for x in away) / (1.0 - fraction)
        tensor = np.stack(np.broadcast_arrays(*(numbers(x) for x in body.inertia)), axis=-1)
        moment = tensor[..., 0]
        if craft.dimension == 3:
            moments = np.linalg.eigvalsh(tensor[..., ((0, 1, 2), (1, 3, 4), (2, 4, 5))])
            moment = 0.5 * moments.sum(axis=-1) - moments[..., -1]
        adds, moment = np.broadcast_arrays(adds, moment)
        # What the liquid at rest adds must leave an inertia above 0.
        wrong = np.atleast_1d(adds > moment * MOST)
        if wrong.any():
            first = np.flatnonzero(wrong)[0]
            raise ConfigError(
                f"the body leaves no inertia to {craft.name!r} without its sloshing liquid: at rest that adds "
                f"{np.atleast_1d(adds)[first]:.4g} kg m^2 of {np.atleast_1d(moment)[first]:.4g} kg m^2. Give it "
                "less mass, or more inertia."
            )

    def check_conditions(self, craft: Spacecraft, conditions: Any) -> None:
        """Refuse masses, inertias and centres of mass that leave no rigid craft around the liquid."""
        for body in self._extreme_bodies(craft, conditions):
            try:
                self.check_body(craft, body)
            except ConfigError as error:
                raise ConfigError(f"Conditions: {error} Or narrow their ranges.") from None

    def _extreme_bodies(self, craft: Spacecraft, conditions: Any) -> list[Body]:
        """Bodies that leave least of a rigid craft, or for which friction may stop the rod fastest.

        Those have the least inertia, the extremes of the masses, and the centre of mass as far away from the mass
        at rest as can be.
        """
        away = np.subtract(craft.centre_of_mass, self.point())[: craft.dimension]
        away = away / max(float(np.linalg.norm(away)), 1e-12)
        designed = Body.of(craft)
        return [
            replace(
                designed,
                mass=mass * craft.mass,
                inertia=tuple(bounds(part.body.inertia)[0] * x for x in designed.inertia),
                centre=tuple((largest(part.body.centre) * away).tolist()),
            )
            for part in (conditions, *conditions.others)
            for mass in bounds(part.body.mass)
        ]

    def check_flight(
        self, craft: Spacecraft, drift: Drift, period: float, conditions: Any = None
    ) -> None:
        """Refuse orbits, which pull, and friction that is too fast for a control period, s; see `Effector`."""
        if not drift.in_straight_lines:
            raise ConfigError(
                f"spacecraft {craft.name!r} has [slosh], which is computed in free flight and uniform gravity "
                f"only, and the task's drift is {drift.name}: take [slosh] out of its file for missions on an "
                "orbit."
            )
        pace, decay = swinging.paces(self, craft)
        if period * decay / DECAY > MOST_STEPS:
            limit = self.damping * MOST_STEPS * DECAY / (period * decay)
            raise ConfigError(
                f"spacecraft {craft.name!r}: slosh damping must be at most {limit:.3g} N m s at a control period "
                f"of {period:g} s, got {self.damping:g}: the rod would stop within {1 / decay:.2g} s. The usual "
                "cause is a damping ratio in its place."
            )
        # The longest steps that pieces of a period may have: those of the designed craft.
        step = min(period, STEP / pace, DECAY / decay if decay > 0.0 else math.inf)
        step = max(step, period / MOST_STEPS)
        # The steps are those of the designed craft; conditions may need shorter ones.
        bodies = []
        if conditions is not None:
            bodies = self._extreme_bodies(craft, conditions)
        fastest = max((swinging.paces(self, craft, body)[1] for body in bodies), default=0.0)
        if step * fastest > _STABLE:
            raise ConfigError(
                f"Conditions of body.mass, body.inertia and body.centre stop the rod of {craft.name!r} within "
                f"{1 / fastest:.2g} s, too fast for steps of {step:.2g} s: narrow the ranges, or lower the damping "
                "in the spacecraft's file."
            )

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
