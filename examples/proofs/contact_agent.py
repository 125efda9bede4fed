"""Train a small throttled agent that flies the last 15 m to contact, as an ONNX file for `rans prove`.

    python examples/proofs/contact_agent.py contact-agent.onnx
    rans prove contact-agent.onnx --problem examples/proofs/contact-agent.toml

The craft is the deputy of the docking benchmark, 12 kg, and comes along the orbit from behind its target, whose
port is at the origin. The teacher closes at 8 cm/s, and at 2 cm/s at the port, since it aims at a point beyond it;
it removes its offset to the sides with a time of 50 s. The network has two layers of 16 tanh units and gives parts
of 0.1 N along each axis: what it misses of the teacher is then a tenth of that with parts of 1 N. Training takes
some seconds of one core.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from docking_agent import MASS, MEAN_MOTION, trained, write

STRONGEST = 0.1  # N along each axis
LAG = 15.0  # s in which an error of the velocity is removed, three control periods
FASTEST = 0.08  # m/s, closing speed far from the port
BEYOND = 0.6  # m behind the port where the way would end
CLOSING = 40.0  # s, distance over closing speed near that point
SIDES = 50.0  # s, offset to the sides over the speed that removes it
SCALE = np.array([1.0, 8.0, 1.0, 0.1, 0.1, 0.1])  # m and m/s that the first layer divides states by


def velocity_wanted(position: np.ndarray) -> np.ndarray:
    """Velocity (N, 3) towards the port; x is radial, y along the orbit, z across it."""
    closing = FASTEST * np.tanh((BEYOND - position[:, 1]) / CLOSING / FASTEST)
    return np.column_stack((-position[:, 0] / SIDES, closing, -position[:, 2] / SIDES))


def guidance(states: np.ndarray) -> np.ndarray:
    """Parts (N, 3) of the strongest force that remove the velocity error and what the orbit adds."""
    position, velocity = states[:, :3], states[:, 3:]
    drift = np.column_stack(
        (
            3.0 * MEAN_MOTION**2 * position[:, 0] + 2.0 * MEAN_MOTION * velocity[:, 1],
            -2.0 * MEAN_MOTION * velocity[:, 0],
            -(MEAN_MOTION**2) * position[:, 2],
        )
    )
    return np.tanh(MASS / STRONGEST * ((velocity_wanted(position) - velocity) / LAG - drift))


def states(count: int, random: np.random.Generator) -> np.ndarray:
    """States (N, 6) around the ways to the port; half of them within 3 m of it."""
    along = np.where(
        random.random(count) < 0.5,
        random.uniform(-16.5, 0.8, count),
        random.uniform(-3, 0.8, count),
    )
    aside = random.uniform(-1.0, 1.0, (2, count)) * (0.3 + 0.07 * np.abs(along))
    position = np.column_stack((aside[0], along, aside[1]))
    velocity = velocity_wanted(position) + 0.02 * random.normal(size=(count, 3))
    return np.concatenate((position, velocity), axis=1)


if __name__ == "__main__":
    begin = states(12_000, np.random.default_rng(0))
    write(trained(begin, guidance(begin), SCALE), SCALE, Path(sys.argv[1]))
