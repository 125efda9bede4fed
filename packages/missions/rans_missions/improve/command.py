"""``rans improve``: cheaper flights of a mission by local search."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from rans.extend import (
    EVALUATION_SEED,
    ConfigError,
    Terminal,
    check_count,
    counted,
    load_spacecraft,
    progress,
    ready_folder,
    stages,
)


@dataclass(frozen=True)
class Improve:
    """Search for cheaper flights of a mission, from flights that solve it, judged by the engine's own checks.

    Writes a file of flights, which `rans compare` takes as a contestant and this command as a beginning.
    """

    group = "Limits"
    guide = "docs/missions/improve.md"
    examples = (
        "rans improve inspect circumnavigation --episodes 4",
        "rans improve dock least.csv mission convex --rounds 400",
    )

    task: Annotated[str, Positional, arg(metavar="TASK")]
    """Mission that a craft flies which nothing turns, such as inspect, hold, dock, rendezvous or avoid."""
    contestants: Annotated[tuple[str, ...], Positional, arg(metavar="FLIGHT...")]
    """What the search begins from: FILE.csv with flights, names of controllers, run folders or pretrained:NAME. For
    each start the cheapest flight that solves the task counts."""
    spacecraft: str | None = None
    """Name of a spacecraft that comes with RANS, or your own TOML file; by default that of the task."""
    episodes: int = 4
    """Number of starts."""
    seed: int = EVALUATION_SEED
    """Seed of the starts."""
    rounds: int = 200
    """Rounds of the search, with 256 flights of each start: some seconds of processor time each."""
    output: Path = Path("least.csv")
    """File of the flights."""

    def following(self) -> tuple[str, ...]:
        """See `rans.cli.commands.Command`."""
        first = f"{self.contestants[0]}:{self.task}-3d"
        if self.contestants[0].endswith(".csv"):
            first = f"mission:{self.task}-3d"
        words = ["rans", "compare", first, str(self.output), "--episodes", str(self.episodes)]
        return (shlex.join(words),)

    def run(self) -> int:
        """Print what each flight costs before and after."""
        from rans.extend import TASKS, Setup, contestant, scenarios
        from rans.registry import typed
        from rans_missions.improve.search import improve

        check_count("--episodes", self.episodes)
        check_count("--rounds", self.rounds)
        if self.output.suffix != ".csv":
            raise ConfigError(f"--output must end in .csv, got {str(self.output)!r}.")
        if not self.contestants:
            raise ConfigError(
                f"rans improve {self.task} begins from flights: name a controller such as mission, or FILE.csv."
            )
        task = TASKS[typed(self.task)]().for_evaluation()
        name = self.spacecraft or task.spacecraft
        if name is None:
            raise ConfigError(f"{self.task} has no spacecraft of its own: add --spacecraft NAME.")
        setup = Setup(load_spacecraft(name), task, task.timing)
        ready_folder(self.output.parent)
        seeds = [contestant(text, default_setup=setup).controller for text in self.contestants]
        starts = scenarios(task, setup.craft, self.seed, self.episodes)
        with progress() as bars:
            step = stages(bars)("search", self.rounds)
            found = improve(setup, starts, seeds, self.rounds, report=lambda *_: step(1))
        console = Terminal()
        console.show(
            f"Impulse from {counted(self.episodes, 'start')} of {self.task}",
            ("start", "before, N s", "after, N s", "ratio"),
            [
                (str(k), f"{a:.4f}", f"{b:.4f}", f"{b / a:.3f}")
                for k, (a, b) in enumerate(zip(found.before, found.after, strict=True))
            ],
        )
        found.write(self.output)
        console.print(f"{found.flown:,} flights were judged. Written to {self.output}.")
        return 0
