"""Motion of a craft with a pendulum inside, which is the equivalent of a sloshing liquid."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from rans.effectors import spherical
from rans.effectors.effector import Action, Begun, Effector
from rans.effectors.spherical import Motion, SphericalPair
from rans.errors import ConfigError
from rans.model.body import Body
from rans.model.drift import Drift
from rans.model.dynamics import NODES, PlanarState, SpatialState, Wrench
from rans.model.fields import Field, Heading, Vec2, Vec3, cos, map_leaves, sin, wrap
from rans.model.slosh import Slosh
from rans.model.spacecraft import CommandRange, Spacecraft, Store

_USUAL_SPIN = 1.0
"""Spin of a craft that steps are chosen for, rad/s: as in `rans.model.accuracy`."""
_STEP = 0.1
"""Longest step, as the angle turned at the fastest usual rate, rad: 10 s of restless flight are then within 2e-7 m
and 3e-7 rad of Drake, and the rod within 1e-6 rad."""
_DECAY = 1.0
"""Longest step times the rate at which friction stops the rod; the method is stable up to 2.78."""
_STABLE = 2.5
"""Longest step times this rate under factors on mass and damping."""
_MOST_STEPS = 64
"""Largest number of steps in a piece of a control period, which bounds the length of generated programs."""


@dataclass(frozen=True)
class Pendulum(Effector):
    """Sloshing liquid as an effector: its states are where the rod points relative to the craft, and its rate."""

    slosh: Slosh
    craft: Spacecraft
    stores_of_rod: tuple[Store, ...]

    @property
    def commands(self) -> tuple[CommandRange, ...]:
        """No commands."""
        return ()

    @property
    def stores(self) -> tuple[Store, ...]:
        """Plane: angle of the rod, rad, and its rate, rad/s. Space: unit vector in B and its rate, 1/s."""
        return self.stores_of_rod

    def begin(self, begun: Begun) -> Action:
        """Action over a control period: it moves craft and rod together (`Swinging.advance`)."""
        kind = SwingingInThePlane if self.craft.dimension == 2 else SwingingInSpace
        return kind(self, begun.stores, begun.body)


class Pair(NamedTuple):
    """Craft without the mass that swings, and this mass: constants of their motion."""

    share: Any
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
    damping: Field
    """Friction of the hinge, N m s."""

    @classmethod
    def of(cls, slosh: Slosh, craft: Spacecraft, body: Body) -> Pair:
        """Constants of a body, whose factors apply to the fraction that swings of the designed craft."""
        share = spherical.swinging(slosh, craft, body)
        ratio = share / (1.0 - share)
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
        reduced = body.mass * (share * (1.0 - share))
        return cls(
            share,
            body.mass,
            arm,
            (u, v),
            length,
            rigid + reduced * (arm[0] * arm[0] + arm[1] * arm[1]),
            reduced * length**2,
            reduced * length,
            spherical.friction(slosh, body),
        )


class Swinging(Action):
    """Action of the pendulum over a control period."""

    def __init__(self, pendulum: Pendulum, stores: Sequence[Field], _: Body) -> None:
        self._stores = tuple(stores)
        self._pace, self._decay = paces(pendulum.slosh, pendulum.craft)

    def stores(self, time: Field) -> tuple[Field, ...]:
        """States of the pendulum after the parts of the period so far."""
        return self._stores

    def steps(self, longest: float) -> int:
        """Number of integration steps in a part of the period that lasts so long at most, s."""
        return _steps(longest, self._pace, self._decay)

    @abstractmethod
    def advance(
        self,
        state: Any,
        applied: Wrench,
        body: Body,
        duration: Field,
        steps: int = 1,
        nodes: int = NODES,
        disturbance: Wrench | None = None,
        drift: Drift | None = None,
        last: Wrench | None = None,
        momentum: tuple[Vec3, Vec3] | None = None,
        *_: Any,
    ) -> Any:
        """State after a wrench has acted for a duration; arguments as of `rans.model.dynamics.advance`."""


class SwingingInThePlane(Swinging):
    """Action of a pendulum that turns in the plane."""

    def __init__(self, pendulum: Pendulum, stores: Sequence[Field], body: Body) -> None:
        super().__init__(pendulum, stores, body)
        self._pair = Pair.of(pendulum.slosh, pendulum.craft, body)

    def advance(
        self,
        state: PlanarState,
        applied: Wrench,
        body: Body,
        duration: Field,
        steps: int = 1,
        nodes: int = NODES,
        disturbance: Wrench | None = None,
        drift: Drift | None = None,
        last: Wrench | None = None,
        *_: Any,
    ) -> PlanarState:
        """State after a wrench has acted for a duration; arguments as of `rans.model.dynamics.advance`.

        Runge-Kutta steps of order four for the heading, the direction of the rod, and the centre of mass of both.
        """
        pair = self._pair
        h = duration / steps
        # Directions in W, and the centre of mass of both.
        toward = math.atan2(pair.rest[1], pair.rest[0])
        heading = state.attitude.angle
        angle, rate = self._stores
        rod = heading + (angle + toward)
        spin = state.w
        turning = spin + rate
        away, speed = _centre(pair, heading, rod, spin, turning)
        p = state.p + away
        v = state.v + speed
        change = None if last is None else map_leaves(lambda a, b: b - a, applied, last)

        def accelerations(
            heading: Field, rod: Field, spin: Field, turning: Field, elapsed: float
        ) -> tuple[Field, Field, Vec2]:
            load = applied
            if change is not None:
                load = map_leaves(lambda a, b: a + b * elapsed, applied, change)
            return _accelerations(pair, load, disturbance, (heading, rod, spin, turning))

        for k in range(steps):
            begin, middle, end = (x / steps for x in (k, k + 0.5, k + 1))
            a1, b1, c1 = accelerations(heading, rod, spin, turning, begin)
            spin_2 = spin + a1 * (0.5 * h)
            turning_2 = turning + b1 * (0.5 * h)
            a2, b2, c2 = accelerations(
                heading + spin * (0.5 * h), rod + turning * (0.5 * h), spin_2, turning_2, middle
            )
            spin_3 = spin + a2 * (0.5 * h)
            turning_3 = turning + b2 * (0.5 * h)
            a3, b3, c3 = accelerations(
                heading + spin_2 * (0.5 * h), rod + turning_2 * (0.5 * h), spin_3, turning_3, middle
            )
            a4, b4, c4 = accelerations(
                heading + spin_3 * h,
                rod + turning_3 * h,
                spin + a3 * h,
                turning + b3 * h,
                end,
            )
            heading = heading + (spin + (a1 + a2 + a3) * (h * (1.0 / 6.0))) * h
            rod = rod + (turning + (b1 + b2 + b3) * (h * (1.0 / 6.0))) * h
            spin = spin + (a1 + (a2 + a3) * 2.0 + a4) * (h * (1.0 / 6.0))
            turning = turning + (b1 + (b2 + b3) * 2.0 + b4) * (h * (1.0 / 6.0))
            # The centre of mass drifts as a free point does, and the forces come on top.
            moved = (c1 + c2 + c3).scale(h * h * (1.0 / 6.0))
            gained = (c1 + (c2 + c3).scale(2.0) + c4).scale(h * (1.0 / 6.0))
            p, v = (p + v.scale(h), v) if drift is None else drift.carry(p, v, h)
            p = p + moved
            v = v + gained
        away, speed = _centre(pair, heading, rod, spin, turning)
        self._stores = (wrap(rod - heading - toward), turning - spin)
        return PlanarState(p - away, Heading(heading), v - speed, spin)


class SwingingInSpace(Swinging):
    """Action of a pendulum that turns about its hinge in every direction."""

    def __init__(self, pendulum: Pendulum, stores: Sequence[Field], body: Body) -> None:
        super().__init__(pendulum, stores, body)
        self._pair = SphericalPair.of(pendulum.slosh, pendulum.craft, body)

    def advance(
        self,
        state: SpatialState,
        applied: Wrench,
        body: Body,
        duration: Field,
        steps: int = 1,
        nodes: int = NODES,
        disturbance: Wrench | None = None,
        drift: Drift | None = None,
        last: Wrench | None = None,
        momentum: tuple[Vec3, Vec3] | None = None,
        *_: Any,
    ) -> SpatialState:
        """State after a wrench has acted for a duration; arguments as of `rans.model.dynamics.advance`."""
        h = duration / steps
        rod, slip = Vec3(*self._stores[:3]), Vec3(*self._stores[3:])
        motion = Motion(state.attitude, state.w, rod, slip + state.w.cross(rod))
        away, speed = spherical.centre(self._pair, motion)
        p = state.p + away
        v = state.v + speed
        change = None if last is None else map_leaves(lambda a, b: b - a, applied, last)

        def rates(now: Motion, elapsed: float) -> tuple[Motion, Vec3]:
            load = applied
            if change is not None:
                load = map_leaves(lambda a, b: a + b * elapsed, applied, change)
            wheels = None if momentum is None else momentum[0] + momentum[1].scale(elapsed)
            return spherical.rates(self._pair, load, disturbance, wheels, now)

        for k in range(steps):
            begin, middle, end = (x / steps for x in (k, k + 0.5, k + 1))
            one, c1 = rates(motion, begin)
            two, c2 = rates(motion.after(one, 0.5 * h), middle)
            three, c3 = rates(motion.after(two, 0.5 * h), middle)
            four, c4 = rates(motion.after(three, h), end)
            mean = map_leaves(
                lambda a, b, c, d: (a + (b + c) * 2.0 + d) * (1.0 / 6.0), one, two, three, four
            )
            motion = motion.after(mean, h)
            p, v = (p + v.scale(h), v) if drift is None else drift.carry(p, v, h)
            p = p + (c1 + c2 + c3).scale(h * h * (1.0 / 6.0))
            v = v + (c1 + (c2 + c3).scale(2.0) + c4).scale(h * (1.0 / 6.0))

        # The rod has a constant length, and turns about the hinge only.
        rod = motion.rod.scale(1.0 / motion.rod.norm())
        slip = motion.moving - motion.spin.cross(rod)
        slip = slip - rod.scale(slip.dot(rod))
        self._stores = (*rod.columns(), *slip.columns())
        attitude = motion.attitude.normalised()
        motion = Motion(attitude, motion.spin, rod, slip + motion.spin.cross(rod))
        away, speed = spherical.centre(self._pair, motion)
        return SpatialState(p - away, attitude, v - speed, motion.spin)


def _centre(
    pair: Pair, heading: Field, rod: Field, spin: Field, turning: Field
) -> tuple[Vec2, Vec2]:
    """From B's origin to the centre of mass of craft and rod in W, m, and its derivative, m/s."""
    reach = pair.share * pair.length
    c, s = cos(heading), sin(heading)
    u, v = pair.rest
    rest_x, rest_y = c * u - s * v, s * u + c * v
    x, y = cos(rod), sin(rod)
    away = Vec2((x - rest_x) * reach, (y - rest_y) * reach)
    return away, Vec2((rest_y * spin - y * turning) * reach, (x * turning - rest_x * spin) * reach)


