"""``rans evaluate``: what an agent is worth, from starts it has never seen."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from tyro.conf import Positional

from rans.errors import ConfigError
from rans.scenario import EVALUATION_SEED

if TYPE_CHECKING:
    from rans.flight import Flight


@dataclass(frozen=True)
class Evaluate:
    """Fly an agent from fixed starts; write metrics with 95 % intervals and figures into its run."""

    run_folder: Positional[Path]
    """Run folder of the agent."""
    episodes: int = 1024
    """Number of flights."""
    seed: int = EVALUATION_SEED
    """Of starts and goals."""
    engine: Literal["fast", "drake", "both"] = "fast"
    """What computes the motion: the shared equations, Drake as an independent judge, or both side by
    side, with exit code 1 if they disagree."""

    def run(self) -> int:
        """Print the tables of metrics."""
        from rich.console import Console

        from rans.evaluation.engines import compare_engines
        from rans.evaluation.figures import save_flight_figures
        from rans.evaluation.metrics import measure
        from rans.files import read_json, write_json

        if self.episodes < 1:
            raise ConfigError(f"--episodes must be >= 1, got {self.episodes}.")
        console, file = Console(), self.run_folder / "evaluation.json"
        flights = self._fly()
        measured: dict[str, Any] = {name: measure(flight) for name, flight in flights.items()}
        for metrics in measured.values():
            console.print(metrics.table())
        results = {name: metrics.to_json() for name, metrics in measured.items()}
        passed = True
        if self.engine == "both":
            comparison = compare_engines(flights["fast"], flights["drake"])
            console.print(comparison.table())
            results["both"], passed = comparison.to_json(), comparison.passed
        write_json(file, (read_json(file) if file.exists() else {}) | results)
        if "fast" in flights:
            save_flight_figures(flights["fast"], self.run_folder)
        print(f"Written to {file}.")
        return 0 if passed else 1

    def _fly(self) -> dict[str, Flight]:
        """The flights by engine."""
        from rans.evaluation.agent import load_agent
        from rans.flight import fly, scenarios

        agent, craft, task, timing = load_agent(self.run_folder)
        task, flights = task.for_evaluation(), {}
        if self.engine != "drake":
            starts = scenarios(task, craft, self.seed, self.episodes)
            flights["fast"] = fly(craft, task, agent, starts, timing)
        if self.engine != "fast":
            flights["drake"] = self._fly_in_drake()
        return flights

    def _fly_in_drake(self) -> Flight:
        from rich.console import Console
        from rich.progress import Progress

        from rans.evaluation.judge import fly_agent_in_drake

        console = Console(stderr=True)
        with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
            bar = progress.add_task("flying in Drake", total=self.episodes)
            return fly_agent_in_drake(self.run_folder, self.seed, self.episodes,
                                      progress=lambda flown: progress.advance(bar, flown))


COMMAND = Evaluate
