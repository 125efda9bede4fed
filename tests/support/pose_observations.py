"""Observations of go-to-pose at every scale."""

from __future__ import annotations

import numpy as np
import torch
from scipy.spatial.transform import Rotation


def observations(count: int, seed: int = 0, dimension: int = 2) -> torch.Tensor:
    """Observations of go-to-pose, from centimetres to metres; every fourth is near the attitude."""
    random = np.random.default_rng(seed)
    size = 10.0 ** random.uniform(-2.0, 0.5, (count, 1))
    turned = np.where(np.arange(count) % 4 == 0, 0.02, 1.0)[:, None]
    if dimension == 3:
        own = Rotation.random(count, rng=random).as_matrix()[:, :2]
        whole = Rotation.random(count, rng=random).as_rotvec()
        turn = Rotation.from_rotvec(turned * whole).as_matrix()[:, :2]
        parts = [
            own.reshape(count, 6),
            0.2 * size * random.normal(size=(count, 3)),
            0.3 * turned * random.normal(size=(count, 3)),
            np.ones((count, 1)),
            size * random.normal(size=(count, 3)),
            turn.reshape(count, 6),
        ]
        return torch.tensor(np.concatenate(parts, axis=1), dtype=torch.float32)
    heading, turn = random.uniform(-np.pi, np.pi, (2, count))
    turn = turn * turned[:, 0]
    velocity = 0.2 * size * random.normal(size=(count, 2))
    spin = 0.3 * turned[:, 0] * random.normal(size=count)
    way = size * random.normal(size=(count, 2))
    rows = [np.cos(heading), np.sin(heading), *velocity.T, spin, np.ones(count), *way.T]
    return torch.tensor(np.stack([*rows, np.cos(turn), np.sin(turn)], axis=1), dtype=torch.float32)
