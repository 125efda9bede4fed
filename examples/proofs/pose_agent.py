"""Train a small throttled agent that stays at a pose, and write it as an ONNX file for `rans prove`.

    python examples/proofs/pose_agent.py pose-agent.onnx
    rans prove pose-agent.onnx --problem examples/proofs/pose-agent.toml

The craft is the floating platform, with two thrusters' force along each axis and two thrusters' torque. The teacher
is a linear law of position, velocity, heading and spin, within these limits. The network has two layers of 16 tanh
units. Training takes some seconds of one core.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from docking_agent import trained, write

STRONGEST = np.array([0.376, 0.376, 3.03])  # m/s^2, m/s^2 and rad/s^2
RATE = 1.5  # rad/s, natural frequency of the law; its damping is critical
SCALE = np.array(
    [0.05, 0.05, 0.05, 0.05, 0.05, 0.05]
)  # m, m/s, rad and rad/s that the first layer divides by


def guidance(states: np.ndarray) -> np.ndarray:
    """Commands (N, 3) in states (N, 6): position in B, velocity in B, heading, spin."""
    place = states[:, [0, 1, 4]]
    rate = states[:, [2, 3, 5]]
    return np.tanh(-(RATE**2 * place + 2.0 * RATE * rate) / STRONGEST)


if __name__ == "__main__":
    begin = np.random.default_rng(0).uniform(-0.1, 0.1, (12_000, 6))
    write(trained(begin, guidance(begin), SCALE), SCALE, Path(sys.argv[1]))
