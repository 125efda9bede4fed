"""RANS's own PPO, for the scale of the others: `rans train go-to-pose`, which ends once the task is solved."""

from __future__ import annotations

import argparse
import tempfile
import time
from typing import Any

import rans


def main(steps: int, episodes: int) -> None:
    """Train, judge, and print what the others print."""
    rows: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory() as folder:
        begun, used = time.perf_counter(), time.process_time()
        agent = rans.train(
            "go-to-pose",
            total_timesteps=steps,
            output=f"{folder}/run",
            progress=False,
            report=rows.append,
        )
        seconds, processor = time.perf_counter() - begun, time.process_time() - used
        metrics = agent.evaluate(episodes=episodes)
    found = {name: metrics[name].value for name in ("solved", "settling time", "impulse")}
    told = ", ".join(f"{name} {value:.4g}" for name, value in found.items())
    print(f"{rows[-1]['steps']} steps, {seconds:.1f} s ({processor:.1f} s of a core): {told}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=3_000_000)
    parser.add_argument("--episodes", type=int, default=1024)
    main(**vars(parser.parse_args()))
