"""Engines that tests share: short flights in which about half of the episodes fail."""

from __future__ import annotations

import math
from typing import Any

import pytest
import torch
from torch import Tensor

from rans import Engine, GoToPose, Spacecraft, Timing
from rans.fast.stepping.step import Step
from rans.model.spacecraft_file import load_spacecraft

PLATFORM = load_spacecraft("floating-platform")
FLYER = load_spacecraft("free-flyer")
SHORT = Timing(episode_steps=20)
NEAR = GoToPose(
    spawn_distance=(0.5, 1.0),
    fail_distance=1.05,
    fail_spin=15.0,
    position_tolerance=0.9,
    attitude_tolerance=2.0,
)
"""With it many of the episodes of `SHORT` fail under random thrust, some succeed and some do not."""

both_crafts = pytest.mark.parametrize("craft", [PLATFORM, FLYER], ids=lambda craft: craft.name)
by_turns = pytest.mark.parametrize(
    ("backend", "craft"),
    [("numpy", PLATFORM), ("torch", FLYER)],
    indirect=["backend"],
    ids=lambda x: getattr(x, "name", x),
)
"""Each backend and each craft once: that NumPy and torch agree for both has tests of its own."""


def torch_engine(*args: Any, **kwargs: Any) -> Engine:
    """An engine that steps on torch, compiled unless the test forbids it."""
    return Engine(*args, compiled=True, **kwargs)


def actions(craft: Spacecraft, count: int, steps: int, seed: int = 1, held: int = 5) -> Tensor:
    """Random commands (steps, count, thrusters), each held for a while so that craft get somewhere."""
    generator = torch.Generator().manual_seed(seed)
    shape = (math.ceil(steps / held), count, len(craft.thrusters))
    return torch.randint(0, 2, shape, generator=generator).repeat_interleave(held, dim=0)[:steps]


def run(engine: Engine, steps: int = 45, seed: int = 1) -> list[Step]:
    """The results of so many random steps."""
    return [engine.step(a) for a in actions(engine.craft, engine.num_envs, steps, seed)]


def way_to_go(craft: Spacecraft, seen: Tensor) -> Tensor:
    """Distance from the goal, (N,) m, in the observation's task data."""
    first = 6 if craft.dimension == 2 else 13
    return seen[:, first : first + craft.dimension].norm(dim=1)
