"""Other algorithms than PPO: DQN behind a wrapper, SAC and TD3 on a throttled craft."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
import pytest
from stable_baselines3 import DQN, SAC

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


@pytest.mark.parametrize("algorithm", [DQN, SAC])
def test_other_algorithms_train(algorithm: Any) -> None:
    """A few hundred steps change the policy; that it can also be learned from is theirs to show."""
    env = DiscreteThrusters(make()) if algorithm is DQN else make(THROTTLED)
    model = algorithm(
        "MlpPolicy",
        env,
        learning_starts=50,
        train_freq=4,
        buffer_size=500,
        batch_size=16,
        policy_kwargs={"net_arch": [8]},
        seed=1,
        device="cpu",
    )
    before = [p.detach().clone() for p in model.policy.parameters()]
    model.learn(300)
    after = list(model.policy.parameters())
    assert all(p.isfinite().all() for p in after)
    assert any((p != old).any() for p, old in zip(after, before, strict=True))
    assert model.num_timesteps >= 300
