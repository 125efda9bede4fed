"""Trainings from Python: settings by keyword."""

import json
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import pytest

import rans
from rans import ConfigError
from rans.api.training import config_of
from rans.episode.step import Setup
from rans.evaluation.fly.contestants import contestant
from rans.fast.learn.config import to_table, training
from rans.fast.learn.run_folder import run_path
from rans.model.spacecraft_file import load_spacecraft, to_toml


def test_settings_by_keyword(tmp_path):
    """Entries of the network's training and of the task, by their own names."""
    agent = rans.train(
        "go-to-pose",
        total_timesteps=64,
        output=tmp_path / "mine",
        n_envs=4,
        n_steps=8,
        batch_size=8,
        thrust_weight=0.07,
        layers=(8,),
    )
    assert agent.folder == tmp_path / "mine"
    assert agent.task == rans.GoToPose(thrust_weight=0.07)
    config = rans.fast.learn.run_folder.read_config(tmp_path / "mine" / "config.json")
    assert (config.ppo.n_envs, config.ppo.layers) == (4, (8,))


def test_a_training_of_another_run_is_its_config(tmp_path):
    """With what is given in the place of what it has; a spacecraft that has changed since is refused."""
    config = config_of("go-to-pose", "floating-platform", "cpu", changes={"gamma": 0.9}, seed=3)
    file = tmp_path / "config.json"
    file.write_text(json.dumps(to_table(config)))
    assert config_of(str(file)) == config
    assert config_of(str(file), seed=4, changes={"gamma": 0.95}) == replace(
        config, seed=4, ppo=replace(config.ppo, gamma=0.95)
    )
    (tmp_path / "spacecraft.toml").write_text(to_toml(load_spacecraft("pingu")))
    with pytest.raises(ConfigError, match="has changed since"):
        config_of(str(file))


def test_a_controller_is_tuned_at_the_rate_at_which_it_flies_a_file(tmp_path):
    """Quick to turn, this craft flies at 10 Hz; settings that were tuned at 5 Hz were never used."""
    own = tmp_path / "mine.toml"
    own.write_text(to_toml(load_spacecraft("floating-platform")))
    flown = contestant(f"lqr:go-to-pose-2d@{own}")
    assert flown.timing.control_period < flown.task.timing.control_period
    found = rans.tune("lqr", spacecraft=own, candidates=1, starts=1, output=tmp_path / "lqr.json")
    assert found.fits("lqr", Setup(flown.craft, flown.task, flown.timing))


def test_trainings_that_begin_at_once_have_a_folder_each(here):
    with ThreadPoolExecutor(8) as threads:
        folders = [*threads.map(run_path, [training("go-to-pose")] * 40)]
    assert len({*folders}) == 40
    assert all(folder.is_dir() for folder in folders)


def test_a_training_that_does_not_begin_leaves_no_folder(here):
    with pytest.raises(ConfigError, match="constraints"):
        rans.train("go-to-pose", guard=True)
    assert list(here.iterdir()) == []


@pytest.mark.parametrize("own", ["fly.html", "metrics.jsonl", "agent.safetensors", "tensorboard"])
def test_files_of_the_user_are_not_replaced(own, here):
    (here / own).write_text("mine")
    with pytest.raises(ConfigError, match=f"has {own} already"):
        rans.train("go-to-pose", output=".", total_timesteps=10)
    assert (here / own).read_text() == "mine"
