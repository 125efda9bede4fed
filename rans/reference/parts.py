"""Parts of the reference plant: inertias, nozzles, and the pull of an orbit.

Like the plant it takes nothing of RANS but descriptions: values that say what there is, not how it moves.
"""

# Drake's stubs write NumPy's array types with their two parameters exchanged.
# pyright: reportArgumentType=false, reportCallIssue=false

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.tree import RotationalInertia, SpatialInertia, UnitInertia
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from rans.errors import ConfigError
from rans.model.actuators import Wheel
from rans.model.body import Body
from rans.model.drift import ClohessyWiltshire, Drift, EllipticOrbit, FreeFlight, UniformGravity
from rans.model.spacecraft import Spacecraft, Thruster


def designed(craft: Spacecraft) -> Body:
    """The body of a spacecraft as its author describes it: read here, not by those who are judged."""
    tensor = np.array(craft.inertia)
    count = craft.thruster_count
    moments = (tensor[2, 2],) if craft.dimension == 2 else tuple(tensor[np.triu_indices(3)])
    return Body(craft.mass, moments, (0.0,) * craft.dimension, (1.0,) * count, (0.0,) * count)


_KEPLER_STEPS = 50
"""Steps of Newton's method for Kepler's equation; ten are enough up to an eccentricity of 0.9."""
_WHEEL_MASS = 1e-3
"""Mass of a wheel as a share of the craft's: only Drake wants one, as the wheel's stands in the craft's."""


def wheel_inertia(craft: Spacecraft, wheel: Wheel) -> SpatialInertia:
    """Thin disc of a reaction wheel at the craft's centre of mass, in a frame with G's axes and origin there."""
    axis = np.array(wheel.axis)
    tensor = 0.5 * wheel.inertia * (np.eye(3) + np.outer(axis, axis))
    return SpatialInertia.MakeFromCentralInertia(
        _WHEEL_MASS * craft.mass, np.zeros(3), _rotational(tensor)
    )


def centre_of_mass(craft: Spacecraft, body: Body, index: int) -> np.ndarray:
    """Centre of mass of one of many spacecraft, (3,) m, in G."""
    shift = np.zeros(3)
    for k, x in enumerate(body.centre):
        shift[k] = x if np.ndim(x) == 0 else x[index]
    return np.array(craft.centre_of_mass) + shift


def slosh_mass(craft: Spacecraft, body: Body, index: int) -> float:
    """Mass that swings in one of many spacecraft, kg: the same share of each."""
    assert craft.slosh is not None
    whole = body.mass if np.ndim(body.mass) == 0 else body.mass[index]
    return craft.slosh.mass * float(whole) / craft.mass


def point_mass(mass: float, position: np.ndarray) -> SpatialInertia:
    """Inertia of a point mass (kg) at a position (3,) in its body's frame, m."""
    return SpatialInertia(mass, position, UnitInertia.PointMass(position))


def _rotational(tensor: np.ndarray) -> RotationalInertia:
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = tensor
    return RotationalInertia(xx, yy, zz, xy, xz, yz)


def spatial_inertia(craft: Spacecraft, body: Body, index: int, left: float = 1.0) -> SpatialInertia:
    """Mass, centre of mass and inertia of one of many spacecraft without its wheels, in the author's frame G.

    In the plane only the moment about z counts; the others are the craft's in the same proportion. Wheels are
    bodies of their own: their masses and the moments across their axes are taken off.

    Args:
        craft: as it is described.
        body: with a full tank, each value one number or (N,).
        index: of the spacecraft.
        left: share of mass and inertia that is left when propellant is used.

    Raises:
        ConfigError: Drake refuses them.
    """

    def own(values: Iterable[Any]) -> np.ndarray:
        return np.array([x if np.ndim(x) == 0 else x[index] for x in values])

    if craft.dimension == 2:
        moments = np.array(craft.inertia)[np.triu_indices(3)] * (
            own(body.inertia) / craft.inertia[2][2]
        )
    else:
        moments = own(body.inertia)
    xx, xy, xz, yy, yz, zz = left * moments
    mass = left * own([body.mass])[0]
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    for wheel in craft.wheels:
        axis = np.array(wheel.axis)
        tensor -= 0.5 * wheel.inertia * (np.eye(3) - np.outer(axis, axis))
        mass -= _WHEEL_MASS * craft.mass
    centre = centre_of_mass(craft, body, index)
    if craft.slosh is not None:
        # The rest of the craft balances the mass that swings, both at rest.
        swings = slosh_mass(craft, body, index)
        to_mass = np.array(craft.slosh.point()) - centre
        mass -= swings
        to_rest = -swings / mass * to_mass
        for part, arm in ((swings, to_mass), (mass, to_rest)):
            tensor -= part * (arm @ arm * np.eye(3) - np.outer(arm, arm))
        centre = centre + to_rest
    try:
        return SpatialInertia.MakeFromCentralInertia(mass, centre, _rotational(tensor))
    except RuntimeError as error:
        reason = str(error).partition("\n")[0]
        raise ConfigError(
            f"spacecraft {craft.name!r}: Drake refuses its inertia {craft.inertia}: {reason}"
        ) from error


