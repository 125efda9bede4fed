"""What the judge's plant is assembled from: inertias, nozzles, and the pull of an orbit.

Like the plant it takes nothing of RANS but descriptions: values that say what there is, not how it moves.
"""

# Drake's stubs write NumPy's array types with their two parameters exchanged.
# pyright: reportArgumentType=false, reportCallIssue=false

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.tree import RotationalInertia, SpatialInertia
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from rans.errors import ConfigError
from rans.model.body import Body
from rans.model.drift import ClohessyWiltshire, Drift, FreeFlight, UniformGravity
from rans.model.spacecraft import Spacecraft, Thruster


def designed(craft: Spacecraft) -> Body:
    """The body of a spacecraft as its author describes it: read here, not by those who are judged."""
    tensor = np.array(craft.inertia)
    count = len(craft.thrusters)
    moments = (tensor[2, 2],) if craft.dimension == 2 else tuple(tensor[np.triu_indices(3)])
    return Body(craft.mass, moments, (0.0,) * craft.dimension, (1.0,) * count, (0.0,) * count)


def spatial_inertia(craft: Spacecraft, body: Body, index: int) -> SpatialInertia:
    """Mass, centre of mass and inertia of one of many spacecraft, in the author's frame G.

    In the plane only the moment about z counts; the others are the craft's in the same proportion.

    Raises:
        ConfigError: Drake refuses them.
    """

    def own(values: Iterable[Any]) -> np.ndarray:
        return np.array([x if np.ndim(x) == 0 else x[index] for x in values])

    if craft.dimension == 2:
        moments = np.array(craft.inertia)[np.triu_indices(3)] * (
            own(body.inertia) / craft.inertia[2][2]
        )
        shift = np.append(own(body.centre or (0.0, 0.0)), 0.0)
    else:
        moments = own(body.inertia)
        shift = own(body.centre or (0.0,) * 3)
    xx, xy, xz, yy, yz, zz = moments
    try:
        return SpatialInertia.MakeFromCentralInertia(
            own([body.mass])[0],
            np.array(craft.centre_of_mass) + shift,
            RotationalInertia(xx, yy, zz, xy, xz, yz),
        )
    except RuntimeError as error:
        reason = str(error).partition("\n")[0]
        raise ConfigError(
            f"spacecraft {craft.name!r}: Drake refuses its inertia {craft.inertia}: {reason}"
        ) from error


def pose(thruster: Thruster) -> RigidTransform:
    """Pose in G of a frame whose z axis is the thrust's direction."""
    R_GP = RotationMatrix.MakeFromOneVector(np.array(thruster.direction), axis_index=2)
    return RigidTransform(R_GP, np.array(thruster.position))


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


class Orbit(LeafSystem):
    """Adds the pseudo-forces of a Hill frame, at every spacecraft's present place and velocity.

    They are m (3 n^2 x + 2 n v_y, -2 n v_x, -n^2 z), for x radial, y along the track, z across.

    The mean motion n is in rad/s, the masses (N,) in kg. Places (N, 2 or 3) tell where each spacecraft's
    place stands among the plant's positions, speeds (N, 2 or 3) where its velocity stands among the
    velocities, and its force among the generalised forces.
    """

    def __init__(
        self,
        mean_motion: float,
        masses: np.ndarray,
        places: np.ndarray,
        speeds: np.ndarray,
        positions: int,
    ) -> None:
        super().__init__()
        self._n = mean_motion
        self._masses = masses
        self._positions = positions
        self._places = places
        self._speeds = speeds
        count = len(masses) * (3 if places.shape[1] == 2 else 6)
        self.state = self.DeclareVectorInputPort("state", positions + count)
        self.others = self.DeclareVectorInputPort("others", count)
        self.total = self.DeclareVectorOutputPort("total", count, self._pull)

    def _pull(self, context: Context, output: BasicVector) -> None:
        n = self._n
        state = np.array(self.state.Eval(context))
        total = np.array(self.others.Eval(context))
        place = state[self._places]
        speed = state[self._positions + self._speeds]
        pull = np.zeros_like(place)
        pull[:, 0] = 3.0 * n * n * place[:, 0] + 2.0 * n * speed[:, 1]
        pull[:, 1] = -2.0 * n * speed[:, 0]
        pull[:, 2:] = -n * n * place[:, 2:]
        total[self._speeds] += self._masses[:, None] * pull
        output.SetFromVector(total)
