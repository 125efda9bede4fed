from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
import torch
from stable_baselines3.common.monitor import Monitor

import rans
from rans import ConfigError, Engine, SB3VecEnv
from tests.support.engines import NEAR, PLATFORM, SHORT, actions, both_crafts

LENIENT = dataclasses.replace(NEAR, position_tolerance=9.0, attitude_tolerance=9.0)
"""Who does not fail succeeds."""


def make(craft: Any = PLATFORM, count: int = 16, seed: int = 1, **kwargs: Any) -> SB3VecEnv:
    return SB3VecEnv(Engine(craft, LENIENT, count, SHORT, seed=seed, **kwargs))


def commands(env: SB3VecEnv, steps: int) -> np.ndarray:
    return actions(env.engine.craft, env.num_envs, steps).numpy()


@both_crafts
def test_it_says_what_the_engine_does(craft):
    env = make(craft)
    engine = Engine(craft, LENIENT, 16, SHORT)
    env.seed(4)
    np.testing.assert_array_equal(env.reset(), engine.reset(4))
    ends = np.zeros(2, dtype=int)
    for action in commands(env, 60):
        observation, reward, done, infos = env.step(action)
        step = engine.step(torch.from_numpy(action))
        np.testing.assert_array_equal(observation, step.observation)  # type: ignore[arg-type]
        np.testing.assert_array_equal(reward, step.reward)
        np.testing.assert_array_equal(done, step.terminated | step.truncated)
        for i, info in enumerate(infos):
            if not done[i]:
                assert info == {}
                continue
            np.testing.assert_array_equal(info["terminal_observation"], step.final_observation[i])
            truncated = bool(step.truncated[i])
            assert truncated is not bool(step.terminated[i])
            assert (info["TimeLimit.truncated"], info["at_goal"]) == (truncated, truncated)
        ends += int(step.terminated.sum()), int(step.truncated.sum())
    assert ends.min() > 5  # the test saw both kinds


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_arrays_are_what_sb3_keeps(dtype):
    env = make(dtype=dtype)
    first = env.reset()
    observation, reward, done, infos = env.step(np.zeros((16, 8), dtype=np.int64))
    assert [x.dtype for x in (first, observation, reward, done)] == [np.float32] * 3 + [np.bool_]  # type: ignore[union-attr]
    assert env.observation_space.contains(first[0])
    assert len({id(info) for info in infos}) == 16  # wrappers write into them


def test_a_seed_counts_once():
    env = make()
    env.seed(3)
    first = np.asarray(env.reset())
    second = np.asarray(env.reset())
    assert (first != second).any(axis=1).all()
    env.seed(3)
    np.testing.assert_array_equal(env.reset(), first)  # type: ignore[arg-type]
    np.testing.assert_array_equal(env.reset(), second)  # type: ignore[arg-type]


def test_attributes_are_those_of_the_batch():
    env = make(count=3)
    assert env.get_attr("engine") == [env.engine] * 3
    assert env.get_attr("engine", indices=[0, 2]) == [env.engine] * 2
    env.set_attr("note", "seen")
    assert env.get_attr("note", indices=1) == ["seen"]
    assert env.env_method("seed", 4, indices=0) == [[4, 4, 4]]
    assert env.env_is_wrapped(Monitor) == [False] * 3
    env.close()


def test_ended_episodes_are_logged_without_a_monitor():
    """As many steps as an episode has; the return is the sum of the rewards that were handed out."""
    engine = rans.Engine("floating-platform", "go-to-pose", 3, rans.Timing(episode_steps=5))
    env = rans.SB3VecEnv(engine)
    env.reset()
    action = np.zeros((3, 8))
    for _ in range(2):
        total = np.zeros(3)
        infos = []
        for step in range(5):
            _, reward, done, infos = env.step(action)
            total += reward
            assert done.all() == (step == 4)
        for number, info in enumerate(infos):
            assert info["episode"]["l"] == 5
            assert info["episode"]["r"] == pytest.approx(total[number], abs=1e-5)


def test_an_option_that_it_has_not_is_a_sentence():
    """Once: the next reset has none."""
    env = make(count=2)
    for options in ({"scenario": 1}, [{}, {"scenario": 1}]):
        env.set_options(options)
        with pytest.raises(ConfigError, match="unknown option 'scenario' of reset"):
            env.reset()
        env.reset()
