"""Environment steps of craft at the ends of what files may say: no number may be silently none."""

from __future__ import annotations

import random
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch

from rans.errors import ConfigError
from rans.fast.engine import Engine
from rans.fast.stepping.step import Step
from rans.model.accuracy import FARTHEST, WILDEST
from rans.model.body import Body
from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import load_spacecraft
from rans.model.timing import Timing
from rans.randomization.conditions import Conditions
from rans.randomization.conditions_file import load_conditions
from rans.tasks import TASKS, Task

_STEPS = 64
"""Of one engine, which resets on the way."""
_BATCH = 2**14
_BATCHES = 2**14
"""Craft of one compiled world, and their steps: 268 million together."""
_KNOWN = "floating-platform", "free-flyer", "floating-platform-shared", "atmos"


@dataclass(frozen=True)
class Flown:
    """Steps of many craft."""

    steps: int = 0
    craft: int = 0
    refused: int = 0
    lost: int = 0
    """Steps that ended an episode because its state was no number any more."""
    silent: int = 0
    """Steps with an observation, a reward or a term of it that is no number."""
    where: tuple[int, ...] = ()
    """Numbers of the craft, or worlds, that had one."""
    seconds: float = 0.0

    def __add__(self, other: Flown) -> Flown:
        return Flown(
            self.steps + other.steps,
            self.craft + other.craft,
            self.refused + other.refused,
            self.lost + other.lost,
            self.silent + other.silent,
            self.where + other.where,
            self.seconds + other.seconds,
        )


def extreme(chance: random.Random) -> Spacecraft:
    """A spacecraft with masses, forces and places anywhere within what is allowed."""
    craft = load_spacecraft(chance.choice(_KNOWN))
    heavier, longer, stronger, stiffer = (
        10.0 ** chance.uniform(-9, 9) if chance.random() < 0.5 else 1.0 for _ in range(4)
    )
    bound = lambda x, low: min(max(x, low), 1e9)  # noqa: E731
    thrusters = tuple(
        replace(
            one,
            force=bound(one.force * stronger, 1e-9),
            position=tuple(max(-1e9, min(1e9, x * longer)) for x in one.position),
        )
        for one in craft.thrusters
    )
    inertia = tuple(tuple(x * min(max(stiffer, 1e-7), 1e8) for x in row) for row in craft.inertia)
    return replace(
        craft, mass=bound(craft.mass * heavier, 1e-9), thrusters=thrusters, inertia=inertia
    )


def bodies(craft: Spacecraft, count: int, seed: int, period: float) -> Body:
    """Of so many differently extreme ones: mass, inertia, centre of mass and force of the thrusters.

    Where one command of a period (s) would move or turn one further than is flown (`rans.model.accuracy`),
    its thrusters are as much weaker: a world that holds one of those is refused as a whole.
    """
    chance = np.random.default_rng(seed)

    def size() -> np.ndarray:
        return np.where(chance.random(count) < 0.5, 10.0 ** chance.uniform(-9, 9, count), 1.0)

    usual = Body.of(craft)
    heavier = size()
    stiffer = np.clip(size(), 1e-7, 1e8)
    stronger = size()
    away = tuple(size() * chance.normal(size=count) for _ in usual.centre)
    found = replace(
        usual,
        mass=usual.mass * heavier,
        inertia=tuple(x * stiffer for x in usual.inertia),
        centre=away,
    )
    weaker = stronger * np.minimum(1.0, _flyable(craft, found, stiffer, stronger, period))
    return replace(found, gain=tuple(weaker for _ in usual.gain))


def _flyable(
    craft: Spacecraft, body: Body, stiffer: np.ndarray, stronger: np.ndarray, period: float
) -> np.ndarray:
    """Of each body, by how much thrusters so strong may be stronger and one command can still be flown."""
    table = np.array(craft.wrench_map)
    tensor = np.array(craft.inertia)
    force = np.linalg.norm(table[:, : craft.dimension], axis=1).sum()
    torque = np.linalg.norm(table[:, craft.dimension :], axis=1).sum()
    moment = tensor[2, 2] if craft.dimension == 2 else np.linalg.eigvalsh(tensor)[0]
    lever = np.linalg.norm(np.array(body.centre), axis=0)
    way = 0.5 * force * stronger / np.asarray(body.mass) * period**2
    turn = (torque + lever * force) * stronger / (moment * stiffer) * period**2
    return np.minimum(FARTHEST / way, WILDEST / turn) * (
        1.0 - 1e-9
    )  # rounded towards what is flown


