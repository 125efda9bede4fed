"""Craft, states and goal sets of the bounds in space."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np

from rans import Spacecraft, Thruster
from rans.model.dynamics import SpatialState
from rans.model.fields import leaves
from rans.model.spacecraft_file import load_spacecraft
from tests.support.states import spatial

PERIOD = 0.2
FLYER = load_spacecraft("free-flyer")
REST = ("attitude", "position", "spin", "velocity")
POSE = ("attitude", "position", "velocity")


def craft_with(name: str, nozzles: tuple[Thruster, ...]) -> Spacecraft:
    with warnings.catch_warnings():
        warnings.simplefilter(
            "ignore"
        )  # that some cannot be steered everywhere does not matter here
        return Spacecraft(
            name, 3, 3.0, ((0.11, 0.0, 0.0), (0.0, 0.11, 0.0), (0.0, 0.0, 0.11)), nozzles
        )


def lopsided() -> Spacecraft:
    """Unequal nozzles with torques of 1, 1, 2 and 0 quanta about axes that are square or opposite."""
    return craft_with(
        "lopsided",
        (
            Thruster((0.2, 0.0, 0.0), (0.0, 1.0, 0.0), 1.0),
            Thruster((0.0, 0.1, 0.0), (0.0, 0.0, 1.0), 2.0),
            Thruster((0.0, 0.0, -0.2), (0.0, 1.0, 0.0), 2.0),
            Thruster((0.1, 0.0, 0.0), (1.0, 0.0, 0.0), 0.7),
        ),
    )


def moving(seed: int, spin: float) -> SpatialState:
    random = np.random.default_rng(seed)
    q = random.normal(size=4)
    return spatial(
        random.uniform(-0.5, 0.5, 3),
        attitude=q / np.linalg.norm(q),
        v=random.uniform(-0.3, 0.3, 3),
        w=random.uniform(-spin, spin, 3),
    )


def near(final: Any, goal: Any, within: float) -> np.ndarray:
    same = sum(a * b for a, b in zip(leaves(final.attitude), leaves(goal.attitude), strict=True))
    return 2.0 * np.arccos(np.minimum(1.0, np.abs(same))) <= within
