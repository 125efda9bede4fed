"""Equations of a craft and a pendulum inside, the equivalent of a sloshing liquid.

One pair serves the plane and space: in the plane the vectors of its body frame have no component across it.
`rans_missions.slosh.rods` gives Drake the same bodies without these equations, and a Lagrangian of SciPy's tests
both.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from rans.extend import (
    Body,
    Field,
    Heading,
    PlanarState,
    Quat,
    Spacecraft,
    SpatialState,
    Vec2,
    Vec3,
    Wrench,
    atan2,
    cos,
    sin,
    wrap,
)
from rans.model.rotation import symmetric_inverse, symmetric_times


@dataclass(frozen=True)
class Rod:
    """A point mass on a massless rod with a hinge."""

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

    def point(self) -> tuple[float, float, float]:
        """Position of the mass in G where the angle is zero, m."""
        x, y, z = (h + self.length * d for h, d in zip(self.hinge, self.direction, strict=True))
        return (x, y, z)


@dataclass(frozen=True)
class Motion:
    """Attitude and spin of the craft, and direction and velocity of the rod; or their derivatives by time."""

    attitude: Quat | Heading
    spin: Vec3
    """Angular velocity in B, rad/s."""
    rod: Vec3
    """Unit vector from the hinge to the mass, in B."""
    moving: Vec3
    """Derivative of this vector as seen from W, expressed in B, 1/s."""


class Pair(NamedTuple):
    """Craft without the mass that swings, and this mass: constants of their motion."""

    fraction: float
    """Mass that swings over the mass of both."""
    mass: Field
    """Mass of both, kg."""
    to_origin: Vec3
    """From the rigid part's centre of mass to B's origin, in B, m."""
    arm: Vec3
    """From the rigid part's centre of mass to the hinge, in B, m."""
    rest: Vec3
    """Unit vector from the hinge to the mass at rest, in B."""
    length: float
    """Length of the rod, m."""
    inertia: tuple[Field, ...]
    """Moments of inertia of the rigid part about its centre of mass: six entries as of `Body.inertia`, kg m^2."""
    mobility: tuple[Field, ...]
    """Inverse of this tensor, 1/(kg m^2)."""
    reduced: Field
    """Reduced mass of both, kg."""
    damping: float
    """Friction of the hinge, N m s."""

    @classmethod
    def of(cls, slosh: Rod, craft: Spacecraft, body: Body) -> Pair:
        """Constants of a body, of which the same fraction swings as of the designed craft.

        The craft's mass and inertia have the liquid at rest in them, which is taken out here.
        """
        fraction = slosh.mass / craft.mass
        ratio = fraction / (1.0 - fraction)
        shift = (*(body.centre or (0.0,) * craft.dimension), 0.0)[:3]
        hinge = Vec3(
            *(h - c - s for h, c, s in zip(slosh.hinge, craft.centre_of_mass, shift, strict=True))
        )
        whole = body.inertia
        if craft.dimension == 2:
            # Only the moment about z matters; the others are those of a body that it could be of.
            hinge = replace(hinge, z=0.0)
            (moment,) = whole
            whole = (moment, 0.0, 0.0, moment, 0.0, moment)
        rest = Vec3(*slosh.direction)
        # The mass at rest, and opposite to it the centre of the rigid part; B's origin is between them.
        at = hinge + rest.scale(slosh.length)
        to_origin = at.scale(ratio)
        x, y, z = at.columns()
        adds = (y * y + z * z, -x * y, -x * z, x * x + z * z, -y * z, x * x + y * y)
        scale = body.mass * ratio
        inertia = tuple(i - scale * a for i, a in zip(whole, adds, strict=True))
        return cls(
            fraction,
            body.mass,
            to_origin,
            hinge + to_origin,
            rest,
            slosh.length,
            inertia,
            symmetric_inverse(inertia),
            body.mass * (fraction * (1.0 - fraction)),
            slosh.damping,
        )

    def begin(self, state: Any, stores: Sequence[Field]) -> Motion:
        """Motion of a state, and of the liquid's states, which are those of `Pendulum.stores`."""
        spin = Vec3(*in_space(state.spin()))
        if len(stores) == 2:
            angle, rate = stores
            turned = angle + math.atan2(self.rest.y, self.rest.x)
            rod = Vec3(cos(turned), sin(turned), 0.0)
            slip = Vec3(-rate * rod.y, rate * rod.x, 0.0)
        else:
            rod, slip = Vec3(*stores[:3]), Vec3(*stores[3:])
        return Motion(state.attitude, spin, rod, slip + spin.cross(rod))

    def end(self, motion: Motion) -> tuple[Motion, tuple[Field, ...]]:
        """The motion after a part of a control period, with a rod of constant length, and the liquid's states."""
        rod = motion.rod.scale(1.0 / motion.rod.norm())
        slip = motion.moving - motion.spin.cross(rod)
        slip = slip - rod.scale(slip.dot(rod))
        moving = slip + motion.spin.cross(rod)
        if isinstance(motion.attitude, Heading):
            angle = atan2(rod.y, rod.x) - math.atan2(self.rest.y, self.rest.x)
            after = Motion(motion.attitude, motion.spin, rod, moving)
            return after, (wrap(angle), rod.cross(slip).z)
        after = Motion(motion.attitude.normalised(), motion.spin, rod, moving)
        return after, (*rod.columns(), *slip.columns())

    def state(self, p: Any, v: Any, motion: Motion) -> Any:
        """State of the craft with this position and velocity of B."""
        if isinstance(motion.attitude, Heading):
            return PlanarState(p, motion.attitude, v, motion.spin.z)
        return SpatialState(p, motion.attitude, v, motion.spin)

    def centre(self, motion: Motion) -> tuple[Any, Any]:
        """From B's origin to the centre of mass of craft and rod in W, m, and its derivative, m/s."""
        reach = self.fraction * self.length
        away = (motion.rod - self.rest).scale(reach)
        speed = (motion.moving - motion.spin.cross(self.rest)).scale(reach)
        return rotated(motion.attitude, away), rotated(motion.attitude, speed)

    def rates(
        self,
        load: Wrench,
        disturbance: Wrench | None,
        wheels: Vec3 | None,
        motion: Motion,
    ) -> tuple[Motion, Any]:
        """Derivatives of a motion, and the acceleration of the centre of mass of both in W, m/s^2.

        Newton's equations of the mass relative to the rigid part, and Euler's of the rigid part about its centre.
        With the arm a, the rod l e, the reduced mass m, the fraction s of the mass that swings, the rigid part's
        inertia J, the external force F and torque T about the rigid part's centre, and the force f of the rod on
        the mass:

            m (a + l e)'' = f - s F,   J w' + w x (J w + H) = T - a x f + c e x e',   f = (f.e) e - (c / l) e'.

        Here c is the friction of the hinge, e' in it the derivative as seen from the craft, and H the angular
        momentum of wheels. The tension f.e follows from the component along e of the first equation, and depends
        on w' through n = a x e alone. So w' solves (J + m n n^T) w' = t, by the formula of Sherman and Morrison.
        """
        attitude, spin = motion.attitude, motion.spin
        rod, moving = motion.rod, motion.moving
        # Force and torque about B's origin, in B.
        force, torque = load.force, load.torque
        if disturbance is not None:
            into_body: Any = attitude.inverse()
            twist = disturbance.torque
            force = force + into_body.rotate(disturbance.force)
            torque = torque + (twist if isinstance(attitude, Heading) else into_body.rotate(twist))
        force = Vec3(*in_space(force.columns()))
        torque = Vec3(*in_space((torque,) if isinstance(attitude, Heading) else torque.columns()))

        # Friction, and acceleration of the hinge by the spin alone.
        slip = moving - spin.cross(rod)
        drag = slip.scale(-self.damping / self.length)
        inwards = spin.cross(spin.cross(self.arm))

        # Angular acceleration of the craft.
        held = symmetric_times(self.inertia, spin)
        if wheels is not None:
            held = held + wheels
        lever = self.arm.cross(rod)
        tension = (rod.dot(inwards) - moving.dot(moving) * self.length) * self.reduced
        tension = tension + rod.dot(force) * self.fraction
        turning = torque + self.to_origin.cross(force) - spin.cross(held)
        turning = turning + rod.cross(slip).scale(self.damping) - self.arm.cross(drag)
        turning = turning - lever.scale(tension)
        freely = symmetric_times(self.mobility, turning)
        of_lever = symmetric_times(self.mobility, lever)
        along = self.reduced * lever.dot(freely) / (1.0 + self.reduced * lever.dot(of_lever))
        spin_up = freely - of_lever.scale(along)

        # Acceleration of the rod's direction: across it from the forces, and along it because its length is 1.
        pulled = (drag - force.scale(self.fraction)).scale(1.0 / self.reduced)
        pulled = pulled - inwards - spin_up.cross(self.arm)
        across = (pulled - rod.scale(rod.dot(pulled))).scale(1.0 / self.length)
        bending = across - rod.scale(moving.dot(moving))

        derivative = Motion(_turning(attitude, spin), spin_up, slip, bending - spin.cross(moving))
        return derivative, rotated(attitude, force.scale(1.0 / self.mass))


def in_space(columns: Sequence[Field]) -> tuple[Field, ...]:
    """Components in space of a vector: of one in the plane, or of an angular velocity or torque about z."""
    if len(columns) == 3:
        return tuple(columns)
    return (0.0, 0.0, *columns) if len(columns) == 1 else (*columns, 0.0)


def rotated(attitude: Quat | Heading, v: Vec3) -> Any:
    """A vector of B in W; in the plane without its z."""
    return attitude.rotate(Vec2(v.x, v.y)) if isinstance(attitude, Heading) else attitude.rotate(v)


def _turning(attitude: Quat | Heading, spin: Vec3) -> Quat | Heading:
    """Derivative of an attitude: a quaternion's is half its product with the spin."""
    if isinstance(attitude, Heading):
        return Heading(spin.z)
    vector = Vec3(attitude.x, attitude.y, attitude.z)
    turn = (spin.scale(attitude.w) + vector.cross(spin)).scale(0.5)
    return Quat(vector.dot(spin) * -0.5, *turn.columns())
