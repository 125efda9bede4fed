"""How the speed of training grows with the number of GPUs, each flying as many environments.

Run as ``python -m campaigns.scaling``; it starts itself on 1, 2, 4, ... GPUs with torchrun. A ratio of n
on n GPUs would be perfect. ``--device cpu`` shows that it runs, not how fast anything is.
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import time
from dataclasses import dataclass
from typing import Literal

import torch
import tyro
from rich.console import Console

from rans.fast.distributed import Processes, join
from rans.fast.engine import Engine
from rans.fast.learn.config import PPOSettings, Precision
from rans.fast.learn.member import begin
from rans.model.spacecraft_file import load_spacecraft
from rans.tasks import GoToPose

_WARM_UP = 5
"""Iterations that compile, record and start the network between the GPUs."""
_MARK = "measured: "


@dataclass(frozen=True)
class Scaling:
    """Measure trained steps/s of 3DoF go-to-pose on growing numbers of GPUs."""

    processes: tuple[int, ...] = (1, 2, 4)
    """Numbers of GPUs to measure."""
    n_envs: int = 16_384
    """Environments a GPU."""
    n_steps: int = 16
    """Control periods between updates of 4 epochs with 4 minibatches."""
    layers: tuple[int, ...] = (128, 128)
    """Units of the network's hidden layers."""
    matmul: Precision = "tf32"
    """Of the network's products."""
    iterations: int = 30
    """Of rollout and update in each of 5 repeats, of which the median counts."""
    device: Literal["cuda", "cpu"] = "cuda"

    def run(self) -> None:
        """Print a line a number of GPUs."""
        first = 0.0
        for count in self.processes:
            rate = self._measure_on(count)
            first = first or rate / count
            Console().print(
                f"{count} x {self.device}: {rate / 1e6:.2f} M steps/s (median), "
                f"{rate / first:.2f} x one ({rate / first / count:.0%} of perfect)"
            )

    def _measure_on(self, count: int) -> float:
        """Steps/s of so many processes, started with torchrun."""
        command = [
            sys.executable,
            "-m",
            "torch.distributed.run",
            "--standalone",
            "--nproc-per-node",
            str(count),
            "-m",
            "--",
            "campaigns.scaling",
            *sys.argv[1:],
        ]
        result = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
        line = next(line for line in result.stdout.splitlines() if line.startswith(_MARK))
        return float(line.removeprefix(_MARK))

    def measure(self) -> None:
        """Be one of torchrun's processes; the first prints the rate of all."""
        torch.set_num_threads(1)
        world = join(self.device)
        rate = self._rate(world)
        if world.is_first:
            sys.stdout.write(f"{_MARK}{rate!r}\n")

    def _rate(self, world: Processes) -> float:
        total = self.n_envs * world.size
        settings = PPOSettings(
            n_envs=total,
            n_steps=self.n_steps,
            batch_size=total * self.n_steps // 4,
            layers=self.layers,
            matmul=self.matmul,
        )
        engine = Engine(
            load_spacecraft("floating-platform"),
            GoToPose(),
            self.n_envs,
            device=self.device,
            processes=world,
        )
        learner = begin(engine, [settings], [0])

        def seconds(iterations: int) -> float:
            begun = time.perf_counter()
            for _ in range(iterations):
                learner.collect()
                learner.update()
            if self.device == "cuda":
                torch.cuda.synchronize()
            return time.perf_counter() - begun

        seconds(_WARM_UP)
        took = statistics.median(seconds(self.iterations) for _ in range(5))
        return total * self.n_steps * self.iterations / took


def main() -> None:
    """Measure, or be one of the processes that are measured."""
    study = tyro.cli(Scaling)
    if "WORLD_SIZE" in os.environ:
        study.measure()
    else:
        study.run()


if __name__ == "__main__":
    main()
