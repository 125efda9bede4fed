"""Equations of a craft and a pendulum inside, the equivalent of a sloshing liquid: in the plane and in space.

Each kind of pair has a motion, whose derivative is a motion too, and the same methods:
`rans_missions.slosh.swinging.Swinging` integrates both alike. `rans_missions.slosh.rods` gives Drake the same
bodies without these equations, and a Lagrangian of SciPy's tests both.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

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
    cos,
    sin,
)
from rans.model.fields import wrap
from rans.model.rotation import symmetric_inverse, symmetric_times

if TYPE_CHECKING:
    from rans_missions.slosh.liquid import Slosh


@dataclass(frozen=True)
class PlanarMotion:
    """Directions and angular velocities of craft and rod in W; or their derivatives by time."""

    heading: Field
    """Heading of the craft, rad."""
    rod: Field
    """Direction of the rod, rad."""
    spin: Field
    """Angular velocity of the craft, rad/s."""
    turning: Field
    """Angular velocity of the rod, rad/s."""


@dataclass(frozen=True)
class SphericalMotion:
    """Attitude and spin of the craft, and direction and velocity of the rod; or their derivatives by time."""

    attitude: Quat
    spin: Vec3
    """Angular velocity in B, rad/s."""
    rod: Vec3
    """Unit vector from the hinge to the mass, in B."""
    moving: Vec3
    """Derivative of this vector as seen from W, expressed in B, 1/s."""


class PlanarPair(NamedTuple):
    """Craft without the mass that swings, and this mass: constants of their motion in the plane."""

    fraction: float
    """Mass that swings over the mass of both."""
    mass: Field
    """Mass of both, kg."""
    arm: tuple[Field, Field]
    """From the rigid part's centre of mass to the hinge, in B, m."""
    rest: tuple[float, float]
    """Unit vector from the hinge to the mass where the angle is zero, in B."""
    length: float
    """Length of the rod, m."""
    of_craft: Field
    """Moment of inertia that the spin of the craft has, with the rod's end in the hinge, kg m^2."""
    of_rod: Field
    """Moment of inertia that the spin of the rod has, kg m^2."""
    coupling: Field
    """Reduced mass times the length of the rod, kg m."""
    damping: float
    """Friction of the hinge, N m s."""

    @classmethod
    def of(cls, slosh: Slosh, craft: Spacecraft, body: Body) -> PlanarPair:
        """Constants of a body, of which the same fraction swings as of the designed craft.

        The craft's mass and inertia have the liquid at rest in them, which is taken out here.
        """
        fraction = slosh.mass / craft.mass
        ratio = fraction / (1.0 - fraction)
        x, y = (
            h - c - offset
            for h, c, offset in zip(
                slosh.hinge[:2], craft.centre_of_mass[:2], body.centre or (0.0, 0.0), strict=True
            )
        )
        u, v = slosh.direction[:2]
        length = slosh.length
        # The mass at rest, and opposite to it the centre of the rigid part; B's origin is between them.
        at_x, at_y = x + length * u, y + length * v
        rigid = body.inertia[0] - body.mass * (ratio * (at_x * at_x + at_y * at_y))
        arm = (x + ratio * at_x, y + ratio * at_y)
        reduced = body.mass * (fraction * (1.0 - fraction))
        return cls(
            fraction,
            body.mass,
            arm,
            (u, v),
            length,
            rigid + reduced * (arm[0] * arm[0] + arm[1] * arm[1]),
            reduced * length**2,
            reduced * length,
            slosh.damping,
        )

    @property
    def _toward(self) -> float:
        """Direction of the rod in B where its angle is zero, rad."""
        return math.atan2(self.rest[1], self.rest[0])

    def begin(self, state: PlanarState, stores: Sequence[Field]) -> PlanarMotion:
        """Motion of a state, and of the rod's angle, rad, and rate, rad/s, relative to the craft."""
        angle, rate = stores
        heading = state.attitude.angle
        return PlanarMotion(heading, heading + (angle + self._toward), state.w, state.w + rate)

    def end(self, motion: PlanarMotion) -> tuple[PlanarMotion, tuple[Field, ...]]:
        """The motion after a part of a control period, and angle and rate of the rod."""
        angle = wrap(motion.rod - motion.heading - self._toward)
        return motion, (angle, motion.turning - motion.spin)

    def state(self, p: Vec2, v: Vec2, motion: PlanarMotion) -> PlanarState:
        """State of the craft with this position and velocity of B."""
        return PlanarState(p, Heading(motion.heading), v, motion.spin)

    def centre(self, motion: PlanarMotion) -> tuple[Vec2, Vec2]:
        """From B's origin to the centre of mass of craft and rod in W, m, and its derivative, m/s."""
        reach = self.fraction * self.length
        c, s = cos(motion.heading), sin(motion.heading)
        u, v = self.rest
        rest_x, rest_y = c * u - s * v, s * u + c * v
        x, y = cos(motion.rod), sin(motion.rod)
        away = Vec2((x - rest_x) * reach, (y - rest_y) * reach)
        spin, turning = motion.spin, motion.turning
        speed = Vec2(rest_y * spin - y * turning, x * turning - rest_x * spin).scale(reach)
        return away, speed

    def rates(
        self, load: Wrench, disturbance: Wrench | None, _: object, motion: PlanarMotion
    ) -> tuple[PlanarMotion, Vec2]:
        """Derivatives of a motion, and the acceleration of the centre of mass of both in W, m/s^2.

        Lagrange's equations of the heading a and the direction b of the rod in W, about the centre of mass of both:

            A a'' + B cos(d) b'' = Q_a + B sin(d) b'^2,   B cos(d) a'' + C b'' = Q_b - B sin(d) a'^2,

        with the angle d from the arm to the rod. Forces act at B's origin, which moves with both angles.
        """
        spin, turning = motion.spin, motion.turning
        c, s = cos(motion.heading), sin(motion.heading)
        x, y = cos(motion.rod), sin(motion.rod)
        # Force in W and torque about B's origin.
        fx = c * load.force.x - s * load.force.y
        fy = s * load.force.x + c * load.force.y
        torque = load.torque
        if disturbance is not None:
            fx = fx + disturbance.force.x
            fy = fy + disturbance.force.y
            torque = torque + disturbance.torque
        # Generalised forces.
        reach = self.fraction * self.length
        u, v = self.rest
        rest_x, rest_y = c * u - s * v, s * u + c * v
        friction = (turning - spin) * self.damping
        of_heading = torque + (rest_x * fy - rest_y * fx) * reach + friction
        of_rod = (y * fx - x * fy) * reach - friction
        # Inertia that couples both, and centrifugal terms.
        arm_x, arm_y = self.arm
        ahead_x, ahead_y = c * arm_x - s * arm_y, s * arm_x + c * arm_y
        along = (ahead_x * x + ahead_y * y) * self.coupling
        across = (ahead_x * y - ahead_y * x) * self.coupling
        first = of_heading + across * turning * turning
        second = of_rod - across * spin * spin
        scale = 1.0 / (self.of_craft * self.of_rod - along * along)
        spin_up = (first * self.of_rod - second * along) * scale
        turn_up = (second * self.of_craft - first * along) * scale
        derivative = PlanarMotion(spin, turning, spin_up, turn_up)
        return derivative, Vec2(fx, fy).scale(1.0 / self.mass)


