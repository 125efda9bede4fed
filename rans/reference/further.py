"""Effectors of other kinds than thrusters, propellant and wheels, as Drake's plant has them.

Each kind of `rans.effectors.effector.Effector` that is to be flown in Drake brings a description of its own,
which shares nothing with our equations: `register` it under the name of the effector's class.
"""

# Drake's stubs write NumPy's array types with their two parameters exchanged.
# pyright: reportArgumentType=false, reportCallIssue=false

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, NamedTuple

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix

from rans.errors import ConfigError


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


_KINDS: dict[str, Any] = {}


def register(kind: str, make: Any) -> None:
    """Say what Drake's plant makes of effectors whose class has this name.

    Args:
        kind: name of the class, such as "Torquer".
        make: called with the effector; returns its `DrakeEffector`.
    """
    _KINDS[kind] = make


def drake_effectors(effectors: tuple[Any, ...]) -> list[DrakeEffector]:
    """Descriptions of further effectors.

    Raises:
        ConfigError: nobody registered one for a kind.
    """
    for effector in effectors:
        if type(effector).__name__ not in _KINDS:
            raise ConfigError(
                f"Drake does not know effectors of the kind {type(effector).__name__}: describe it with "
                "rans.reference.further.register."
            )
    return [_KINDS[type(effector).__name__](effector) for effector in effectors]
