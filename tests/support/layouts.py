"""Random thrusters in the plane, for tests of any layout."""

from __future__ import annotations

import numpy as np
from rans_any_craft.twists import authority_margin


def sample_layout(seed: int, most: int = 8, least_margin: float = 0.25) -> np.ndarray:
    """Columns (n, 3) of four to ``most`` thrusters in the plane, which push and turn a unit craft every way."""
    random = np.random.default_rng(seed)
    while True:
        count = int(random.integers(4, most + 1))
        along = random.uniform(0.0, 2.0 * np.pi, count)
        position = random.uniform(-1.0, 1.0, (count, 2))
        push = random.uniform(0.5, 1.5, count)[:, None] * np.stack(
            [np.cos(along), np.sin(along)], 1
        )
        torque = position[:, 0] * push[:, 1] - position[:, 1] * push[:, 0]
        columns = np.column_stack([push, torque / np.sqrt(np.square(position).sum(axis=1).mean())])
        if authority_margin(columns) > least_margin:
            return columns
