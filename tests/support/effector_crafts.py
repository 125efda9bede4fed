"""Craft with reaction wheels, propellant and engines that are always lit."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from rans import Spacecraft
from rans.model.actuators import Propellant, Throttle, Wheel
from rans.model.spacecraft_file import load_spacecraft

EXAMPLES = Path(__file__).parents[2] / "examples" / "spacecraft"
CUBESAT = load_spacecraft("afrl-12kg")
LANDER = load_spacecraft(str(EXAMPLES / "mars-lander.toml"))

UNEVEN = replace(
    CUBESAT,
    name="uneven",
    inertia=((0.06, 0.002, -0.001), (0.002, 0.05, 0.003), (-0.001, 0.003, 0.08)),
    wheels=(
        Wheel((1.0, 0.0, 0.0), 0.02, 0.1, 4e-4),
        Wheel((0.0, 0.6, 0.8), 0.03, 0.2, 5e-4),
        Wheel((0.0, 0.0, 1.0), 0.01, 0.1, 2e-4),
    ),
)
"""Different moments of inertia, and wheels that do not stand at right angles to all of its axes."""


def platform(**changes: Any) -> Spacecraft:
    """The floating platform with other effectors."""
    return replace(load_spacecraft("floating-platform"), name="platform", **changes)


WHEELED = platform(wheels=(Wheel((0.0, 0.0, 1.0), 0.05, 0.08, 1e-3),))
"""On/off thrusters and a wheel, in the plane."""
BURNING = platform(actuators=Throttle(), propellant=Propellant(2.0, 5.0, (0.06, -0.03, 0.0), 0.05))
"""Loses 1 N / (5 s g0) = 20 g a second with each thruster, of a mass of 5.32 kg, off the centre of mass."""


def commands(craft: Spacecraft, count: int, seed: int = 0) -> np.ndarray:
    """Random commands (N, commands) in their ranges."""
    random = np.random.default_rng(seed)
    low, high = np.array([(one.low, one.high) for one in craft.commands]).T
    given = random.uniform(low, high, (count, len(low)))
    choices = [k for k, one in enumerate(craft.commands) if one.kind == "on-off"]
    given[:, choices] = given[:, choices] > 0.5
    return given
