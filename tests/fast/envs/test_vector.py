from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.vector import AutoresetMode
from torch import Tensor

from rans import ConfigError, Engine, SB3VecEnv, SpacecraftVectorEnv
from rans.episode.environment import observation_space
from rans.tasks import GoToPose, gymnasium_ids
from tests.support.engines import NEAR, SHORT, actions

PLANE = "rans/GoToPose2D-v0"
# The settings of `NEAR` are go-to-pose's; the other tasks reach the same code through the conformance suite.
BOTH_IDS = pytest.mark.parametrize("name", gymnasium_ids("go-to-pose").values())


def make(name: str = PLANE, count: int = 6, **kwargs: Any) -> SpacecraftVectorEnv:
    settings: dict[str, Any] = {"task": NEAR, "timing": SHORT, **kwargs}
    env = gymnasium.make_vec(name, num_envs=count, **settings)
    assert isinstance(env, SpacecraftVectorEnv)
    return env


def commands(env: SpacecraftVectorEnv, steps: int) -> Tensor:
    return actions(env.engine.craft, env.num_envs, steps)


@BOTH_IDS
def test_what_gymnasium_asks_of_it(name):
    env = make(name)
    single = gymnasium.make(name)
    assert env.num_envs == 6
    assert env.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    assert env.single_observation_space == single.observation_space
    assert env.single_action_space == single.action_space
    assert env.observation_space.shape == (6, *single.observation_space.shape)  # type: ignore[misc]
    assert env.action_space.shape == (6, *single.action_space.shape)  # type: ignore[misc]
    assert env.spec is not None
    assert env.spec.id == name
    env.close()
    env.close()
    assert env.closed


@BOTH_IDS
def test_frames_are_those_of_single_environments(name):
    many = make(name, 2, dtype=torch.float64, render_mode="rgb_array")
    single = gymnasium.make(name, task=NEAR, timing=SHORT, render_mode="rgb_array")
    many.reset(seed=3)
    single.reset(seed=3)
    frames = many.render()
    assert frames is not None
    np.testing.assert_array_equal(frames[0], single.render())  # type: ignore[arg-type]
    assert (frames[1] != frames[0]).any()


@BOTH_IDS
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_shapes_and_types(name, dtype):
    env = make(name, dtype=dtype)
    seen, info = env.reset(seed=1)
    assert info == {}
    results = env.step(env.action_space.sample())
    for observation in (seen, results[0], results[4]["final_obs"]):
        assert (observation.shape, observation.dtype) == (env.observation_space.shape, dtype)
        assert env.observation_space.contains(observation.numpy())
    for flags in (
        *results[2:4],
        results[4]["_final_obs"],
        results[4]["_final_info"],
        results[4]["final_info"]["at_goal"],
    ):
        assert (flags.shape, flags.dtype) == ((6,), torch.bool)
    terms = [value for key, value in results[4].items() if key.startswith("reward/")]
    for values in (results[1], *terms):
        assert (values.shape, values.dtype) == ((6,), dtype)
    torch.testing.assert_close(sum(terms), results[1])


def test_without_a_seed_episodes_are_random():
    def unseeded(generator=None):
        env = make()
        if generator is not None:
            env.np_random = generator
        return env.reset()[0]

    assert (unseeded() != unseeded()).any(dim=1).all()
    assert torch.equal(unseeded(np.random.default_rng(1)), unseeded(np.random.default_rng(1)))


def test_wrong_arguments():
    env = make()
    with pytest.raises(ConfigError, match="one of SAME_STEP, NEXT_STEP, got 'disabled'"):
        make(autoreset_mode="disabled")
    with pytest.raises(ConfigError, match="the options of reset must be a dict, got 3"):
        env.reset(options=3)  # type: ignore[arg-type]
    with pytest.raises(ConfigError, match="unknown option 'mask'"):
        env.reset(options={"mask": np.ones(6, dtype=bool)})


@pytest.mark.parametrize("beyond", [1.0 + 2.4e-7, -1.0 - 2.4e-7])
def test_rounding_does_not_break_the_bounds_of_observations(beyond, monkeypatch):
    """Rotations are known to come out 2.4e-7 beyond 1; here every column does, in all three environments."""
    space = observation_space(GoToPose(), 2)
    bounded = space.high < 2.0
    assert bounded.any()
    assert not bounded.all()
    seen = np.full((2, len(space.high)), beyond, np.float32)
    assert not space.contains(seen[0])
    make: Any = gymnasium.make_vec
    vector = make("rans/GoToPose2D-v0", num_envs=2, vectorization_mode="vector_entry_point")
    engine = Engine("floating-platform", "go-to-pose", num_envs=2)
    sb3 = SB3VecEnv(engine)
    for one in (vector.unwrapped.engine, engine):
        real = one.step
        monkeypatch.setattr(
            one,
            "step",
            lambda action, real=real: real(action)._replace(
                observation=torch.as_tensor(seen), final_observation=torch.as_tensor(seen)
            ),
        )
    vector.reset(seed=0)
    sb3.reset()
    commands = np.zeros((2, 8), int)
    observation, *_, info = vector.step(torch.as_tensor(commands))
    for given in (observation, info["final_obs"], sb3.step(commands)[0]):
        rows = np.asarray(given)
        assert all(map(space.contains, rows))
        np.testing.assert_array_equal(rows[:, ~bounded], seen[:, ~bounded])  # others are left
    single: Any = gymnasium.make("rans/GoToPose2D-v0").unwrapped
    single.reset(seed=0)
    single._world = SimpleNamespace(observe=lambda *_: list(seen[0]))
    assert space.contains(single._observe())
