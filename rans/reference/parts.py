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
from pydrake.multibody.tree import RotationalInertia, SpatialInertia
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from rans.errors import ConfigError
from rans.model.actuators import Wheel
from rans.model.body import Body
from rans.model.drift import ClohessyWiltshire, Drift, FreeFlight, UniformGravity
from rans.model.spacecraft import Spacecraft, Thruster


def designed(craft: Spacecraft) -> Body:
    """The body of a spacecraft as its author describes it: read here, not by those who are judged."""
    tensor = np.array(craft.inertia)
    count = craft.thruster_count
    moments = (tensor[2, 2],) if craft.dimension == 2 else tuple(tensor[np.triu_indices(3)])
    return Body(craft.mass, moments, (0.0,) * craft.dimension, (1.0,) * count, (0.0,) * count)


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
    try:
        return SpatialInertia.MakeFromCentralInertia(
            mass, centre_of_mass(craft, body, index), _rotational(tensor)
        )
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
    if not isinstance(drift, FreeFlight | ClohessyWiltshire):
        raise ConfigError(
            "Drake knows free flight, uniform gravity and Clohessy-Wiltshire frames, got "
            f"{drift!r}."
        )
    return np.zeros(3)


class OrbitForces(LeafSystem):
    """Adds the pseudo-forces of a Hill frame, at every spacecraft's present place and velocity.

    They are m (3 n^2 x + 2 n v_y, -2 n v_x, -n^2 z), for x radial, y along the track, z across.

    The mean motion n is in rad/s, the input of masses (N,) in kg. Places (N, 2 or 3) tell where each spacecraft's
    place stands among the plant's positions, speeds (N, 2 or 3) where its velocity stands among the
    velocities, and its force among the generalised forces. The plant has so many positions, and a count of
    velocities.
    """

    def __init__(
        self,
        mean_motion: float,
        mountings: np.ndarray,
        speeds: np.ndarray,
        positions: int,
        count: int,
    ) -> None:
        super().__init__()
        self._n = mean_motion
        self._positions = positions
        self._places = mountings
        self._speeds = speeds
        self.state = self.DeclareVectorInputPort("state", positions + count)
        self.masses = self.DeclareVectorInputPort("masses", len(mountings))
        self.others = self.DeclareVectorInputPort("others", count)
        self.total = self.DeclareVectorOutputPort("total", count, self._pull)

    def _pull(self, context: Context, output: BasicVector) -> None:
        n = self._n
        state = np.array(self.state.Eval(context))
        total = np.array(self.others.Eval(context))
        masses = np.array(self.masses.Eval(context))
        position = state[self._places]
        speed = state[self._positions + self._speeds]
        pull = np.zeros_like(position)
        pull[:, 0] = 3.0 * n * n * position[:, 0] + 2.0 * n * speed[:, 1]
        pull[:, 1] = -2.0 * n * speed[:, 0]
        pull[:, 2:] = -n * n * position[:, 2:]
        total[self._speeds] += masses[:, None] * pull
        output.SetFromVector(total)
