"""``rans compare``: an agent beside an LQR and beside what is possible."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from rans.scenario import EVALUATION_SEED


@dataclass(frozen=True)
class Compare:
    """Fly an agent and an LQR from the same starts and find the optimal trajectories from them.

    Writes compare.json into the run folder. Exit code 1 if the optimiser found no trajectory from
    some start.
    """

    run_folder: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="RUN")]
    """Run folder of the agent, as `rans train` made it."""
    episodes: int = 16
    """Number of starts."""
    seed: int = EVALUATION_SEED
    """Of the starts."""

    def run(self) -> int:
        """Print a table of the starts and a summary."""
        from rich.console import Console
        from rich.progress import Progress

        from rans.errors import ConfigError
        from rans.evaluation.agent import load_agent
        from rans.evaluation.compare import bounds, compare
        from rans.files import write_json
        from rans.optimal.lqr import LQR

        if self.episodes < 1:
            raise ConfigError(f"--episodes must be at least 1, got {self.episodes}.")
        agent, craft, task, timing = load_agent(self.run_folder)
        task = task.for_evaluation()
        objectives = bounds(timing)
        terminal = Console(stderr=True)
        with Progress(console=terminal, transient=True, disable=not terminal.is_terminal) as progress:
            bar = progress.add_task("optimal trajectories", total=len(objectives) * self.episodes)
            comparison = compare([agent, LQR(craft, timing)], craft, task, timing, self.seed,
                                 self.episodes, objectives, progress=lambda: progress.advance(bar))
        console = Console()
        for table in comparison.tables():
            console.print(table)
        write_json(self.run_folder / "compare.json", comparison.to_json())
        console.print(f"Written to {self.run_folder / 'compare.json'}.")
        return 1 if comparison.unsolved else 0


COMMAND = Compare