def _accelerations(
    pair: Pair, load: Wrench, disturbance: Wrench | None, motion: tuple[Field, Field, Field, Field]
) -> tuple[Field, Field, Vec2]:
    """Angular accelerations of craft and rod, rad/s^2, and the acceleration of their centre of mass in W, m/s^2.

    Lagrange's equations of the heading a and the direction b of the rod in W, about the centre of mass of both:

        A a'' + B cos(d) b'' = Q_a + B sin(d) b'^2,   B cos(d) a'' + C b'' = Q_b - B sin(d) a'^2,

    with the angle d from the arm to the rod. Forces act at B's origin, which moves with both angles.
    """
    heading, rod, spin, turning = motion
    c, s = cos(heading), sin(heading)
    x, y = cos(rod), sin(rod)
    # Force in W and torque about B's origin.
    fx = c * load.force.x - s * load.force.y
    fy = s * load.force.x + c * load.force.y
    torque = load.torque
    if disturbance is not None:
        fx = fx + disturbance.force.x
        fy = fy + disturbance.force.y
        torque = torque + disturbance.torque
    # Generalised forces.
    reach = pair.share * pair.length
    u, v = pair.rest
    rest_x, rest_y = c * u - s * v, s * u + c * v
    friction = (turning - spin) * pair.damping
    of_heading = torque + (rest_x * fy - rest_y * fx) * reach + friction
    of_rod = (y * fx - x * fy) * reach - friction
    # Inertia that couples both, and centrifugal terms.
    arm_x, arm_y = pair.arm
    ahead_x, ahead_y = c * arm_x - s * arm_y, s * arm_x + c * arm_y
    along = (ahead_x * x + ahead_y * y) * pair.coupling
    across = (ahead_x * y - ahead_y * x) * pair.coupling
    first = of_heading + across * turning * turning
    second = of_rod - across * spin * spin
    scale = 1.0 / (pair.of_craft * pair.of_rod - along * along)
    return (
        (first * pair.of_rod - second * along) * scale,
        (second * pair.of_craft - first * along) * scale,
        Vec2(fx, fy).scale(1.0 / pair.mass),
    )


