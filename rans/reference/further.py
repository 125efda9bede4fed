"""Effectors of other kinds than thrusters, propellant and wheels, as Drake's plant has them.

Each kind of `rans.effectors.effector.Effector` that is to be flown in Drake brings a description of its own,
which shares nothing with our equations: `register` it under the name of the class that `of_craft` of
the effector returns, by default the effector's own.
"""

# Drake's stubs write NumPy's array types with their two parameters exchanged.

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Context

from rans.base.errors import ConfigError
from rans.base.registry import Registry
from rans.model.body import Body
from rans.model.spacecraft import Spacecraft


class Pushing(NamedTuple):
    """A place in the author's frame G at which an effector pushes and turns along one direction."""

    position: tuple[float, float, float]
    """In G, m."""
    direction: tuple[float, float, float]
    """Unit vector in G."""
    force: float
    """Force along the direction for a value of one, N."""
    torque: float
    """Torque about the direction for a value of one, N m."""

    @property
    def pose(self) -> RigidTransform:
        """Frame in G whose z axis is the direction."""
        rotation = RotationMatrix.MakeFromOneVector(np.array(self.direction), axis_index=2)
        return RigidTransform(rotation, np.array(self.position))


class DrakeEffector(ABC):
    """One effector in Drake's plant."""

    @abstractmethod
    def places(self) -> list[Pushing]:
        """Where it pushes."""

    @abstractmethod
    def values(self, commands: np.ndarray, stores: np.ndarray, duration: float) -> np.ndarray:
        """What it gives at each place during a control period, (N, places).

        Args:
            commands: its own, (N, commands).
            stores: its own at the beginning, (N, stores).
            duration: of the control period, s; infinite where only one instant counts.
        """

    def stores_after(
        self, commands: np.ndarray, stores: np.ndarray, duration: float, time: float
    ) -> np.ndarray:
        """Its stores (N, stores) at a time since the control period began, s: by default as they were."""
        return stores

    def fastest(self, stores: np.ndarray) -> float:
        """Fastest motion inside the craft with these stores (N, stores), rad/s, for Drake's steps: by default 0."""
        return 0.0


class DrakeMass(DrakeEffector):
    """An effector that moves with the craft, as bodies, joints or forces of Drake's plant.

    It is the other half of `rans.effectors.effector.JointMotion`. An effector without a mass has the mass 0.
    """

    def places(self) -> list[Pushing]:
        """It pushes nowhere: Drake computes what its mass does."""
        return []

    def values(self, commands: np.ndarray, stores: np.ndarray, duration: float) -> np.ndarray:
        """None, (N, 0)."""
        return np.zeros((len(stores), 0))

    @abstractmethod
    def at_rest(self, craft: Spacecraft, body: Body, index: int) -> tuple[float, np.ndarray]:
        """Mass, kg, and its position at rest in G, (3,) m, in one of many spacecraft, whose mass includes it."""

    @abstractmethod
    def add(
        self, plant: MultibodyPlant, craft: Spacecraft, body: Body, bodies: Sequence[Any]
    ) -> None:
        """Add the mass of every spacecraft, whose rigid bodies are the last argument, before the plant is final.

        A craft's own joint, between the world and its rigid body, is
        ``plant.GetJointByName(f"B of {rigid.name()}")``: a `PlanarJoint` or `QuaternionFloatingJoint` without
        damping, to which ``set_default_damping_vector`` gives some.
        """

    @abstractmethod
    def friction(self) -> Any:
        """System with ports ``state``, ``others`` and ``total`` that adds forces; None: Drake's joints have all."""

    @abstractmethod
    def set(self, context: Context, q: np.ndarray, v: np.ndarray, stores: np.ndarray) -> None:
        """Write its stores (N, stores) into the plant's coordinates q and velocities v."""

    @abstractmethod
    def get(self, context: Context) -> np.ndarray:
        """Its stores (N, stores)."""


REGISTERED: Registry[Any] = Registry("kind of effector in Drake", "rans.drake_effectors")
"""What Drake's plant makes of further effectors, by the names of the classes that their `of_craft` returns.

Packages register theirs."""


def register(kind: str, make: Any) -> None:
    """Say what Drake's plant makes of effectors whose class has this name.

    Args:
        kind: name of the class that `of_craft` returns, such as "Torquer"; by default the effector's own.
        make: called with the effector; returns its `DrakeEffector`.
    """
    REGISTERED.register(kind)(make)


def drake_effectors(effectors: tuple[Any, ...]) -> list[DrakeEffector]:
    """Descriptions of further effectors.

    Raises:
        ConfigError: nobody registered one for a kind.
    """
    for effector in effectors:
        if type(effector).__name__ not in REGISTERED:
            raise ConfigError(
                f"Drake does not know effectors of the kind {type(effector).__name__}: describe it with "
                "rans.reference.further.register."
            )
    return [REGISTERED[type(effector).__name__](effector) for effector in effectors]
