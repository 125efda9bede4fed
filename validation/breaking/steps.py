"""Environment steps of craft at the ends of what files may say: no number may be silently none."""

from __future__ import annotations

import random
import warnings
from dataclasses import dataclass, replace

import torch

from rans.errors import ConfigError
from rans.fast.engine import Engine
from rans.model.conditions_file import load_conditions
from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import load_spacecraft
from rans.model.timing import Timing
from rans.tasks import TASKS

_STEPS = 64
"""Of one engine, which resets on the way."""


@dataclass(frozen=True)
class Flown:
    """Steps of many craft."""

    steps: int
    craft: int
    refused: int
    told: int
    """Steps whose reward is no number, and which end their episode as failed: a state that is none has."""
    silent: int
    """Steps with an observation that is no number, or a reward that is none though nothing failed."""
    where: tuple[int, ...]
    """Numbers of the craft that had one."""


def extreme(chance: random.Random) -> Spacecraft:
    """A spacecraft with masses, forces and places anywhere within what is allowed."""
    known = "floating-platform", "free-flyer", "floating-platform-shared", "atmos"
    craft = load_spacecraft(chance.choice(known))
    any_size = lambda: 10.0 ** chance.uniform(-9, 9) if chance.random() < 0.5 else 1.0  # noqa: E731
    heavier, longer, stronger, stiffer = (any_size() for _ in range(4))
    bound = lambda x, low: min(max(x, low), 1e9)  # noqa: E731
    thrusters = tuple(replace(one, force=bound(one.force * stronger, 1e-9),
                              position=tuple(max(-1e9, min(1e9, x * longer)) for x in one.position))
                      for one in craft.thrusters)
    inertia = tuple(tuple(x * min(max(stiffer, 1e-7), 1e8) for x in row) for row in craft.inertia)
    return replace(craft, mass=bound(craft.mass * heavier, 1e-9), thrusters=thrusters, inertia=inertia)


def flown(number: int, count: int) -> tuple[int, int, int]:
    """Steps of one extreme craft in ``count`` environments; those `Flown` calls told, and silent."""
    chance = random.Random(f"craft {number}")
    craft = extreme(chance)
    task = TASKS[chance.choice([name for name in TASKS if ":" not in name])]()
    conditions = chance.choice([None, None, load_conditions(chance.choice(["lab", "harsh", "faults"]))])
    timing = Timing(10.0 ** chance.uniform(-3, 1), substeps=chance.choice([1, 1, 4]), episode_steps=16)
    engine = Engine(craft, task, count, timing, seed=number, conditions=conditions)
    generator = torch.Generator().manual_seed(number)
    shape, told, silent = (count, len(craft.thrusters)), 0, 0
    for _ in range(_STEPS):
        action = torch.rand(shape, generator=generator)
        step = engine.step(action if craft.actuators.is_continuous else action.round())
        blind, unpaid = ~torch.isfinite(step.observation).all(dim=1), ~torch.isfinite(step.reward)
        told += int((unpaid & step.terminated & ~blind).sum())
        silent += int((blind | (unpaid & ~step.terminated)).sum())
    return _STEPS * count, told, silent


def steps(most: float, first: int = 0) -> Flown:
    """So many steps, of one extreme craft after the other, from a number on."""
    count = int(min(2048, max(1, most // _STEPS)))
    done = refused = told = silent = 0
    made = first
    where: list[int] = []
    with warnings.catch_warnings(action="ignore"):  # most are too fast for their period, and it is said
        while done < most:
            made += 1
            try:
                found, ended, wrong = flown(made, count)
            except ConfigError:
                refused += 1
                continue
            done, told, silent = done + found, told + ended, silent + wrong
            where += [made] if wrong else []
    return Flown(done, made - first, refused, told, silent, tuple(where))
