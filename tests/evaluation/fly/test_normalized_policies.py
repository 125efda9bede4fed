"""Stable-Baselines3 policies that were trained behind VecNormalize, whose statistics are in a second file."""

from __future__ import annotations

import pickle
import shutil
from pathlib import Path

import numpy as np
import pytest
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.vec_env import VecNormalize

import rans
from rans.errors import ConfigError
from rans.evaluation.fly.foreign_policy import policy_of
from rans.evaluation.fly.user_policy import user_policy
from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import load_spacecraft
from rans.tasks import GoToPose

CRAFT = load_spacecraft("floating-platform")
THROTTLED = load_spacecraft(str(Path("examples/trainers/throttled-platform.toml")))
OBSERVATIONS = np.random.default_rng(3).normal(size=(64, 10)).astype(np.float32)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A model that was trained behind a VecNormalize, both as SB3 saves them."""
    path = tmp_path_factory.mktemp("trained")
    environment = VecNormalize(rans.SB3VecEnv(rans.Engine(CRAFT, GoToPose(), num_envs=16)))
    model = PPO("MlpPolicy", environment, n_steps=16, batch_size=64, n_epochs=2, seed=0)
    model.learn(512)
    model.save(path / "model.zip")
    environment.save(str(path / "vecnormalize.pkl"))
    return path


def predicted(folder: Path, observations: np.ndarray) -> np.ndarray:
    """What Stable-Baselines3 itself answers, by its own functions."""
    environment = rans.SB3VecEnv(rans.Engine(CRAFT, GoToPose(), num_envs=16))
    normalized = VecNormalize.load(str(folder / "vecnormalize.pkl"), environment)
    normalized.training = False
    model = PPO.load(folder / "model.zip", device="cpu")
    return model.predict(normalized.normalize_obs(observations), deterministic=True)[0]


@pytest.mark.parametrize(
    ("model", "statistics"),
    [
        ("model.zip", "vecnormalize.pkl"),
        ("best.zip", "best_vecnormalize.pkl"),
        ("ppo_512_steps.zip", "ppo_vecnormalize_512_steps.pkl"),  # SB3's CheckpointCallback
    ],
)
def test_statistics_beside_a_model_scale_its_observations(
    folder: Path, tmp_path: Path, model: str, statistics: str
) -> None:
    shutil.copy(folder / "model.zip", tmp_path / model)
    shutil.copy(folder / "vecnormalize.pkl", tmp_path / statistics)
    policy = user_policy(f"sb3:{tmp_path / model}", CRAFT, GoToPose(), trust=True)
    expected = predicted(folder, OBSERVATIONS)
    np.testing.assert_array_equal(policy.act(None, None, OBSERVATIONS), expected)
    raw = PPO.load(folder / "model.zip", device="cpu").predict(OBSERVATIONS, deterministic=True)[0]
    assert not np.array_equal(raw, expected)  # or the statistics would not matter
    again = pickle.loads(pickle.dumps(policy))  # as another process loads it
    np.testing.assert_array_equal(again.act(None, None, OBSERVATIONS), expected)


def test_missing_statistics_are_said(folder: Path, tmp_path: Path) -> None:
    shutil.copy(folder / "model.zip", tmp_path)
    with pytest.warns(UserWarning, match=r"observations are passed to it as they are.*Save the"):
        user_policy(f"sb3:{tmp_path / 'model.zip'}", CRAFT, GoToPose(), trust=True)


@pytest.mark.parametrize("craft", ["floating-platform", "free-flyer"])
def test_a_policy_of_plain_observations_is_not_warned_of(tmp_path: Path, craft: str) -> None:
    """Warnings are errors here."""
    plain = load_spacecraft(craft)
    environment = rans.SB3VecEnv(rans.Engine(plain, GoToPose(), num_envs=16))
    PPO("MlpPolicy", environment, n_steps=4, batch_size=64, seed=0).learn(64).save(
        tmp_path / "model.zip"
    )
    user_policy(f"sb3:{tmp_path / 'model.zip'}", plain, GoToPose(), trust=True)


def off_policy(craft: Spacecraft, file: Path) -> None:
    environment = VecNormalize(rans.SB3VecEnv(rans.Engine(craft, GoToPose(), num_envs=4)))
    SAC("MlpPolicy", environment, learning_starts=1000, buffer_size=1000).learn(8).save(file)


def test_missing_statistics_of_an_off_policy_model_are_said(tmp_path: Path) -> None:
    off_policy(THROTTLED, tmp_path / "model.zip")
    with pytest.warns(UserWarning, match="observations are passed to it as they are"):
        user_policy(f"sb3:{tmp_path / 'model.zip'}", THROTTLED, GoToPose(), trust=True)


def test_a_model_behind_its_environment_scales_too(folder: Path) -> None:
    environment = rans.SB3VecEnv(rans.Engine(CRAFT, GoToPose(), num_envs=16))
    normalized = VecNormalize.load(str(folder / "vecnormalize.pkl"), environment)
    model = PPO.load(folder / "model.zip", env=normalized, device="cpu")
    policy = policy_of(model, CRAFT, GoToPose())
    answer, memory = policy(OBSERVATIONS, None, np.ones(64, bool))
    np.testing.assert_array_equal(answer, predicted(folder, OBSERVATIONS))
    assert memory is None


@pytest.mark.parametrize("content", [b"no pickle", pickle.dumps({"obs_rms": 1})])
def test_other_files_of_that_name_are_named(folder: Path, tmp_path: Path, content: bytes) -> None:
    shutil.copy(folder / "model.zip", tmp_path)
    (tmp_path / "vecnormalize.pkl").write_bytes(content)
    with pytest.raises(
        ConfigError, match=r"vecnormalize\.pkl lies beside model\.zip and is no Vec"
    ):
        user_policy(f"sb3:{tmp_path / 'model.zip'}", CRAFT, GoToPose(), trust=True)


def test_statistics_of_another_policy_are_refused(folder: Path, tmp_path: Path) -> None:
    shutil.copy(folder / "model.zip", tmp_path)
    other = rans.SB3VecEnv(rans.Engine("free-flyer", GoToPose(), num_envs=2))
    VecNormalize(other).save(str(tmp_path / "vecnormalize.pkl"))
    with pytest.raises(ConfigError, match=r"has \(10,\): it is another policy's"):
        user_policy(f"sb3:{tmp_path / 'model.zip'}", CRAFT, GoToPose(), trust=True)


def test_without_trust_no_pickle_beside_a_model_is_opened(tmp_path: Path) -> None:
    """Also of an agent that RANS wrote, which alone needs no trust."""
    engine = rans.Engine(CRAFT, GoToPose(), num_envs=2)
    rans.PPO(rans.SB3VecEnv(engine), n_steps=2, batch_size=2).save(tmp_path / "policy.zip")
    user_policy(f"sb3:{tmp_path / 'policy.zip'}", CRAFT, GoToPose())
    (tmp_path / "vecnormalize.pkl").write_bytes(b"whatever")
    with pytest.raises(ConfigError, match=r"is a pickle: .*--trust; if it is another policy's"):
        user_policy(f"sb3:{tmp_path / 'policy.zip'}", CRAFT, GoToPose())
