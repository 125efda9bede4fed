"""Stable-Baselines3 policies that were trained behind VecNormalize, whose statistics are in a second file."""

from __future__ import annotations

import importlib
import pickle
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from rans_foreign_policies.policies import policy_of
from stable_baselines3 import A2C, PPO, SAC, TD3
from stable_baselines3.common.policies import BasePolicy
from stable_baselines3.common.save_util import save_to_zip_file
from stable_baselines3.common.vec_env import VecNormalize

import rans
from rans import ConfigError, GoToPose
from rans.evaluation.fly.user_policy import user_policy
from rans.model.spacecraft_file import load_spacecraft

CRAFT = load_spacecraft("floating-platform")
THROTTLED = load_spacecraft(str(Path("examples/trainers/throttled-platform.toml")))
OBSERVATIONS = np.random.default_rng(3).normal(size=(64, 10)).astype(np.float32)


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
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
        ("ppo_512_steps.zip", "ppo_vecnormalize_512_steps.pkl"),  # SB3's CheckpointCallback
    ],
)
def test_statistics_beside_a_model_scale_its_observations(folder, tmp_path, model, statistics):
    shutil.copy(folder / "model.zip", tmp_path / model)
    shutil.copy(folder / "vecnormalize.pkl", tmp_path / statistics)
    policy = user_policy(f"sb3:{tmp_path / model}", CRAFT, GoToPose(), trust=True)
    expected = predicted(folder, OBSERVATIONS)
    np.testing.assert_array_equal(policy.act(None, None, OBSERVATIONS), expected)
    raw = PPO.load(folder / "model.zip", device="cpu").predict(OBSERVATIONS, deterministic=True)[0]
    assert not np.array_equal(raw, expected)  # or the statistics would not matter
    again = pickle.loads(pickle.dumps(policy))  # as another process loads it
    np.testing.assert_array_equal(again.act(None, None, OBSERVATIONS), expected)


def test_missing_statistics_are_said(folder, tmp_path):
    """Of a file, and of the object that SB3 makes of it."""
    shutil.copy(folder / "model.zip", tmp_path)
    with pytest.warns(UserWarning, match=r"observations are passed to it as they are.*Save the"):
        user_policy(f"sb3:{tmp_path / 'model.zip'}", CRAFT, GoToPose(), trust=True)
    with pytest.warns(UserWarning, match="observations are passed to it as they are"):
        policy_of(PPO.load(folder / "model.zip", device="cpu"), CRAFT, GoToPose())


ON_POLICY = {"n_steps": 4, "seed": 0}
OFF_POLICY = {"learning_starts": 8, "buffer_size": 1000, "seed": 0}
WITH_SDE = ON_POLICY | {"use_sde": True}


@pytest.mark.parametrize(
    ("kind", "craft", "options"),
    [
        (PPO, CRAFT, ON_POLICY | {"batch_size": 16}),
        (PPO, THROTTLED, WITH_SDE | {"batch_size": 16, "policy_kwargs": {"squash_output": True}}),
        (A2C, THROTTLED, WITH_SDE),
        (SAC, THROTTLED, OFF_POLICY | {"use_sde": True}),
        (TD3, THROTTLED, OFF_POLICY),
    ],
)
def test_what_an_algorithm_saves_flies_as_it_predicts(tmp_path, kind, craft, options):
    """As a file and as an object; warnings are errors here."""
    environment = rans.SB3VecEnv(rans.Engine(craft, GoToPose(), num_envs=4))
    model = kind("MlpPolicy", environment, **options).learn(32)
    model.save(tmp_path / "model.zip")
    width = model.observation_space.shape[0]
    seen = np.random.default_rng(3).normal(size=(64, width)).astype(np.float32)
    answer = model.predict(seen, deterministic=True)[0]
    policy = user_policy(f"sb3:{tmp_path / 'model.zip'}", craft, GoToPose(), trust=True)
    np.testing.assert_array_equal(policy.act(None, None, seen), answer)
    flown = policy_of(model, craft, GoToPose())(seen, None, np.ones(64, bool))[0]
    np.testing.assert_array_equal(flown, answer)


