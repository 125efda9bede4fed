"""Other libraries' trainers on the batched environment, as `examples/trainers` shows them."""

from __future__ import annotations

import importlib.util
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[1] / "examples" / "trainers"
LIBRARIES = {
    "cleanrl_ppo": "torch",
    "rans_ppo": "torch",
    "rl_games_ppo": "rl_games",
    "rsl_rl_ppo": "rsl_rl",
    "sb3_agents": "stable_baselines3",
    "skrl_ppo": "skrl",
    "tianshou_ppo": "tianshou",
    "torchrl_ppo": "torchrl",
}
SHARED = {"shared", "table"}


def test_every_example_is_run() -> None:
    assert {file.stem for file in FOLDER.glob("*.py")} == LIBRARIES.keys() | SHARED


@pytest.mark.slow
@pytest.mark.trainers
@pytest.mark.parametrize("name", LIBRARIES)
def test_it_trains_and_is_judged(name: str, tmp_path: Path) -> None:
    """One rollout and its update, in a process of its own; then its agent flies in RANS."""
    if importlib.util.find_spec(LIBRARIES[name]) is None:
        pytest.skip(f"{LIBRARIES[name]} is not installed")
    run = subprocess.run(
        [sys.executable, str(FOLDER / f"{name}.py"), "--steps", "8192", "--episodes", "16"],
        cwd=tmp_path,
        env=os.environ | {"OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        timeout=1800,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    assert re.search(
        r"\d+ steps, .* of a core\): solved [\d.]+, settling time \S+, impulse [\d.]+", run.stdout
    )
