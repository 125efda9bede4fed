"""Frames of orbits in Drake's plant: what turns W and pulls in it, for each kind of drift, without our equations.

Each kind of `rans.model.drift.Drift` on an orbit that is to be flown in Drake has a `DrakeFrame` under the name of
its class in `FRAMES`; packages register theirs in the group ``rans.drake_frames`` of entry points.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any

import numpy as np

from rans.base.registry import Registry
from rans.model.drift import Drift

SPHERE = np.diag([2.0, -1.0, -1.0])
"""Gradient of a sphere's gravity, in its size over the distance."""


@dataclass(eq=False)
class DrakeFrame(ABC):
    """The Hill frame of a target on an orbit."""

    orbit: Any
    """The drift, of which only the numbers that describe the orbit are read."""

    @property
    def gravity_gradient(self) -> bool:
        """Whether the gradient of gravity turns craft."""
        return getattr(self.orbit, "gravity_gradient", False)

    @property
    def drag(self) -> float:
        """Drag of craft relative to the target, m/s^2 along -y."""
        return 0.0

    @abstractmethod
    def angle(self, drift: Any) -> Any:
        """Angles of the targets of a drift at time 0, rad: a number or (N,).

        Raises:
            ConfigError: the drift is of another orbit.
        """

    @abstractmethod
    def motion(self, angles: np.ndarray, time: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Angular velocity of the frame (N, 3), rad/s, its change, and the gradient of gravity (N, 3, 3), 1/s^2.

        Args:
            angles: of the targets at time 0, (N,) rad.
            time: s.
        """


class CircularFrame(DrakeFrame):
    """A circle: the angular velocity is constant along z."""

    def angle(self, drift: Any) -> float:
        """0: all places on it are alike."""
        return 0.0

    def motion(self, angles: np.ndarray, time: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """See `DrakeFrame.motion`."""
        n = self.orbit.mean_motion
        rate, change = np.zeros((2, len(angles), 3))
        rate[:, 2] = n
        return rate, change, np.broadcast_to(n * n * SPHERE, (len(angles), 3, 3))


FRAMES: Registry[Any] = Registry(
    "orbit in Drake",
    "rans.drake_frames",
    {"ClohessyWiltshire": "rans.reference.frames:CircularFrame"},
)
"""Frames by the name of the class of the drift."""


def drake_frame(drift: Drift) -> DrakeFrame | None:
    """Frame of a drift; None: it has none, or is no orbit."""
    name = type(drift).__name__
    return FRAMES[name](drift) if name in FRAMES else None
