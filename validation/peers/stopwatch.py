"""What the peers' scripts share: their options, a clock, and the line they print. Standard library only."""

from __future__ import annotations

import argparse
import json
import statistics
import sys
import time
from collections.abc import Callable
from importlib.metadata import version

REPEATS = 5
"""The median of so many counts."""


def options() -> argparse.Namespace:
    """``--device`` cpu or cuda, ``--quick``; what follows from them: num_envs, and seconds of a repeat."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--device", choices=("cpu", "cuda"), default="cpu")
    parser.add_argument("--quick", action="store_true")
    given = parser.parse_args()
    given.num_envs, given.seconds = (1024, 0.05) if given.quick else (16_384, 0.5)
    return given


def steps_per_second(call: Callable[[], object], steps: int, seconds: float) -> float:
    """Median rate of a call that waits for its result.

    Args:
        call: does so many steps; its first two calls compile and warm up.
        steps: of one call, of all environments together.
        seconds: wall time of each repeat, about.
    """
    call()
    calls = max(1, round(seconds / _took(call, 1)))
    return steps / statistics.median(_took(call, calls) for _ in range(REPEATS))


def _took(call: Callable[[], object], calls: int) -> float:
    begun = time.perf_counter()
    for _ in range(calls):
        call()
    return (time.perf_counter() - begun) / calls


def say(
    package: str, task: str, how: str, num_envs: int, device: str, **figures: float | bool
) -> None:
    """Print what was measured.

    Args:
        package: its name on PyPI.
        task: what its environments do.
        how: what one call was, and what ran it.
        num_envs: environments stepped together.
        device: what it really ran on.
        **figures: "steps_per_s" of the environments, "trained_steps_per_s", "same_task" where that is on
            ours, "solved", "seconds_to_success", "steps_to_success".
    """
    line = {
        "package": package,
        "version": version(package),
        "task": task,
        "how": how,
        "num_envs": num_envs,
        "device": device,
        **figures,
    }
    sys.stdout.write(json.dumps(line) + "\n")
