"""What each thruster of a craft does to its twist, for tests of layouts."""

from __future__ import annotations

import numpy as np

from rans.model.spacecraft_file import load_spacecraft


def columns_of(name: str) -> np.ndarray:
    """Change of the velocity and of the spin per second by each thruster at full force, (thrusters, 3 or 6)."""
    craft = load_spacecraft(name)
    wrenches = np.array(craft.wrench_map)
    if craft.dimension == 2:
        return wrenches / np.array([craft.mass, craft.mass, craft.inertia[2][2]])
    angular = wrenches[:, 3:] @ np.linalg.inv(np.array(craft.inertia))
    return np.column_stack([wrenches[:, :3] / craft.mass, angular])
