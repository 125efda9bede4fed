"""Train a small throttled agent that holds a point behind a target, and write it as an ONNX file for `rans prove`.

    python examples/proofs/hold_agent.py hold-agent.onnx
    rans prove hold-agent.onnx --problem examples/proofs/hold-agent.toml

The craft, the orbit, the hold point and the keep-out ball are those of the task hold. The teacher is guidance in
closed form: fly to the hold point at up to 0.3 m/s. It knows nothing of the ball. The network has two layers of 16
tanh units and accelerations within 0.02 m/s^2. Training takes some seconds of one core.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from docking_agent import trained, write

MEAN_MOTION = 0.0011068  # rad/s
GOAL = np.array([0.0, -100.0, 0.0])  # m
STRONGEST = 0.02  # m/s^2 along each axis
LAG = 40.0  # s in which guidance removes an error of the velocity, four control periods
SCALE = np.array(
    [100.0, 100.0, 100.0, 0.5, 0.5, 0.5]
)  # m and m/s that the first layer divides states by


def velocity_wanted(position: np.ndarray) -> np.ndarray:
    """Velocity (N, 3) to the hold point, 0.3 m/s from afar and less within 30 m."""
    way = GOAL - position
    return 0.3 * way / np.sqrt((way**2).sum(axis=1, keepdims=True) + 30.0**2)


def guidance(states: np.ndarray) -> np.ndarray:
    """Commands (N, 3) that remove the velocity error and the Clohessy-Wiltshire accelerations."""
    position, velocity = states[:, :3], states[:, 3:]
    n = MEAN_MOTION
    drift = np.column_stack(
        (
            3.0 * n**2 * position[:, 0] + 2.0 * n * velocity[:, 1],
            -2.0 * n * velocity[:, 0],
            -(n**2) * position[:, 2],
        )
    )
    return np.tanh(((velocity_wanted(position) - velocity) / LAG - drift) / STRONGEST)


def states(count: int, random: np.random.Generator) -> np.ndarray:
    """States (N, 6) round the hold point and the target: some near the way of guidance, others of any velocity."""
    direction = random.normal(size=(count, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    position = GOAL + direction * np.exp(random.uniform(np.log(0.5), np.log(300.0), (count, 1)))
    near = velocity_wanted(position) + 0.05 * random.normal(size=(count, 3))
    free = random.uniform(-0.4, 0.4, (count, 3))
    return np.concatenate((position, np.where(random.random((count, 1)) < 0.6, near, free)), axis=1)


if __name__ == "__main__":
    begin = states(12_000, np.random.default_rng(0))
    write(trained(begin, guidance(begin), SCALE), SCALE, Path(sys.argv[1]))
