"""Sloshing liquid in Drake: point masses on massless rods, one in each spacecraft."""

# Drake's stubs write NumPy's array types with their two parameters exchanged and leave ports untyped.

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    FixedOffsetFrame,
    Joint,
    SpatialInertia,
    UnitInertia,
    UniversalJoint,
)
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from rans.extend import Body, DrakeMass, Spacecraft


def in_drake(pendulum: Any) -> Rods:
    """What Drake's plant makes of the pendulum of a craft (`rans.reference.further.REGISTERED`)."""
    return Rods(pendulum.slosh, pendulum.craft.dimension == 2)


class Rods(DrakeMass):
    """Rods of all spacecraft of a plant, on universal joints.

    The frame of a hinge is turned at the start of every control period, so that both angles are zero then and the
    rod moves about the first axis: the singularity of these joints is where it points along this axis. A rod has
    no inertia about itself. The friction is viscous and resists the velocity of the mass; the joints' own would
    resist turns of the rod about itself too, so `HingeFriction` applies it.
    """

    def __init__(self, slosh: Any, is_planar: bool) -> None:
        self._slosh = slosh
        self._is_planar = is_planar
        self._rest = float(np.arctan2(slosh.direction[1], slosh.direction[0]))
        """Direction of the rod in B where the angle of a planar craft's is zero, rad."""
        self._hinges: list[Any] = []
        self._joints: list[Joint] = []

    def at_rest(self, craft: Spacecraft, body: Body, index: int) -> tuple[float, np.ndarray]:
        """Mass that swings, kg, and where it rests in G, (3,) m."""
        whole = float(body.mass if np.ndim(body.mass) == 0 else body.mass[index])
        return self._slosh.mass * whole / craft.mass, np.array(self._slosh.point())

    def add(
        self, plant: MultibodyPlant, craft: Spacecraft, body: Body, bodies: Sequence[Any]
    ) -> None:
        """Add a rod with its mass and hinge to every spacecraft's rigid body: sets plant, frames and joints."""
        self._plant = plant
        for k, rigid in enumerate(bodies):
            swings, _ = self.at_rest(craft, body, k)
            position = np.array([0.0, 0.0, self._slosh.length])
            mass = SpatialInertia(swings, position, UnitInertia.PointMass(position))
            rod = plant.AddRigidBody(f"S of {rigid.name()}", mass)
            hinge = FixedOffsetFrame(
                f"hinge of {rod.name()}", rigid.body_frame(), self._pose(self._slosh.direction)
            )
            self._hinges.append(plant.AddFrame(hinge))
            joint = UniversalJoint(rod.name(), self._hinges[-1], rod.body_frame(), 0.0)
            self._joints.append(plant.AddJoint(joint))

    def friction(self) -> HingeFriction:
        """The friction of all hinges."""
        sizes = self._plant.num_positions(), self._plant.num_velocities()
        return HingeFriction(self, self._slosh.damping, *sizes)

    def fastest(self, stores: np.ndarray) -> float:
        """Fastest rate of a rod, rad/s: the second half of the stores is a rate."""
        rates = np.nan_to_num(stores[:, stores.shape[1] // 2 :])
        return float(np.sqrt(np.max(np.sum(np.square(rates), axis=1), initial=0.0)))

    def coordinates(self) -> tuple[np.ndarray, np.ndarray]:
        """Indices of the joints among the plant's positions and velocities, (N, coordinates) each."""
        count = self._joints[0].num_positions()
        own = np.arange(count)
        positions = np.array([joint.position_start() + own for joint in self._joints])
        velocities = np.array([joint.velocity_start() + own for joint in self._joints])
        return positions, velocities

    def _pose(self, direction: Sequence[float], slip: np.ndarray | None = None) -> RigidTransform:
        z = np.array(direction) / np.linalg.norm(direction)
        x = np.zeros(3) if slip is None else np.cross(z, slip)
        if not np.linalg.norm(x) > 1e-12:
            x = np.cross(z, np.eye(3)[np.argmin(np.abs(z))])
        x = x / np.linalg.norm(x)
        axes = np.column_stack([x, np.cross(z, x), z])
        return RigidTransform(RotationMatrix(axes), np.array(self._slosh.hinge))

    def set(self, context: Context, q: np.ndarray, v: np.ndarray, stores: np.ndarray) -> None:
        """Turn the hinges to stores, and write zero angles and their rates into q and v.

        See `DrakeMass.set`; stores are those of `Pendulum.stores`.
        """
        if stores.shape[1] == 2:
            angle, rate = stores.T
            c, s, zero = np.cos(angle + self._rest), np.sin(angle + self._rest), 0.0 * angle
            stores = np.stack([c, s, zero, -rate * s, rate * c, zero], axis=1)
        positions, velocities = self.coordinates()
        q[positions] = 0.0
        for hinge, row, own in zip(self._hinges, stores, velocities, strict=True):
            pose = self._pose(row[:3], row[3:])
            hinge.SetPoseInParentFrame(context, pose)
            # At the angles 0 the end of a unit rod has the velocity (second rate, -first rate, 0).
            x, y, _ = pose.rotation().inverse().multiply(row[3:])
            v[own] = (-y, x)

    def get(self, context: Context) -> np.ndarray:
        """States of the liquid from the plant's angles, in the order of `Pendulum.stores`.

        Frames of hinges are turned every period, so that angles alone say nothing.
        """
        positions, velocities = self.coordinates()
        a, b = self._plant.GetPositions(context)[positions].T
        da, db = self._plant.GetVelocities(context)[velocities].T
        rod = [np.sin(b), -np.sin(a) * np.cos(b), np.cos(a) * np.cos(b)]
        slip = [
            np.cos(b) * db,
            np.sin(a) * np.sin(b) * db - np.cos(a) * np.cos(b) * da,
            -np.cos(a) * np.sin(b) * db - np.sin(a) * np.cos(b) * da,
        ]
        turns = [hinge.GetPoseInParentFrame(context).rotation().matrix() for hinge in self._hinges]
        both = np.stack([np.transpose(rod), np.transpose(slip)], axis=1)
        in_body = np.einsum("nij,nkj->nki", turns, both)
        if not self._is_planar:
            return in_body.reshape(len(turns), 6)
        (x, y, _), (u, v, _) = in_body.transpose(1, 2, 0)
        angle = np.mod(np.arctan2(y, x) - self._rest + np.pi, 2.0 * np.pi) - np.pi
        return np.stack([angle, x * v - y * u], axis=1)


class HingeFriction(LeafSystem):
    """Adds the friction of universal joints to generalised forces: -damping times the velocity of a unit rod's end.

    The end moves with cos(b) a' across the second axis and with b' along it, for the angles a and b of the joint.

    Args:
        rods: of a plant that is finalized.
        damping: friction of each hinge, N m s.
        positions: number of the plant's positions.
        count: number of its velocities.
    """

    def __init__(self, rods: Rods, damping: float, positions: int, count: int) -> None:
        super().__init__()
        self._damping = damping
        own, self._rates = rods.coordinates()
        self._second = own[:, 1]
        self._positions = positions
        self.state = self.DeclareVectorInputPort("state", positions + count)
        self.others = self.DeclareVectorInputPort("others", count)
        self.total = self.DeclareVectorOutputPort("total", count, self._resist)

    def _resist(self, context: Context, output: BasicVector) -> None:
        state = np.array(self.state.Eval(context))
        total = np.array(self.others.Eval(context))
        rates = state[self._positions + self._rates]
        rates[:, 0] *= np.cos(state[self._second]) ** 2
        total[self._rates] -= self._damping * rates
        output.SetFromVector(total)
