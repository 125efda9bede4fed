"""What a flight remembers belongs to the flight: flights of one object that meet end as they do alone."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
import pytest

import rans
from rans import TASKS, ConfigError
from rans.episode.flight import Controller
from rans.episode.step import Setup
from rans.evaluation.fly.controllers import CONTROLLERS
from rans.evaluation.fly.episodes import fly_episodes

SEEDS = 1, 2
PERIODS = 12
"""Control periods of a flight: as many as every memory needs to differ from an empty one."""


class Counting:
    """A policy as Stable-Baselines3's recurrent ones: what it opens depends on how often it was asked."""

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, **_: Any
    ) -> Any:
        count = np.zeros(len(observation), int) if state is None else state[0]
        return np.arange(8) == count[:, None] % 8, (count + 1,)


class Delayed:
    """A user's controller that changes its lists, arrays and random numbers in place, and clears them so."""

    name = "delayed"

    def __init__(self) -> None:
        self._past: list[np.ndarray] = []
        self._owed = np.zeros((0, 8))
        self._random = np.random.default_rng(0)

    def reset(self, count: int) -> None:
        self._past.clear()
        self._owed.resize((count, 8), refcheck=False)
        self._owed[:] = 0.0

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        self._past.append(observation[:, 2:3] > 0.0)
        self._owed += self._past[len(self._past) // 2] * 0.3 + self._random.random(8) * 0.2
        opened = self._owed >= 1.0
        self._owed -= opened
        return opened.astype(float)


def of_agent(agent: Any, *given: Any) -> tuple[Controller, Setup]:
    run = rans.load_agent(agent, *given).run
    return run.controller, run.judged


def of_controller(name: str) -> tuple[Controller, Setup]:
    """The controller in the first task that it flies."""
    for task in TASKS:
        for dimension in (2, 3):
            try:
                return of_agent(f"{name}:{task}-{dimension}d")
            except ConfigError:
                continue
    raise AssertionError(f"{name} flies no task.")


class Nested:
    """Flies another flight of the controller in the middle of its own."""

    name = "nested"

    def __init__(self, inner: Controller, setup: Setup) -> None:
        self._inner = inner
        self._setup = setup
        self.observes = getattr(inner, "observes", True)

    def reset(self, count: int) -> None:
        self._inner.reset(count)
        self._periods = 0

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        commands = self._inner.act(state, goal, observation)
        self._periods += 1
        if self._periods == PERIODS // 2:
            short = self._setup._replace(timing=replace(self._setup.timing, episode_steps=2))
            fly_episodes(self._inner, short, 9, 1, workers=1)
        return commands


FLYERS: dict[str, Any] = {
    "history": lambda: of_agent("go-to-pose-2d-faults"),
    "adaptive": lambda: of_agent("adaptive:any-craft-2d"),
    "recurrent of SB3": lambda: of_agent(Counting(), "go-to-pose"),
    "own": lambda: (Delayed(), of_agent("go-to-pose-2d")[1]),
} | {name: lambda name=name: of_controller(name) for name in CONTROLLERS}


@pytest.mark.slow
@pytest.mark.parametrize("name", FLYERS)
def test_flights_of_one_controller_do_not_meet(name):
    """In one thread after one another, within one another, and in threads."""
    flyer, setup = FLYERS[name]()
    setup = setup._replace(timing=replace(setup.timing, episode_steps=PERIODS))

    def commands(seed, who=flyer):
        return fly_episodes(who, setup, seed, 2, workers=1).commands

    alone = [commands(seed) for seed in SEEDS]
    nested = commands(SEEDS[0], Nested(flyer, setup))
    with ThreadPoolExecutor(len(SEEDS)) as pool:
        beside = [*pool.map(commands, SEEDS)]
    for found, expected in zip([nested, *beside], [alone[0], *alone], strict=True):
        np.testing.assert_array_equal(found, expected)
    assert np.ptp(alone[0], axis=0).any(), "commands that never change show no memory"


@pytest.mark.parametrize(
    "who", ["go-to-pose-2d-faults", "switching:go-to-pose-2d", "mpc:go-to-pose-2d"]
)
def test_pilots_of_one_agent_by_turns(who):
    """With an evaluation in between, and with more environments than one."""
    agent = rans.load_agent(who)

    def flights(seeds):
        envs = [gymnasium.make("rans/GoToPose2D-v0", task=agent.task) for _ in seeds]
        seen = [env.reset(seed=seed)[0] for env, seed in zip(envs, seeds, strict=True)]
        pilots = [rans.Pilot(agent, env) for env in envs]
        given = []
        for k in range(PERIODS):
            given.append([pilot.act(x) for pilot, x in zip(pilots, seen, strict=True)])
            seen = [env.step(act)[0] for env, act in zip(envs, given[-1], strict=True)]
            if len(seeds) > 1 and k == PERIODS // 2:
                agent.fly(3)
        return np.array(given)

    together = flights(SEEDS)
    for k, seed in enumerate(SEEDS):
        np.testing.assert_array_equal(together[:, k], flights((seed,))[:, 0])
