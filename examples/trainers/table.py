"""The table of README.md: every trainer trains and is judged, one after the other; some minutes of a core each.

`python examples/trainers/table.py` prints it; names after it choose rows, such as `rl_games`.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

FOLDER = Path(__file__).parent
RUNS = {
    "rl_games PPO": ("rl_games_ppo.py", 3_000_000),
    "RSL-RL PPO": ("rsl_rl_ppo.py", 3_000_000),
    "CleanRL PPO": ("cleanrl_ppo.py", 3_000_000),
    "TorchRL PPO": ("torchrl_ppo.py", 1_500_000),
    "skrl PPO": ("skrl_ppo.py", 2_000_000),
    "tianshou PPO": ("tianshou_ppo.py", 2_000_000),
    "Stable-Baselines3 PPO": ("sb3_agents.py PPO", 3_000_000),
    "sb3-contrib TRPO": ("sb3_agents.py TRPO", 1_000_000),
    "Stable-Baselines3 DQN": ("sb3_agents.py DQN", 60_000),
    "Stable-Baselines3 SAC": ("sb3_agents.py SAC", 40_000),
    "Stable-Baselines3 TD3": ("sb3_agents.py TD3", 40_000),
    "RANS": ("rans_ppo.py", 3_000_000),
}
"""Files with their arguments, and environment steps."""
_SAID = re.compile(
    r"(\d+) steps, [\d.]+ s \(([\d.]+) s of a core\): solved (\S+), settling time (\S+), impulse (\S+)"
)


def row(name: str) -> str:
    """Train and judge one: its row."""
    file, steps = RUNS[name]
    run = subprocess.run(
        [sys.executable, *f"{FOLDER}/{file} --steps {steps}".split()],
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
    chosen = [name for name in RUNS if not sys.argv[1:] or any(a in name for a in sys.argv[1:])]
    print(
        "| trainer | file | lines | steps | steps/s | training | solved | settling, s | impulse, N s |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    for name in chosen:
        print(row(name), flush=True)