def paces(slosh: Slosh, craft: Spacecraft) -> tuple[float, float]:
    """Fastest usual rate of craft and rod, and rate at which friction stops the rod, rad/s and 1/s."""
    arm, of_craft, reduced = _heaviest(slosh, craft)
    # Half of the thrusters push together at most; the centrifugal field of the arm acts as gravity too.
    pull = 0.5 * sum(thruster.force for thruster in craft.thrusters) / craft.mass
    pull += _USUAL_SPIN**2 * arm
    pace = max(_USUAL_SPIN, math.sqrt(pull / slosh.length))
    of_rod = reduced * slosh.length**2
    along = reduced * slosh.length * arm
    mobility = (of_craft + of_rod + 2.0 * along) / (of_craft * of_rod - along**2)
    return pace, slosh.damping * mobility


def _heaviest(slosh: Slosh, craft: Spacecraft) -> tuple[float, float, float]:
    """Length of the arm, least inertia of the craft with the rod's end in the hinge, and reduced mass; SI."""
    body = Body.of(craft)
    if craft.dimension == 2:
        pair = Pair.of(slosh, craft, body)
        return math.hypot(*pair.arm), pair.of_craft, pair.coupling / pair.length
    pair = SphericalPair.of(slosh, craft, body)
    xx, xy, xz, yy, yz, zz = pair.inertia
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    arm = math.hypot(*pair.arm.columns())
    return arm, float(np.linalg.eigvalsh(tensor)[0]) + pair.reduced * arm**2, pair.reduced


