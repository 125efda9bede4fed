"""Thrusters opened at random, the same in Drake, with our equations, in engines and environments."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import torch

from rans import Conditions, Engine, GoToPose, Spacecraft, Timing
from rans.episode.flight import Flight, fly
from rans.episode.scenario import draws, scenarios
from rans.model.fields import leaves
from rans.tasks import Task
from tests.support.crafts import nasty_planar, nasty_spatial

TASK = GoToPose(fail_distance=1e3, fail_spin=1e3)
"""Which never ends before its time."""
PLANE = nasty_planar()
SPACE = nasty_spatial()
CRAFTS = {2: PLANE, 3: SPACE}


class Random:
    """Opens thrusters at random, the same in every flight; keeps what it told and was shown."""

    name = "random"

    def __init__(self, craft: Spacecraft) -> None:
        self._thrusters = len(craft.thrusters)

    def __copy__(self) -> Any:
        return self  # what it keeps is read after the flight

    def reset(self, count: int) -> None:
        self._rng = np.random.default_rng(3)
        self._count = count
        self.told = []
        self.seen = []

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        self.seen.append(observation)
        self.told.append(self._rng.integers(0, 2, (self._count, self._thrusters)).astype(float))
        return self.told[-1]


def flown(
    craft: Spacecraft, conditions: Conditions, steps: int, move: Any = fly
) -> tuple[Flight, Random]:
    # For a second or two, four substeps a period are as exact in space.
    pilot = Random(craft)
    timing = Timing(substeps=1 if craft.dimension == 2 else 4, episode_steps=steps)
    return move(
        craft,
        TASK,
        pilot,
        scenarios(TASK, craft, 9, 2),
        timing,
        conditions=conditions,
        draws=draws(9, 2),
    ), pilot


def thrusting(craft: Spacecraft, task: Task, steps: int = 8, seed: int = 5) -> Flight:
    """Two flights of a task."""
    starts = scenarios(task, craft, seed, 2)
    return fly(craft, task, Random(craft), starts, replace(task.timing, episode_steps=steps))


class InEngine:
    """Two spacecraft of an engine."""

    count = 2

    def __init__(self, engine: Engine) -> None:
        self._engine = engine

    def observe(self) -> np.ndarray:
        return self._engine.observe().numpy()

    def step(self, told: np.ndarray) -> np.ndarray:
        return self._engine.step(torch.from_numpy(told)).reward.numpy()

    def state(self) -> np.ndarray:
        return np.array([np.asarray(x) for x in leaves(self._engine.state)])


def in_engine(name: str, craft: Spacecraft, conditions: Conditions, timing: Timing) -> InEngine:
    dtype = torch.float32 if name == "float32" else torch.float64
    return InEngine(
        Engine(
            craft,
            TASK,
            2,
            timing,
            seed=9,
            dtype=dtype,
            compiled=name != "numpy",
            conditions=conditions,
        )
    )
