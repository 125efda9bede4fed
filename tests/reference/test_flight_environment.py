"""The environment on Drake: Gymnasium's and SB3's rules, and the fast environment's rewards."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from stable_baselines3 import PPO
from stable_baselines3.common.env_checker import check_env as check_env_for_sb3

from rans.errors import ConfigError
from rans.model.timing import Timing
from rans.reference.flight import DrakeEnv
from rans.tasks import gymnasium_ids
from tests.support.crafts import ANY_CRAFT, nasty_planar, nasty_spatial

# Every task with a craft that the shipped one does not resemble, by turns in the plane and in space.
NASTY = {
    gymnasium_ids(task)[number % 2]: (nasty_planar, nasty_spatial)[number % 2]()
    for number, task in enumerate(ANY_CRAFT)
}
SHIPPED = ["rans/GoToPose2D-v0", "rans/GoToPose3D-v0"]


def drake(name: str, **kwargs: Any) -> gymnasium.Env[Any, Any]:
    env = gymnasium.make(name.replace("-v0", "-Drake-v0"), **kwargs).unwrapped
    assert isinstance(env, DrakeEnv)
    return env


@pytest.mark.parametrize("name", NASTY)
def test_gymnasium_and_sb3_find_nothing_wrong(name: str) -> None:
    check_env(drake(name), skip_render_check=True)
    check_env_for_sb3(drake(name))


@pytest.mark.parametrize(
    ("name", "nasty"), [*((name, True) for name in NASTY), *((name, False) for name in SHIPPED)]
)
def test_same_rewards_and_ends_as_the_fast_environment(name: str, nasty: bool) -> None:
    """Two episodes of a seed under the same random commands, at a step size that plays no part."""
    craft: dict[str, Any] = {"spacecraft": NASTY[name]} if nasty else {}
    timing = Timing(substeps=32, episode_steps=8)
    ours, judge = (flown(make(name, timing=timing, **craft)) for make in (gymnasium.make, drake))
    for (seen, reward, *ends, info), (
        seen_in_drake,
        reward_in_drake,
        *ends_in_drake,
        info_in_drake,
    ) in zip(ours, judge, strict=True):
        # 8 periods at 32 substeps are true to 1e-8 m; rewards change at most by 4 a metre (1 / scale,
        # up to 20 for narrow ones); observations are rounded to float32, 5e-7 of a way of 4 m.
        assert reward_in_drake == pytest.approx(reward, abs=2e-7)
        np.testing.assert_allclose(seen_in_drake, seen, atol=1e-6)
        assert ends_in_drake == ends
        assert info_in_drake["reward_terms"] == pytest.approx(info["reward_terms"], abs=2e-7)
        assert info_in_drake.keys() == info.keys()


def flown(env: Any) -> list[Any]:
    random = np.random.default_rng(3)
    results = []
    for seed in (5, None):
        env.reset(seed=seed)
        ended = False
        while not ended:
            action = random.integers(0, 2, env.action_space.shape)
            results.append(env.step(action))
            ended = results[-1][2] or results[-1][3]
    return results


def test_sb3_trains_on_it() -> None:
    env = gymnasium.make("rans/GoToPose2D-Drake-v0", timing=Timing(episode_steps=10))
    model = PPO("MlpPolicy", env, n_steps=32, batch_size=16, n_epochs=1, seed=1, device="cpu")
    before = [p.detach().clone() for p in model.policy.parameters()]
    model.learn(64)
    assert model.num_timesteps == 64
    assert any((a != b).any() for a, b in zip(before, model.policy.parameters(), strict=True))


def test_several_side_by_side() -> None:
    envs = gymnasium.make_vec("rans/GoToPose3D-Drake-v0", num_envs=2, vectorization_mode="sync")
    seen, _ = envs.reset(seed=1)
    assert seen.shape == (2, 22)
    assert envs.step(envs.action_space.sample())[1].shape == (2,)


def test_an_inertia_only_drake_refuses_is_a_sentence() -> None:
    flat = ((0.1, 0.0, 0.0), (0.0, 0.1, 0.0), (0.0, 0.0, 0.2 * (1 + 5e-10)))
    with pytest.raises(ConfigError, match="Drake refuses its inertia"):
        drake("rans/GoToPose2D-v0", spacecraft=replace(nasty_planar(), inertia=flat))


def test_registering_it_loads_no_drake() -> None:
    program = (
        "import sys, rans, gymnasium; gymnasium.spec('rans/GoToPose2D-Drake-v0'); "
        "print('pydrake' in sys.modules)"
    )
    run = subprocess.run(
        [sys.executable, "-c", program],
        check=True,
        capture_output=True,
        text=True,
        cwd=Path(__file__).parents[2],
    )
    assert run.stdout.strip() == "False"