def seen(step: Step) -> tuple[int, int]:
    """How many steps lost their state, and how many tell something that is no number."""
    silent = 0
    told = (step.observation.T, step.reward[None], step.terms)
    if not all(bool(torch.isfinite(x).all()) for x in told):
        silent = int((~torch.stack([torch.isfinite(x).all(dim=0) for x in told]).all(dim=0)).sum())
    if not step.terminated.any():
        return 0, silent
    return int((~torch.isfinite(step.final_observation[step.terminated]).all(dim=1)).sum()), silent


def flown(number: int, count: int, under: Sequence[str] = ()) -> Flown:
    """Steps of one extreme craft in ``count`` environments, on NumPy; under conditions or not, by chance."""
    chance = random.Random(f"craft {number}")
    craft = extreme(chance)
    task = _any_task(chance)
    conditions = chance.choice(
        [None, None, load_conditions(chance.choice(["lab", "harsh", "faults"]))]
    )
    conditions = _conditions(number, under) or conditions
    timing = Timing(_period(chance, under), substeps=chance.choice([1, 1, 4]), episode_steps=16)
    engine = Engine(craft, task, count, timing, seed=number, conditions=conditions)
    return _stepped(engine, number, _STEPS, 1)


def compiled(
    number: int, count: int = _BATCH, steps: int = _BATCHES, under: Sequence[str] = ()
) -> Flown:
    """Steps of as many extreme craft of one kind as environments, by a compiled program."""
    chance = random.Random(f"world {number}")
    craft = load_spacecraft(_KNOWN[number % len(_KNOWN)])
    task = _any_task(chance)
    timing = Timing(_period(chance, under), substeps=1, episode_steps=16)
    engine = Engine(
        craft,
        task,
        count,
        timing,
        seed=number,
        compiled=True,
        body=bodies(craft, count, number, timing.control_period),
        conditions=_conditions(number, under),
    )
    return _stepped(engine, number, steps, count)


def _period(chance: random.Random, under: Sequence[str]) -> float:
    """Seconds a command is held; shorter ones than 20 ms have hundreds of late commands, and take minutes."""
    return max(10.0 ** chance.uniform(-3, 1), 0.02 if under else 0.0)


def _conditions(number: int, under: Sequence[str]) -> Conditions | None:
    """Of every four numbers the same set, so that each of four craft meets each."""
    name = under[number // len(_KNOWN) % len(under)] if under else ""
    return load_conditions(name) if name else None


def _any_task(chance: random.Random) -> Task:
    return TASKS[chance.choice([name for name in TASKS if ":" not in name])]()


def _stepped(engine: Engine, number: int, steps: int, craft: int) -> Flown:
    generator = torch.Generator().manual_seed(number)
    actions = torch.rand(_STEPS, engine.num_envs, len(engine.craft.thrusters), generator=generator)
    if not engine.craft.actuators.is_continuous:
        actions = actions.round_()
    lost = silent = 0
    for k in range(steps):
        told = seen(engine.step(actions[k % _STEPS]))
        lost = lost + told[0]
        silent = silent + told[1]
    return Flown(steps * engine.num_envs, craft, 0, lost, silent, (number,) if silent else ())


def steps(most: float, first: int = 0, under: Sequence[str] = ()) -> Flown:
    """So many steps, of one extreme craft after the other, from a number on; under which conditions."""
    count = int(min(2048, max(1, most // _STEPS)))
    return _until(most, first, lambda number: flown(number, count, under))


def compiled_steps(most: float, first: int = 0, under: Sequence[str] = ()) -> Flown:
    """So many steps, of one world of extreme craft after the other, as above.

    Under conditions, of which each costs a compilation, every world has its share of the steps: each craft
    meets each set.
    """
    count = int(min(_BATCH, max(1, most // _STEPS)))
    each = min(_BATCHES, int(most // count // (len(_KNOWN) * len(under) or 1)) or 1)
    return _until(most, first, lambda number: compiled(number, count, each, under))


def _until(most: float, first: int, fly: Callable[[int], Flown]) -> Flown:
    done = Flown()
    number = first
    started = time.monotonic()
    with warnings.catch_warnings(
        action="ignore"
    ):  # most are too fast for their period, and it is said
        while done.steps < most:
            number += 1
            try:
                done += fly(number)
            except ConfigError:
                done += Flown(refused=1)
    return replace(done, seconds=time.monotonic() - started)
