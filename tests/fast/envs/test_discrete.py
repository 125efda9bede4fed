"""Other algorithms than PPO: DQN behind a wrapper, SAC and TD3 on a throttled craft."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
import pytest

import rans  # noqa: F401  (registers the environments)
from rans.errors import ConfigError
from rans.fast.envs.discrete import DiscreteThrusters
from rans.model.actuators import Throttle
from rans.model.spacecraft_file import load_spacecraft

THROTTLED = replace(load_spacecraft("floating-platform"), actuators=Throttle())


def make(craft: Any = "floating-platform", dimension: int = 2) -> Any:
    return gymnasium.make(f"rans/GoToPose{dimension}D-v0", spacecraft=craft)


def test_bits_open_thrusters() -> None:
    wrapped = DiscreteThrusters(make())
    assert wrapped.action_space == gymnasium.spaces.Discrete(256)
    assert wrapped.action(np.int64(5)).tolist() == [1, 0, 1, 0, 0, 0, 0, 0]
    assert wrapped.action(np.int64(128)).tolist() == [0, 0, 0, 0, 0, 0, 0, 1]
    plain = make()
    wrapped.reset(seed=3)
    plain.reset(seed=3)
    after = plain.step(np.array([1, 1, 0, 0, 0, 0, 0, 0]))[0]
    np.testing.assert_array_equal(wrapped.step(np.int64(3))[0], after)


def test_others_are_refused() -> None:
    with pytest.raises(ConfigError, match="up to 10 thrusters, got 16, which are 65,536"):
        DiscreteThrusters(make("free-flyer", 3))
    env = make()
    env.action_space = gymnasium.spaces.MultiDiscrete([2] * 11)
    with pytest.raises(ConfigError, match="up to 10 thrusters, got 11, which are 2,048"):
        DiscreteThrusters(env)
    with pytest.raises(ConfigError, match="needs on/off thrusters, got the action space Box"):
        DiscreteThrusters(make(THROTTLED))
