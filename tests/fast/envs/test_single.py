from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env
from stable_baselines3.common.env_checker import check_env as check_env_for_sb3

import rans
from rans import SpacecraftEnv, Timing
from rans.episode.scenario import Scenario, scenario
from rans.model.spacecraft_file import load_spacecraft
from rans.tasks import TASKS, gymnasium_ids, observation
from tests.support.crafts import ANY_CRAFT
from tests.support.processes import loaded
from tests.support.states import planar

PLANE = "rans/GoToPose2D-v0"
SHUT = np.zeros(8, dtype=np.int64)
# Every task, by turns in the plane and in space.
ALL_IDS = pytest.mark.parametrize(
    "name", [gymnasium_ids(name)[2 + number % 2] for number, name in enumerate(ANY_CRAFT)]
)
TWO_IDS = pytest.mark.parametrize("name", [PLANE, gymnasium_ids("multi-task")[3]])


def make(name: str = PLANE, **kwargs: Any) -> SpacecraftEnv:
    env = gymnasium.make(name, **kwargs).unwrapped
    assert isinstance(env, SpacecraftEnv)
    return env


def first_observation(env: SpacecraftEnv, seed: int, episode: int) -> np.ndarray:
    chosen = scenario(env.task, env.craft.dimension, seed, episode)
    return np.array(observation(env.task, chosen.start, chosen.goal), dtype=np.float32)


@pytest.mark.slow
def test_every_registered_id_is_made_and_every_task_has_its_ids():
    ids = [name for name in gymnasium.registry if name.startswith("rans/")]
    assert {"rans/GoToXY-v0", "rans/TrackXYZVelocityAttitude-Drake-v0"} < set(ids)
    assert len(ids) == 2 * sum(len(kind.dimensions) for kind in TASKS.values())
    for name in ids:
        gymnasium.make(name).reset(seed=0)


@ALL_IDS
def test_gymnasium_and_sb3_find_nothing_wrong(name):
    check_env(make(name, render_mode="rgb_array"))
    check_env_for_sb3(make(name))


@TWO_IDS
def test_results_are_plain_numbers(name):
    env = make(name)
    _, info = env.reset(seed=1)
    assert info.keys() == {"errors"}
    seen, reward, *ends, info = env.step(env.action_space.sample())
    assert [type(x) for x in (seen, reward, *ends)] == [np.ndarray, float, bool, bool]
    assert type(info.pop("at_goal")) is bool
    assert info.keys() == {"reward_terms", "errors"}
    assert {type(x) for group in info.values() for x in group.values()} == {float}
    # Python sums floats in more digits than it shows from 3.12 on; each term is below 1.
    assert math.isclose(sum(info["reward_terms"].values()), reward, rel_tol=1e-15, abs_tol=1e-15)


@pytest.mark.parametrize(
    ("start", "success"),
    [
        (planar(0.04), True),
        (planar(0.06), False),
        (planar(heading=math.radians(4.9)), True),
        (planar(heading=math.radians(5.1)), False),
    ],
)
def test_success_is_to_be_there_when_time_is_up(start, success):
    env = make(timing=Timing(episode_steps=2))
    env.reset(options={"scenario": Scenario(start, planar())})
    env.step(SHUT)
    assert env.step(SHUT)[4]["at_goal"] is success


@TWO_IDS
def test_seed_starts_episode_0_and_resets_count_on(name):
    env = make(name)
    for seed in (3, 2**40):
        for episode in range(3):
            seen, _ = env.reset(seed=seed if episode == 0 else None)
            np.testing.assert_array_equal(seen, first_observation(env, seed, episode))


def test_without_a_seed_episodes_are_random():
    assert (make().reset()[0] != make().reset()[0]).any()
    first = make()
    second = make()
    first.np_random = np.random.default_rng(5)
    second.np_random = np.random.default_rng(5)
    for _ in range(2):
        np.testing.assert_array_equal(first.reset()[0], second.reset()[0])


@TWO_IDS
def test_a_given_scenario_is_flown(name):
    env = make(name)
    chosen = scenario(env.task, env.craft.dimension, 8, 5)
    seen, _ = env.reset(seed=1, options={"scenario": chosen})
    np.testing.assert_array_equal(seen, first_observation(env, 8, 5))
    np.testing.assert_array_equal(env.reset()[0], first_observation(env, 1, 1))
    np.testing.assert_array_equal(
        env.reset(seed=np.int64(8))[0],  # type: ignore[arg-type]
        first_observation(env, 8, 0),
    )


def test_a_users_own_spacecraft(tmp_path):
    own = tmp_path / "mine.toml"
    shipped = Path(rans.__file__).parent / "data" / "spacecraft" / "floating-platform.toml"
    own.write_text(shipped.read_text("utf-8").replace('"floating-platform"', '"mine"'), "utf-8")
    craft = load_spacecraft("floating-platform")
    assert make(spacecraft=str(own)).craft.name == "mine"
    lonely = dataclasses.replace(craft, thrusters=(*craft.thrusters, craft.thrusters[0]))
    assert make(spacecraft=lonely).action_space.shape == (9,)


def test_reset_comes_first():
    for call in (lambda env: env.step(SHUT), lambda env: env.render()):
        with pytest.raises(ResetNeeded, match="call reset"):
            call(make(render_mode="rgb_array"))


@TWO_IDS
def test_frames_follow_the_flight(name):
    env = make(name, render_mode="rgb_array", timing=Timing(control_period=0.5))
    assert env.metadata["render_fps"] == 2.0
    env.reset(seed=1)
    first = env.render()
    again = env.render()
    assert (first.shape, first.dtype) == ((480, 640, 3), np.uint8)
    np.testing.assert_array_equal(first, again)
    env.step(env.action_space.sample() | 1)
    assert (env.render() != first).any()
    env.reset(seed=1)
    np.testing.assert_array_equal(env.render(), first)


def test_no_render_mode_no_frame():
    env = make()
    env.reset(seed=1)
    assert env.render() is None


def test_the_single_environment_needs_no_torch():
    """Nor does the user need to import rans: Gymnasium's "module:id" does."""
    program = (
        f"import gymnasium; env = gymnasium.make('rans:{PLANE}'); env.reset(seed=1); "
        "env.step(env.action_space.sample())"
    )
    assert {"torch", "matplotlib", "stable_baselines3"} & loaded(program) == set()


def test_the_spec_knows_the_length_of_an_episode():
    """Gymnasium's wrapper that observes the time needs it."""
    env = gymnasium.make("rans/GoToPose2D-v0", timing=rans.Timing(episode_steps=7))
    assert env.spec is not None
    assert env.spec.max_episode_steps == 7
    assert env.spec.reward_threshold is None  # 25 s have one
    timed = gymnasium.wrappers.TimeAwareObservation(env)
    assert timed.observation_space.contains(timed.reset(seed=0)[0])
