"""The outline of a spacecraft, which every drawing uses: its nozzles in the body frame."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from rans.model.spacecraft import Spacecraft

BELL = 0.3
"""Length of a nozzle, in radii of its craft."""


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


def nozzles(craft: Spacecraft) -> tuple[Nozzle, ...]:
    """Nozzles of a craft in the order of its thrusters, in B about the centre of mass, m; strengths are 0 to 1."""
    largest = max((thruster.force for thruster in craft.thrusters), default=1.0)
    result = []
    for thruster in craft.thrusters:
        root = np.array(thruster.position) - craft.centre_of_mass
        exhaust = -np.array(thruster.direction)
        mouth = root + BELL * craft.radius * exhaust
        result.append(Nozzle(root, mouth, exhaust, thruster.force / largest))
    return tuple(result)


def outline_values(craft: Spacecraft, decimals: int) -> dict[str, Any]:
    """Plain values for the script of a page, `rans/show/pages/craft.js`, rounded.

    `craft.js` reads these keys.
    """

    def rounded(vector: np.ndarray) -> list[float]:
        # Zeros without a sign.
        return (np.round(vector, decimals) + 0.0).tolist()

    return {
        "planar": craft.dimension == 2,
        "radius": craft.radius,
        "thrusters": [
            {"at": rounded(nozzle.root), "along": rounded(-nozzle.exhaust * nozzle.strength)}
            for nozzle in nozzles(craft)
        ],
    }