def test_a_model_behind_its_environment_scales_too(folder):
    environment = rans.SB3VecEnv(rans.Engine(CRAFT, GoToPose(), num_envs=16))
    normalized = VecNormalize.load(str(folder / "vecnormalize.pkl"), environment)
    model = PPO.load(folder / "model.zip", env=normalized, device="cpu")
    policy = policy_of(model, CRAFT, GoToPose())
    answer, memory = policy(OBSERVATIONS, None, np.ones(64, bool))
    np.testing.assert_array_equal(answer, predicted(folder, OBSERVATIONS))
    assert memory is None


@pytest.mark.parametrize("content", [b"no pickle", pickle.dumps({"obs_rms": 1})])
def test_other_files_of_that_name_are_named(folder, tmp_path, content):
    shutil.copy(folder / "model.zip", tmp_path)
    (tmp_path / "vecnormalize.pkl").write_bytes(content)
    with pytest.raises(
        ConfigError, match=r"vecnormalize\.pkl lies beside model\.zip and is no Vec"
    ):
        user_policy(f"sb3:{tmp_path / 'model.zip'}", CRAFT, GoToPose(), trust=True)


def test_statistics_of_another_policy_are_refused(folder, tmp_path):
    shutil.copy(folder / "model.zip", tmp_path)
    other = rans.SB3VecEnv(rans.Engine("free-flyer", GoToPose(), num_envs=2))
    VecNormalize(other).save(str(tmp_path / "vecnormalize.pkl"))
    with pytest.raises(ConfigError, match=r"has \(10,\): it is another policy's"):
        user_policy(f"sb3:{tmp_path / 'model.zip'}", CRAFT, GoToPose(), trust=True)


class Direct(BasePolicy):
    """A policy whose constructor takes no schedule, as those of sb3-contrib's ARS."""

    def __init__(self, observation_space: Any, action_space: Any, units: int = 8) -> None:
        super().__init__(observation_space, action_space)
        self.layer = torch.nn.Linear(observation_space.shape[0], units)

    def _predict(self, observation: Any, deterministic: bool = False) -> Any:
        return (self.layer(observation) > 0.0).long()


@pytest.mark.parametrize("prefix", ["", "_orig_mod."])  # the second is torch.compile's
def test_a_policy_is_made_as_its_class_is(prefix, tmp_path):
    environment = rans.SB3VecEnv(rans.Engine(CRAFT, GoToPose(), 2))
    spaces = {name: getattr(environment, name) for name in ("observation_space", "action_space")}
    policy = Direct(**spaces)
    data = {"policy_class": Direct, "policy_kwargs": {"units": 8}, **spaces}
    weights = {f"{prefix}{name}": x for name, x in policy.state_dict().items()}
    save_to_zip_file(tmp_path / "ars.zip", data, {"policy": weights})
    loaded = user_policy(f"sb3:{tmp_path / 'ars.zip'}", CRAFT, GoToPose(), trust=True)
    seen = np.random.default_rng(0).normal(size=(4, 10)).astype(np.float32)
    np.testing.assert_array_equal(loaded.act(None, None, seen), policy.predict(seen)[0])


def test_a_package_that_is_missing_is_named(tmp_path):
    class Gone:
        def __reduce__(self) -> Any:
            return importlib.import_module, ("gone_with_gym",)

    data = {"policy_class": Gone(), "observation_space": 0, "action_space": 0}
    save_to_zip_file(tmp_path / "old.zip", data, {})
    with pytest.raises(ConfigError, match="gone_with_gym"):
        user_policy(f"sb3:{tmp_path / 'old.zip'}", CRAFT, GoToPose(), trust=True)
