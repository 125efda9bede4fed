from __future__ import annotations

import json
import os
from dataclasses import replace
from importlib import resources
from pathlib import Path

import pytest
import torch

from rans import ConfigError, RansWarning
from rans.base.files import LOCK, write_text
from rans.fast.learn.run_folder import RunFolder, read_config
from tests.support.training import CONFIG


@pytest.fixture
def run(tmp_path) -> RunFolder:
    folder = RunFolder(tmp_path / "deep" / "run")
    folder.begin(CONFIG, "rans train go-to-pose")
    return folder


def test_it_remembers_the_config(run):
    assert run.config() == CONFIG
    about = json.loads(run.config_file.read_text())["about"]
    assert about["command"] == "rans train go-to-pose"
    assert {"torch", "stable-baselines3", "revision", "python", "processor"} <= about[
        "environment"
    ].keys()
    assert read_config(run.config_file) == CONFIG


def test_the_spacecraft_is_the_one_of_then(tmp_path):
    """The user's file may change or vanish afterwards."""
    shipped = resources.files("rans") / "data" / "spacecraft" / "floating-platform.toml"
    file = tmp_path / "mine.toml"
    file.write_text(shipped.read_text("utf-8").replace("mass = 5.32", "mass = 7.25"))
    run = RunFolder(tmp_path / "run")
    run.begin(replace(CONFIG, spacecraft=str(file)), "rans train")
    file.unlink()
    assert run.spacecraft().mass == 7.25
    run.spacecraft_file.write_text(run.spacecraft_file.read_text().replace("7.25", "14.5"))
    with pytest.warns(RansWarning, match=r"spacecraft\.toml is not the file of the training"):
        assert run.spacecraft().mass == 14.5


def test_a_run_is_not_begun_twice(run):
    before = run.config_file.read_bytes()
    with pytest.raises(
        ConfigError, match=r"holds a training already; continue it with --resume .*run, or"
    ):
        run.begin(replace(CONFIG, seed=1), "rans train")
    assert run.config_file.read_bytes() == before


def test_a_folder_where_somebody_trains_is_not_begun(tmp_path):
    """Not even before the other has written anything."""
    first = RunFolder(tmp_path / "run")
    first.lock()
    with pytest.raises(ConfigError, match="is being trained by another process"):
        RunFolder(tmp_path / "run").begin(CONFIG, "rans train")
    first.begin(CONFIG, "rans train")
    with pytest.raises(ConfigError, match="is being trained by another process"):
        RunFolder(tmp_path / "run").lock()  # who held it before it began goes on holding it


def test_what_is_no_run(tmp_path):
    for folder, why in ((tmp_path, "it has no config.json"), (tmp_path / "x", "there is nothing")):
        with pytest.raises(ConfigError, match=f"is not a run folder: {why}"):
            RunFolder(folder).config()


def test_nobodys_spacecraft_is_written_over(tmp_path):
    """One that is being designed in the folder where somebody trains; what was begun and killed goes on."""
    file = tmp_path / "spacecraft.toml"
    file.write_text("mass = 1.0  # my own")
    with pytest.raises(
        ConfigError, match=r"spacecraft\.toml is a file already, and of another spacecraft"
    ):
        RunFolder(tmp_path).begin(CONFIG, "rans train")
    assert file.read_text() == "mass = 1.0  # my own"
    assert not (tmp_path / "config.json").exists()
    RunFolder(tmp_path / "killed").begin(CONFIG, "rans train")
    (tmp_path / "killed" / "config.json").unlink()
    RunFolder(tmp_path / "killed").begin(CONFIG, "rans train")


def test_a_checkpoint_is_whole_or_the_one_before(run, monkeypatch):
    run.save_checkpoint({"steps": 1, "weights": torch.arange(5)})

    real = Path.write_bytes

    def half(file, content):
        real(file, content[: len(content) // 2])
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(Path, "write_bytes", half)
        with pytest.raises(KeyboardInterrupt):
            run.save_checkpoint({"steps": 2})
    loaded = run.load_checkpoint("cpu")
    assert loaded["steps"] == 1
    assert loaded["weights"].tolist() == [0, 1, 2, 3, 4]
    assert [file.name for file in run.path.glob(".*")] == [LOCK]


def test_who_trains_on_removes_drafts_of_a_killed_training(run):
    """However young they are, but none of a process that lives, and no other file."""
    dead = 2**22 + 1  # above the largest number of a process on Linux
    left = run.path / f".{dead}.a4e4db52.agent.safetensors"
    kept = [
        run.path / f".{os.getppid()}.a4e4db52.agent.safetensors",
        run.path / f".{dead}.a4e4db52.evaluation.json",
    ]
    for file in (left, *kept):
        file.touch()
    run.lock()
    run.release()
    assert not left.exists()
    assert all(file.exists() for file in kept)


def test_who_comes_second_to_the_lock_is_refused(tmp_path, monkeypatch):
    """Another process may begin while this one waits for it."""
    monkeypatch.setattr(RunFolder, "lock", lambda self: write_text(self.config_file, "{}"))
    with pytest.raises(ConfigError, match="holds a training already"):
        RunFolder(tmp_path / "run").begin(CONFIG, "rans train")
