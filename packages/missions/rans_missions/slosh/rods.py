"""Sloshing liquid in Drake: point masses on massless rods, one in each spacecraft."""

# Drake's stubs write NumPy's array types with their two parameters exchanged and leave ports untyped.

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Sequence
from typing import Any

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    FixedOffsetFrame,
    Joint,
    RevoluteJoint,
    SpatialInertia,
    UnitInertia,
    UniversalJoint,
)
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from rans.extend import Body, Spacecraft
from rans.reference.further import DrakeMass


def in_drake(pendulum: Any) -> Rods:
    """What Drake's plant makes of the pendulum of a craft (`rans.reference.further.REGISTERED`)."""
    kind = PlanarRods if pendulum.craft.dimension == 2 else SphericalRods
    return kind(pendulum.slosh)


class Rods(DrakeMass):
    """Rods of all spacecraft of a plant."""

    def __init__(self, slosh: Any) -> None:
        self._slosh = slosh
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
            position = self._slosh.length * self._along
            mass = SpatialInertia(swings, position, UnitInertia.PointMass(position))
            rod = plant.AddRigidBody(f"S of {rigid.name()}", mass)
            hinge = FixedOffsetFrame(
                f"hinge of {rod.name()}", rigid.body_frame(), self._pose(self._slosh.direction)
            )
            self._hinges.append(plant.AddFrame(hinge))
            self._joints.append(
                plant.AddJoint(self._joint(self._hinges[-1], rod, self._slosh.damping))
            )

    def friction(self) -> HingeFriction | None:
        """None: Drake's joints have it."""
        return None

    def fastest(self, stores: np.ndarray) -> float:
        """Fastest rate of a rod, rad/s: the second half of the stores is a rate."""
        rates = np.nan_to_num(stores[:, stores.shape[1] // 2 :])
        return float(np.sqrt(np.max(np.sum(np.square(rates), axis=1), initial=0.0)))

    @property
    @abstractmethod
    def _along(self) -> np.ndarray:
        """Axis of its own frame along which a rod extends."""

    @abstractmethod
    def _pose(self, direction: Sequence[float]) -> RigidTransform:
        """Pose in G of the hinge's frame, which a rod's frame equals when it points along a direction."""

    @abstractmethod
    def _joint(self, hinge: FixedOffsetFrame, rod: Any, damping: float) -> Joint:
        """Joint between a hinge and its rod, with friction, N m s."""

    def coordinates(self) -> tuple[np.ndarray, np.ndarray]:
        """Indices of the joints among the plant's positions and velocities, (N, coordinates) each."""
        count = self._joints[0].num_positions()
        own = np.arange(count)
        positions = np.array([joint.position_start() + own for joint in self._joints])
        velocities = np.array([joint.velocity_start() + own for joint in self._joints])
        return positions, velocities


class PlanarRods(Rods):
    """Rods on revolute joints about z with friction; the stores are the angle, rad, and its rate, rad/s."""

    @property
    def _along(self) -> np.ndarray:
        return np.array([1.0, 0.0, 0.0])

    def _pose(self, direction: Sequence[float]) -> RigidTransform:
        turn = RotationMatrix.MakeZRotation(math.atan2(direction[1], direction[0]))
        return RigidTransform(turn, np.array(self._slosh.hinge))

    def _joint(self, hinge: FixedOffsetFrame, rod: Any, damping: float) -> Joint:
        axis = np.array([0.0, 0.0, 1.0])
        return RevoluteJoint(rod.name(), hinge, rod.body_frame(), axis, damping)

    def set(self, context: Context, q: np.ndarray, v: np.ndarray, stores: np.ndarray) -> None:
        """Write angles and rates."""
        positions, velocities = self.coordinates()
        q[positions] = stores[:, :1]
        v[velocities] = stores[:, 1:]

    def get(self, context: Context) -> np.ndarray:
        """Angles in [-pi, pi), and rates."""
        positions, velocities = self.coordinates()
        angles = self._plant.GetPositions(context)[positions]
        wrapped = np.mod(angles + np.pi, 2.0 * np.pi) - np.pi
        return np.hstack([wrapped, self._plant.GetVelocities(context)[velocities]])


class SphericalRods(Rods):
    """Rods on universal joints; the stores are the unit vector to the mass in B and its derivative, 1/s.

    The frame of a hinge is turned at the start of every control period, so that both angles are zero then and the
    rod moves about the first axis: the singularity of these joints is where it points along this axis. A rod has
    no inertia about itself. The friction is viscous and resists the velocity of the mass; the joints' own would
    resist turns of the rod about itself too, so `HingeFriction` applies it.
    """

    @property
    def _along(self) -> np.ndarray:
        return np.array([0.0, 0.0, 1.0])

    def _pose(self, direction: Sequence[float], slip: np.ndarray | None = None) -> RigidTransform:
        z = np.array(direction) / np.linalg.norm(direction)
        x = np.zeros(3) if slip is None else np.cross(z, slip)
        if not np.linalg.norm(x) > 1e-12:
            x = np.cross(z, np.eye(3)[np.argmin(np.abs(z))])
        x = x / np.linalg.norm(x)
        axes = np.column_stack([x, np.cross(z, x), z])
        return RigidTransform(RotationMatrix(axes), np.array(self._slosh.hinge))

    def _joint(self, hinge: FixedOffsetFrame, rod: Any, damping: float) -> Joint:
        return UniversalJoint(rod.name(), hinge, rod.body_frame(), 0.0)

    def friction(self) -> HingeFriction:
        """The friction of all hinges."""
        sizes = self._plant.num_positions(), self._plant.num_velocities()
        return HingeFriction(self, self._slosh.damping, *sizes)

    def set(self, context: Context, q: np.ndarray, v: np.ndarray, stores: np.ndarray) -> None:
        """Turn the hinges to stores (N, 6), and write zero angles and their rates into q and v.

        See `DrakeMass.set`.
        """
        positions, velocities = self.coordinates()
        q[positions] = 0.0
        for hinge, row, own in zip(self._hinges, stores, velocities, strict=True):
            pose = self._pose(row[:3], row[3:])
            hinge.SetPoseInParentFrame(context, pose)
            # At the angles 0 the end of a unit rod has the velocity (second rate, -first rate, 0).
            x, y, _ = pose.rotation().inverse().multiply(row[3:])
            v[own] = (-y, x)

    def get(self, context: Context) -> np.ndarray:
        """Directions (unit vectors) and their rates (1/s) in B, (N, 6), from the plant's angles.

        In the order of `Pendulum.stores`; frames of hinges are turned every period, so that angles alone say
        nothing.
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
        return np.einsum("nij,nkj->nki", turns, both).reshape(len(turns), 6)


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