def thrust_pose(thruster: Thruster) -> RigidTransform:
    """Pose in G of a frame whose z axis is the thrust's direction."""
    R_GP = RotationMatrix.MakeFromOneVector(np.array(thruster.direction), axis_index=2)
    return RigidTransform(R_GP, np.array(thruster.position))


def mounted(craft: Spacecraft, body: Body, k: int) -> Iterator[Thruster]:
    """Thrusters of spacecraft number k where they truly are, by the errors of their mountings."""
    for number, thruster in enumerate(craft.thrusters):
        if not body.mountings:
            yield thruster
            continue
        mounting = body.mountings[number]
        # Entries are one number, or one for each spacecraft; the plane has no third.
        offset, direction = (
            np.array([np.ravel(x)[k if np.size(x) > 1 else 0] for x in (*vector, 0.0)][:3])
            for vector in (mounting.offset, mounting.direction)
        )
        position = np.array(thruster.position) + offset
        yield replace(thruster, position=tuple(position), direction=tuple(direction))


def gravity(drift: Drift) -> np.ndarray:
    """The field for Drake's own gravity, (3,) m/s^2.

    Raises:
        ConfigError: Drake is not told how this drift pulls.
    """
    if isinstance(drift, UniformGravity):
        return np.append(drift.acceleration, 0.0)[:3]
    if not isinstance(drift, FreeFlight | ClohessyWiltshire | EllipticOrbit):
        raise ConfigError(
            "Drake knows free flight, uniform gravity, Clohessy-Wiltshire frames and elliptic orbits, got "
            f"{drift!r}."
        )
    return np.zeros(3)


class OrbitForces(LeafSystem):
    """Adds the pseudo-forces of a Hill frame, at every spacecraft's present place and velocity.

    They are m ((w^2 + 2 g) x + w' y + 2 w v_y, (w^2 - g) y - w' x - 2 w v_x, -g z), for x radial, y along the
    track, z across, with the rate w of the frame and the planet's gravitational parameter over the cube of the
    radius, g. On a circle w = n, w' = 0 and g = n^2. On an ellipse they follow from Kepler's equation at the time.

    The mean motion n is in rad/s, the input of masses (N,) in kg, that of mean anomalies at time 0 (N,) in rad.
    Places (N, 2 or 3) tell where each spacecraft's place stands among the plant's positions, speeds (N, 2 or 3)
    where its velocity stands among the velocities, and its force among the generalised forces. The plant has so
    many positions, and a count of velocities.
    """

    def __init__(
        self,
        mean_motion: float,
        eccentricity: float,
        mountings: np.ndarray,
        speeds: np.ndarray,
        positions: int,
        count: int,
    ) -> None:
        super().__init__()
        self._n = mean_motion
        self._e = eccentricity
        self._positions = positions
        self._places = mountings
        self._speeds = speeds
        self.state = self.DeclareVectorInputPort("state", positions + count)
        self.masses = self.DeclareVectorInputPort("masses", len(mountings))
        self.anomalies = self.DeclareVectorInputPort("anomalies", len(mountings))
        self.others = self.DeclareVectorInputPort("others", count)
        self.total = self.DeclareVectorOutputPort("total", count, self._pull)

    def _pull(self, context: Context, output: BasicVector) -> None:
        rate, change, gravity = self._orbit(context)
        state = np.array(self.state.Eval(context))
        total = np.array(self.others.Eval(context))
        masses = np.array(self.masses.Eval(context))
        position = state[self._places]
        speed = state[self._positions + self._speeds]
        pull = np.zeros_like(position)
        x, y = position[:, 0], position[:, 1]
        pull[:, 0] = (rate**2 + 2.0 * gravity) * x + change * y + 2.0 * rate * speed[:, 1]
        pull[:, 1] = (rate**2 - gravity) * y - change * x - 2.0 * rate * speed[:, 0]
        pull[:, 2:] = -np.reshape(gravity, (-1, 1)) * position[:, 2:]
        total[self._speeds] += masses[:, None] * pull
        output.SetFromVector(total)

    def _orbit(self, context: Context) -> tuple[Any, Any, Any]:
        """Rate of the frame, rad/s, its change, rad/s^2, and gravity over the radius, 1/s^2: numbers or (N,)."""
        n, e = self._n, self._e
        if e == 0.0:
            return n, 0.0, n * n
        now = np.array(self.anomalies.Eval(context)) + n * context.get_time()
        # Kepler's equation by Newton's method, which converges from pi (Battin 1999, section 5.4).
        mean = np.mod(now, 2.0 * np.pi)
        anomaly = np.full(mean.shape, np.pi)
        for _ in range(_KEPLER_STEPS):
            step = (anomaly - e * np.sin(anomaly) - mean) / (1.0 - e * np.cos(anomaly))
            anomaly = anomaly - step
            if np.abs(step).max() < 1e-15:
                break
        radius = 1.0 - e * np.cos(anomaly)
        rate = n * np.sqrt(1.0 - e * e) / radius**2
        return rate, -2.0 * rate * n * e * np.sin(anomaly) / radius**2, n * n / radius**3
