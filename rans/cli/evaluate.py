"""``rans evaluate``: what an agent is worth, from starts it has never seen."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from tyro.conf import Positional

from rans.errors import ConfigError
from rans.scenario import EVALUATION_SEED


@dataclass(frozen=True)
class Evaluate:
    """Fly an agent from fixed starts; write metrics with 95 % intervals and figures into its run."""

    run_folder: Positional[Path]
    """Run folder of the agent."""
    episodes: int = 1024
    """Number of flights."""
    seed: int = EVALUATION_SEED
    """Of starts and goals."""
    engine: Literal["fast", "drake"] = "fast"
    """What computes the motion: the shared equations, or Drake as an independent judge."""

    def run(self) -> int:
        """Print the table of metrics."""
        from rich.console import Console

        from rans.evaluation.figures import save_flight_figures
        from rans.evaluation.metrics import measure
        from rans.files import read_json, write_json

        if self.episodes < 1:
            raise ConfigError(f"--episodes must be >= 1, got {self.episodes}.")
        flight = self._fly()
        metrics = measure(flight)
        Console().print(metrics.table())
        file = self.run_folder / "evaluation.json"
        known = read_json(file) if file.exists() else {}
        write_json(file, known | {self.engine: metrics.to_json()})
        if self.engine == "fast":
            save_flight_figures(flight, self.run_folder)
        print(f"Written to {file}.")
        return 0

    def _fly(self):  # noqa: ANN202 - Flight, whose import is heavy
        from rans.evaluation.agent import load_agent
        from rans.flight import fly, scenarios

        agent, craft, task, timing = load_agent(self.run_folder)
        task = task.for_evaluation()
        starts = scenarios(task, craft, self.seed, self.episodes)
        if self.engine == "drake":
            from rans.reference.flight import fly_in_drake

            return fly_in_drake(craft, task, agent, starts, timing)
        return fly(craft, task, agent, starts, timing)


COMMAND = Evaluate
