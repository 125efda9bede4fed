"""Other libraries' trainers on the batched environment, as `examples/trainers` shows them."""

import importlib.util
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import rans

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


def test_every_example_is_run():
    assert {file.stem for file in FOLDER.glob("*.py")} == LIBRARIES.keys() | SHARED


@pytest.mark.parametrize(
    ("name", "craft"),
    [
        ("rl-games-ppo", "floating-platform"),
        pytest.param("sb3-ppo", "floating-platform", marks=pytest.mark.slow),
        ("sb3-dqn", "floating-platform"),
        pytest.param("sb3-sac", str(FOLDER / "throttled-platform.toml"), marks=pytest.mark.slow),
        ("sb3-td3", str(FOLDER / "throttled-platform.toml")),
    ],
)
def test_a_saved_agent_flies_without_its_trainer(name, craft):
    pytest.importorskip("onnxruntime")
    agent = f"onnx:{FOLDER / 'agents' / name}.onnx:go-to-pose-2d@{craft}"
    # The environments of its training act every 0.2 s.
    assert rans.evaluate(agent, episodes=16, period=0.2)["solved"].value > 90.0


@pytest.mark.slow
@pytest.mark.trainers
@pytest.mark.parametrize("name", LIBRARIES)
def test_it_trains_and_is_judged(name, tmp_path):
    """One rollout and its update, in a process of its own; then its agent flies in RANS, also from its file."""
    if importlib.util.find_spec(LIBRARIES[name]) is None:
        pytest.skip(f"{LIBRARIES[name]} is not installed")
    command = [sys.executable, str(FOLDER / f"{name}.py"), "--steps", "8192", "--episodes", "16"]
    file = tmp_path / "agent.onnx"
    if name != "rans_ppo":  # whose run folder is its file
        command += ["--save", str(file)]
    run = subprocess.run(
        command,
        cwd=tmp_path,
        env=os.environ | {"OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        timeout=1800,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    said = re.search(
        r"\d+ steps, .* of a core\): solved [\d.]+, settling time \S+, impulse ([\d.]+)", run.stdout
    )
    assert said is not None
    if name != "rans_ppo":
        metrics = rans.load_agent(f"onnx:{file}:go-to-pose-2d").evaluate(episodes=16)
        assert metrics["impulse"].value == pytest.approx(float(said[1]), rel=0.02)