def _steps(longest: float, pace: float, decay: float) -> int:
    """Number of integration steps in a time, s, at the rates of `paces`."""
    needed = max(math.ceil(longest * pace / _STEP - 1e-9), math.ceil(longest * decay / _DECAY))
    return min(needed, _MOST_STEPS)


def check_slosh(
    craft: Spacecraft, drift: Drift, period: float, mass: float = 1.0, damping: float = 1.0
) -> None:
    """Refuse drifts, control periods and conditions for which the motion of a pendulum is not computed.

    Args:
        craft: any; one without `Spacecraft.slosh` passes.
        drift: motion of a free point.
        period: control period, s.
        mass: least factor on the mass that swings.
        damping: largest factor on the damping.

    Raises:
        ConfigError: an orbit pulls, or friction stops the rod too fast for the control period.
    """
    if craft.slosh is None:
        return
    if not drift.in_straight_lines:
        raise ConfigError(
            f"spacecraft {craft.name!r} has [slosh], which is computed in free flight and uniform gravity only, "
            f"and the task's drift is {drift.name}: take [slosh] out of its file for missions on an orbit."
        )
    pace, decay = paces(craft.slosh, craft)
    if period * decay / _DECAY > _MOST_STEPS:
        limit = craft.slosh.damping * _MOST_STEPS * _DECAY / (period * decay)
        raise ConfigError(
            f"spacecraft {craft.name!r}: slosh damping must be at most {limit:.3g} N m s at a control period of "
            f"{period:g} s, got {craft.slosh.damping:g}: the rod would stop within {1 / decay:.2g} s. The usual "
            "cause is a damping ratio in its place."
        )
    # Steps are those of the designed craft.
    extreme = replace(
        craft.slosh, mass=mass * craft.slosh.mass, damping=damping * craft.slosh.damping
    )
    step = period / max(_steps(period, pace, decay), 1)
    if step * paces(extreme, craft)[1] > _STABLE:
        raise ConfigError(
            f"Conditions of body.slosh_mass from {mass:g} and body.slosh_damping up to {damping:g} stop the rod of "
            f"{craft.name!r} within {1 / paces(extreme, craft)[1]:.2g} s, too fast for steps of {step:.2g} s: "
            "raise the damping in the spacecraft's file, and draw factors below 1."
        )
