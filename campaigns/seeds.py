"""One recipe from several seeds: the median, the worst, and which of them to ship.

``python -m campaigns.seeds go-to-pose-2d-fast --seeds 0 1 2`` trains it from each seed, on every GPU there
is, and judges each on the starts that agents are chosen by, which no report uses. Trainings that are over
are not done again. What follows ``--`` goes to `rans train`: variants of a recipe are tried so.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from tyro.conf import Positional

from rans.errors import ConfigError, RansError
from rans.evaluation.compare.contest import Contest, Contestant, Entry
from rans.evaluation.fly.agent import Agent
from rans.evaluation.fly.contestants import contestant, judged_separately
from rans.fast.flights import Flights
from rans.files import environment, write_json
from rans.scenario import SELECTION_SEED
from rans.terminal import Terminal, table
from rans.verdict import last_fifth

_TRADE_OFFS = (0, 0.25, 0.5, 0.75, 1)
_COLUMNS = {
    "settled": "s",
    "at rest": "s",
    "impulse": "N s",
    "duty at rest": "%",
    "error": "m or m/s",
    "leaves rest": "%",
    "failed": "per million",
}
"""Of each the mean; smaller is better in every one."""


@dataclass(frozen=True)
class Seeds:
    """Train one recipe from several seeds; judge each."""

    recipe: Positional[str]
    """What `rans train` is asked for."""
    options: Positional[tuple[str, ...]] = ()
    """More for `rans train`, after ``--``."""
    seeds: tuple[int, ...] = tuple(range(10))
    at_once: int = 10
    """Trainings side by side; on several GPUs they take turns."""
    starts: int = 2048
    """Behind each figure but the failures."""
    flights: int = 1_000_000
    """Among which failures are counted."""
    output: Path = Path("runs")
    """Where the runs go, as RECIPE-seedN, and what was found, as RECIPE.json."""

    def run(self) -> int:
        """Train, judge, print and write.

        Raises:
            ConfigError: there is nothing to train, or nothing to judge by.
            RansError: a training ended otherwise than it should; its log is named.
        """
        if not self.seeds or min(self.at_once, self.starts, self.flights) < 1:
            raise ConfigError(
                "--seeds must name at least one, and --at-once, --starts and --flights must be "
                f">= 1, got {len(self.seeds)} seeds, {self.at_once}, {self.starts} and "
                f"{self.flights}."
            )
        self.output.mkdir(parents=True, exist_ok=True)
        with ThreadPoolExecutor(self.at_once) as pool:
            runs = list(pool.map(self._trained, range(len(self.seeds)), self.seeds))
        found = {run.name: judged(run, self.starts, self.flights) for run in runs}
        write_json(
            self.output / f"{self.recipe}.json",
            {
                "command": ["rans train", self.recipe, *self.options],
                "starts": self.starts,
                "flights": self.flights,
                "seed": SELECTION_SEED,
                "runs": found,
                "environment": environment(),
            },
        )
        for part in next(iter(found.values())):
            rows = {name: [one[part][key] for key in _COLUMNS] for name, one in found.items()}
            values = np.array(list(rows.values()))
            rows |= {
                "median": np.median(values, axis=0).tolist(),
                "worst": values.max(axis=0).tolist(),
            }
            Terminal(room=110).print(
                table(
                    f"{self.recipe} {part}",
                    ("training", *(f"{key}, {unit}" for key, unit in _COLUMNS.items())),
                    [(name, *(f"{x:.4g}" for x in row)) for name, row in rows.items()],
                )
            )
        return 0

    def _trained(self, number: int, seed: int) -> Path:
        run = self.output / f"{self.recipe}-seed{seed}"
        wanted = (
            ["--resume", str(run)]
            if (run / "config.json").exists()
            else [self.recipe, "--seed", str(seed), "--output", str(run), *self.options]
        )
        log = run.with_suffix(".log")
        with log.open("w") as told:
            ended = subprocess.run(
                [sys.executable, "-m", "rans", "train", *wanted],
                stdout=told,
                stderr=subprocess.STDOUT,
                env=_on_gpu(number),
                check=False,
            )
        if ended.returncode:
            raise RansError(f"the training of {run} ended with {ended.returncode}: {log} says why.")
        return run


def judged(run: Path, starts: int, flights: int) -> dict[str, dict[str, float]]:
    """Means of one agent on the selection starts, by what it is judged in: "#TASK", or a place of its trade-off.

    What never happens counts with the whole episode. Under the conditions of its training, which its starts
    are drawn with. "failed" is of `flights` other flights of the same seed, per million.
    """
    spec = str(run)
    return {part.removeprefix(spec): _judged(part, starts, flights) for part in _parts(spec)}


def _parts(spec: str) -> Sequence[str]:
    if contestant(spec).task.draws_trade_off:
        return [f"{spec}#{trade_off}" for trade_off in _TRADE_OFFS]
    return judged_separately(spec)


def _judged(spec: str, starts: int, flights: int) -> dict[str, float]:
    run = contestant(spec)
    assert isinstance(run.controller, Agent)
    setup = run.judged
    contest = Contest(*setup[:3], SELECTION_SEED, starts, conditions=setup.conditions)
    entry = Entry(
        Contestant(spec, run.controller, "", ""), contest.fly(run.controller).flight, np.zeros(0)
    )
    commands = entry.flight.commands
    device = "cuda" if torch.cuda.is_available() else "cpu"
    failed = Flights(run.controller.network, setup, device).fly(0, flights, SELECTION_SEED)

    def late(times: np.ndarray) -> float:
        return float(np.minimum(times, contest.duration).mean())

    return {
        "settled": late(entry.settling),
        "at rest": late(entry.arrival),
        "impulse": float(entry.thrust.mean()),
        "duty at rest": 100.0 * float(commands[-last_fifth(len(commands)) :].mean()),
        "error": float(next(iter(entry.errors.values())).mean()),
        "leaves rest": 100.0 * float(1.0 - entry.stays.mean()),
        "failed": 1e6 * failed.unsolved / failed.flights,
    }


def _on_gpu(number: int) -> dict[str, str]:
    """The environment of one training: of the GPUs that this process sees it sees one."""
    count = torch.cuda.device_count()
    if count < 2:
        return dict(os.environ)
    seen = os.environ.get("CUDA_VISIBLE_DEVICES", ",".join(map(str, range(count)))).split(",")
    return os.environ | {"CUDA_VISIBLE_DEVICES": seen[number % count]}


if __name__ == "__main__":
    import tyro

    from campaigns.command import ended

    sys.exit(ended("python -m campaigns.seeds", tyro.cli(Seeds).run))
