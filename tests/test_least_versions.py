"""The least versions that pyproject.toml allows run a command of each kind."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

PROJECT = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text("utf-8"))[
    "project"
]
LINES = (
    "list",
    "init own.toml",
    "train go-to-pose --output run --set ppo.n_envs=8 --set ppo.n_steps=4 --set ppo.batch_size=16 "
    "--set timing.episode_steps=20 --set total_timesteps=64",
    "evaluate go-to-pose-2d --episodes 2",
    "compare go-to-pose-2d --with lqr --episodes 2 --certified 0",
    "export go-to-pose-2d --format onnx --output onnx",
    "evaluate onnx:onnx/agent.onnx:go-to-pose-2d --episodes 2",
    "view go-to-pose-2d --episodes 1 --save replay.html",
)


def least() -> list[str]:
    """Requirements NAME==VERSION of the core and of two extras, but for torch, whose builds have GB."""
    extras = PROJECT["optional-dependencies"]
    lines = [*PROJECT["dependencies"], *extras["onnx"], *extras["plots"]]
    found = [re.match(r"([\w-]+)(?:\[.*\])?>=([\d.]+)", line) for line in lines]
    return [
        f"{one[1]}=={one[2]}" for one in found if one and one[1] not in ("torch", "tensorboard")
    ]


@pytest.mark.slow
def test_a_command_of_each_kind_runs_on_the_least_versions(tmp_path):
    """Least versions are fetched from the index into a folder; without a network the test is skipped."""
    old = tmp_path / "old"
    install = [sys.executable, "-m", "pip", "install", "--quiet", "--target", str(old)]
    fetched = subprocess.run([*install, *least()], capture_output=True, text=True, check=False)
    if "onnection" in fetched.stderr:
        pytest.skip("the index cannot be reached")
    assert fetched.returncode == 0, fetched.stderr
    env = os.environ | {"PYTHONPATH": str(old)}
    for line in LINES:
        words = [sys.executable, "-P", "-m", "rans", *line.split()]
        done = subprocess.run(
            words, cwd=tmp_path, env=env, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, f"{line}\n{done.stderr}"
