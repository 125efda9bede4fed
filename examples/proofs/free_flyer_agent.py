"""Train a small throttled agent that stays at a pose in six degrees of freedom, as an ONNX file for `rans prove`.

    python examples/proofs/free_flyer_agent.py free-flyer-agent.onnx
    rans prove free-flyer-agent.onnx --problem examples/proofs/free-flyer-agent.toml

The craft is the free flyer: 5.32 kg, a sphere of 0.2045 kg m^2. The teacher is a linear law of position, velocity,
attitude and spin, within a force of 1.4 N and a torque of 0.41 N m along each axis. The network has two layers of
16 tanh units. Training takes some seconds of one core.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from docking_agent import trained, write

STRONGEST = np.array([0.263, 0.263, 0.263, 2.0, 2.0, 2.0])  # m/s^2 and rad/s^2
RATE = 1.0  # rad/s, natural frequency of the law; its damping is critical
SCALE = np.full(12, 1.0)  # m, m/s, rad and rad/s that the first layer divides by


def guidance(states: np.ndarray) -> np.ndarray:
    """Commands (N, 6) in states (N, 12): position and velocity in B, attitude vector, spin."""
    place = states[:, [0, 1, 2, 6, 7, 8]]
    rate = states[:, [3, 4, 5, 9, 10, 11]]
    return np.tanh(-(RATE**2 * place + 2.0 * RATE * rate) / STRONGEST)


if __name__ == "__main__":
    begin = np.random.default_rng(0).uniform(-0.1, 0.1, (12_000, 12))
    write(trained(begin, guidance(begin), SCALE), SCALE, Path(sys.argv[1]))
