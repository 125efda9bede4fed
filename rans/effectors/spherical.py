"""Motion of a craft in space with a spherical pendulum inside, the equivalent of a sloshing liquid."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from rans.model.body import Body
from rans.model.dynamics import Wrench
from rans.model.fields import Field, Quat, Vec3, map_leaves
from rans.model.rotation import symmetric_inverse, symmetric_times
from rans.model.slosh import Slosh
from rans.model.spacecraft import Spacecraft


class SphericalPair(NamedTuple):
    """Craft without the mass that swings, and this mass: constants of their motion in space."""

    share: Field
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
    damping: Field
    """Friction of the hinge, N m s."""

    @classmethod
    def of(cls, slosh: Slosh, craft: Spacecraft, body: Body) -> SphericalPair:
        """Constants of a body, whose factors apply to the fraction that swings of the designed craft."""
        share = swinging(slosh, craft, body)
        ratio = share / (1.0 - share)
        shift = body.centre or (0.0, 0.0, 0.0)
        hinge = Vec3(
            *(h - c - s for h, c, s in zip(slosh.hinge, craft.centre_of_mass, shift, strict=True))
        )
        rest = Vec3(*slosh.direction)
        # The mass at rest, and opposite to it the centre of the rigid part; B's origin is between them.
        at = hinge + rest.scale(slosh.length)
        to_origin = at.scale(ratio)
        x, y, z = at.columns()
        adds = (y * y + z * z, -x * y, -x * z, x * x + z * z, -y * z, x * x + y * y)
        scale = body.mass * ratio
        inertia = tuple(i - scale * a for i, a in zip(body.inertia, adds, strict=True))
        return cls(
            share,
            body.mass,
            to_origin,
            hinge + to_origin,
            rest,
            slosh.length,
            inertia,
            symmetric_inverse(inertia),
            body.mass * (share * (1.0 - share)),
            friction(slosh, body),
        )


def swinging(slosh: Slosh, craft: Spacecraft, body: Body) -> Field:
    """Fraction of a body's mass that swings."""
    share = slosh.mass / craft.mass
    return share if body.slosh_mass is None else body.slosh_mass * share


def friction(slosh: Slosh, body: Body) -> Field:
    """Friction of the hinge of a body, N m s."""
    return slosh.damping if body.slosh_damping is None else body.slosh_damping * slosh.damping


@dataclass(frozen=True)
class Motion:
    """Attitude and spin of the craft, and direction and velocity of the rod; or their derivatives by time."""

    attitude: Quat
    spin: Vec3
    """Angular velocity in B, rad/s."""
    rod: Vec3
    """Unit vector from the hinge to the mass, in B."""
    moving: Vec3
    """Derivative of this vector as seen from W, expressed in B, 1/s."""

    def after(self, rates: Motion, time: Field) -> Motion:
        """The motion after a time (s) with constant derivatives."""
        return map_leaves(lambda x, rate: x + rate * time, self, rates)


def centre(pair: SphericalPair, motion: Motion) -> tuple[Vec3, Vec3]:
    """From B's origin to the centre of mass of craft and rod in W, m, and its derivative, m/s."""
    reach = pair.share * pair.length
    away = (motion.rod - pair.rest).scale(reach)
    speed = (motion.moving - motion.spin.cross(pair.rest)).scale(reach)
    return motion.attitude.rotate(away), motion.attitude.rotate(speed)


def rates(
    pair: SphericalPair,
    load: Wrench,
    disturbance: Wrench | None,
    wheels: Vec3 | None,
    motion: Motion,
) -> tuple[Motion, Vec3]:
    """Derivatives of a motion, and the acceleration of the centre of mass of both in W, m/s^2.

    Newton's equations of the mass relative to the rigid part, and Euler's of the rigid part about its centre. With
    the arm a, the rod l e, the reduced mass m, the fraction s of the mass that swings, the rigid part's inertia J,
    the external force F and torque T about the rigid part's centre, and the force f of the rod on the mass:

        m (a + l e)'' = f - s F,   J w' + w x (J w + H) = T - a x f + c e x e',   f = (f.e) e - (c / l) e'.

    Here c is the friction of the hinge, e' in it the derivative as seen from the craft, and H the angular momentum
    of wheels. The tension f.e follows from the component along e of the first equation, and depends on w' through
    n = a x e alone. So w' solves (J + m n n^T) w' = t, by the formula of Sherman and Morrison.
    """
    attitude, spin = motion.attitude, motion.spin
    rod, moving = motion.rod, motion.moving
    # Force and torque about B's origin, in B.
    force, torque = load.force, load.torque
    if disturbance is not None:
        into_body = attitude.inverse()
        force = force + into_body.rotate(disturbance.force)
        torque = torque + into_body.rotate(disturbance.torque)

    # Friction, and acceleration of the hinge by the spin alone.
    slip = moving - spin.cross(rod)
    drag = slip.scale(-pair.damping / pair.length)
    inwards = spin.cross(spin.cross(pair.arm))

    # Angular acceleration of the craft.
    held = symmetric_times(pair.inertia, spin)
    if wheels is not None:
        held = held + wheels
    lever = pair.arm.cross(rod)
    tension = (rod.dot(inwards) - moving.dot(moving) * pair.length) * pair.reduced
    tension = tension + rod.dot(force) * pair.share
    turning = torque + pair.to_origin.cross(force) - spin.cross(held)
    turning = turning + rod.cross(slip).scale(pair.damping) - pair.arm.cross(drag)
    turning = turning - lever.scale(tension)
    freely = symmetric_times(pair.mobility, turning)
    of_lever = symmetric_times(pair.mobility, lever)
    along = pair.reduced * lever.dot(freely) / (1.0 + pair.reduced * lever.dot(of_lever))
    spin_up = freely - of_lever.scale(along)

    # Acceleration of the rod's direction: what is across it follows from the forces, and the rest from its length.
    pulled = (drag - force.scale(pair.share)).scale(1.0 / pair.reduced)
    pulled = pulled - inwards - spin_up.cross(pair.arm)
    across = (pulled - rod.scale(rod.dot(pulled))).scale(1.0 / pair.length)
    bending = across - rod.scale(moving.dot(moving))

    # The quaternion's derivative is half its product with the spin.
    vector = Vec3(attitude.x, attitude.y, attitude.z)
    turn = (spin.scale(attitude.w) + vector.cross(spin)).scale(0.5)
    quaternion = Quat(vector.dot(spin) * -0.5, *turn.columns())
    derivative = Motion(quaternion, spin_up, slip, bending - spin.cross(moving))
    return derivative, attitude.rotate(force).scale(1.0 / pair.mass)
