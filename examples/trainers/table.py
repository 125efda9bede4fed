"""The table of README.md: every trainer trains and is judged, one after the other; some minutes of a core each.

`python examples/trainers/table.py` prints it; names after it choose rows, such as `rl_games`. `--save agents`
writes agents/rl-games-ppo.onnx and so on, which fly without their trainers.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
from pathlib import Path

FOLDER = Path(__file__).parent
RUNS = {
    "rl_games PPO": ("rl_games_ppo.py", 3_000_000, "rl-games-ppo"),
    "RSL-RL PPO": ("rsl_rl_ppo.py", 3_000_000, "rsl-rl-ppo"),
    "CleanRL PPO": ("cleanrl_ppo.py", 3_000_000, "cleanrl-ppo"),
    "TorchRL PPO": ("torchrl_ppo.py", 1_500_000, "torchrl-ppo"),
    "skrl PPO": ("skrl_ppo.py", 2_000_000, "skrl-ppo"),
    "tianshou PPO": ("tianshou_ppo.py", 2_000_000, "tianshou-ppo"),
    "Stable-Baselines3 PPO": ("sb3_agents.py PPO", 3_000_000, "sb3-ppo"),
    "sb3-contrib TRPO": ("sb3_agents.py TRPO", 1_000_000, "sb3-trpo"),
    "Stable-Baselines3 DQN": ("sb3_agents.py DQN", 600_000, "sb3-dqn"),
    "Stable-Baselines3 SAC": ("sb3_agents.py SAC", 500_000, "sb3-sac"),
    "Stable-Baselines3 TD3": ("sb3_agents.py TD3", 200_000, "sb3-td3"),
    "RANS": ("rans_ppo.py", 3_000_000, None),
}
"""Files with their arguments, environment steps, and names of the saved agents (RANS saves a run of its own)."""
_SAID = re.compile(
    r"(\d+) steps, [\d.]+ s \(([\d.]+) s of a core\): solved (\S+), settling time (\S+), impulse (\S+)"
)


def row(name: str, save: Path | None) -> str:
    """Train and judge one, and save its agent into a folder if there is one: its row."""
    file, steps, agent = RUNS[name]
    command = [sys.executable, *f"{FOLDER}/{file} --steps {steps}".split()]
    if save is not None and agent is not None:
        command += ["--save", str(save / f"{agent}.onnx")]
    run = subprocess.run(
        command,
        env=os.environ | {"OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    said = _SAID.search(run.stdout)
    if said is None:
        return f"| {name} | failed: {run.stderr.strip().splitlines()[-1:]} |"
    taken, seconds, solved, settling, impulse = said.groups()
    speed = int(taken) / float(seconds)
    lines = len((FOLDER / file.split()[0]).read_text().splitlines())
    settling = settling.replace("inf", "never")
    return (
        f"| {name} | `{file.split()[0]}` | {lines} | {int(taken) / 1e6:g} M | {speed / 1e3:.1f} k "
        f"| {float(seconds):.0f} s | {solved} % | {settling} | {impulse} |"
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "rows", nargs="*", help="words that the names of the rows have; all if none"
    )
    parser.add_argument(
        "--save", type=Path, metavar="FOLDER", help="folder of the agents' ONNX files"
    )
    given = parser.parse_args()
    print(
        "| trainer | file | lines | steps | steps/s | training | solved | settling, s | impulse, N s |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    for name in RUNS:
        if not given.rows or any(word in name for word in given.rows):
            print(row(name, given.save), flush=True)