class SphericalPair(NamedTuple):
    """Craft without the mass that swings, and this mass: constants of their motion in space."""

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
    def of(cls, slosh: Slosh, craft: Spacecraft, body: Body) -> SphericalPair:
        """Constants of a body, of which the same fraction swings as of the designed craft.

        The craft's mass and inertia have the liquid at rest in them, which is taken out here.
        """
        fraction = slosh.mass / craft.mass
        ratio = fraction / (1.0 - fraction)
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

    def begin(self, state: SpatialState, stores: Sequence[Field]) -> SphericalMotion:
        """Motion of a state, and of the rod's unit vector in B and its derivative as seen from B, 1/s."""
        rod, slip = Vec3(*stores[:3]), Vec3(*stores[3:])
        return SphericalMotion(state.attitude, state.w, rod, slip + state.w.cross(rod))

    def end(self, motion: SphericalMotion) -> tuple[SphericalMotion, tuple[Field, ...]]:
        """The motion after a part of a control period, with a rod of constant length, and the rod as in `begin`."""
        rod = motion.rod.scale(1.0 / motion.rod.norm())
        slip = motion.moving - motion.spin.cross(rod)
        slip = slip - rod.scale(slip.dot(rod))
        moving = slip + motion.spin.cross(rod)
        after = SphericalMotion(motion.attitude.normalised(), motion.spin, rod, moving)
        return after, (*rod.columns(), *slip.columns())

    def state(self, p: Vec3, v: Vec3, motion: SphericalMotion) -> SpatialState:
        """State of the craft with this position and velocity of B."""
        return SpatialState(p, motion.attitude, v, motion.spin)

    def centre(self, motion: SphericalMotion) -> tuple[Vec3, Vec3]:
        """From B's origin to the centre of mass of craft and rod in W, m, and its derivative, m/s."""
        reach = self.fraction * self.length
        away = (motion.rod - self.rest).scale(reach)
        speed = (motion.moving - motion.spin.cross(self.rest)).scale(reach)
        return motion.attitude.rotate(away), motion.attitude.rotate(speed)

    def rates(
        self,
        load: Wrench,
        disturbance: Wrench | None,
        wheels: Vec3 | None,
        motion: SphericalMotion,
    ) -> tuple[SphericalMotion, Vec3]:
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
        force: Any = load.force
        torque = load.torque
        if disturbance is not None:
            into_body = attitude.inverse()
            push: Any = disturbance.force
            force = force + into_body.rotate(push)
            torque = torque + into_body.rotate(disturbance.torque)

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

        # The quaternion's derivative is half its product with the spin.
        vector = Vec3(attitude.x, attitude.y, attitude.z)
        turn = (spin.scale(attitude.w) + vector.cross(spin)).scale(0.5)
        quaternion = Quat(vector.dot(spin) * -0.5, *turn.columns())
        derivative = SphericalMotion(quaternion, spin_up, slip, bending - spin.cross(moving))
        return derivative, attitude.rotate(force).scale(1.0 / self.mass)
