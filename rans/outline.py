"""The outline of a spacecraft, which every drawing uses: its outer radius and its nozzles, in the body frame."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from rans.model.spacecraft import Spacecraft

BELL = 0.3
"""Length of a nozzle, in radii of its craft."""
_AROUND = np.linspace(0.0, 2.0 * np.pi, 49)[:, None]
"""Angles of the points of a circle, rad."""


class Nozzle(NamedTuple):
    """A nozzle in B, from the centre of mass."""

    root: np.ndarray
    """(3,) where the thruster pushes, m."""
    mouth: np.ndarray
    """(3,) where its plume begins, m."""
    exhaust: np.ndarray
    """(3,) unit vector along its plume, against its force."""
    strength: float
    """Its force as a part of that of the strongest thruster."""


@dataclass(frozen=True)
class Outline:
    """The outline of a spacecraft."""

    craft: Spacecraft

    @property
    def radius(self) -> float:
        """Largest distance of anything of it from its centre of mass, m."""
        return self.craft.radius

    @cached_property
    def centre(self) -> np.ndarray:
        """(3,) centre of mass in the frame of the spacecraft's file, m."""
        return np.array(self.craft.centre_of_mass)

    @cached_property
    def nozzles(self) -> tuple[Nozzle, ...]:
        """Nozzles in the order of the thrusters, in B about the centre of mass, m; strengths are 0 to 1."""
        largest = max((thruster.force for thruster in self.craft.thrusters), default=1.0)
        result = []
        for thruster in self.craft.thrusters:
            root = np.array(thruster.position) - self.centre
            exhaust = -np.array(thruster.direction)
            mouth = root + BELL * self.radius * exhaust
            result.append(Nozzle(root, mouth, exhaust, thruster.force / largest))
        return tuple(result)

    @cached_property
    def rings(self) -> tuple[np.ndarray, ...]:
        """(49, 3) circles of the outer radius, m: one in the plane, in space one in each plane of two body axes."""
        planes = ((0, 1),) if self.craft.dimension == 2 else ((0, 1), (1, 2), (2, 0))
        axes = self.radius * np.eye(3)
        return tuple(np.cos(_AROUND) * axes[a] + np.sin(_AROUND) * axes[b] for a, b in planes)

    def values(self, decimals: int) -> dict[str, Any]:
        """Plain values for the script of a page, `rans/show/pages/craft.js`, rounded.

        `craft.js` reads these keys.
        """

        def rounded(vector: np.ndarray) -> list[float]:
            # Zeros without a sign.
            return (np.round(vector, decimals) + 0.0).tolist()

        return {
            "planar": self.craft.dimension == 2,
            "radius": self.radius,
            "thrusters": [
                {"at": rounded(nozzle.root), "along": rounded(-nozzle.exhaust * nozzle.strength)}
                for nozzle in self.nozzles
            ],
        }
