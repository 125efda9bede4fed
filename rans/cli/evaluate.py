"""``rans evaluate``: what an agent, or another controller, is worth from starts it has never seen."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from tyro.conf import Positional, arg

from rans.cli import check_count
from rans.files import command_line, environment, read_json, ready_folder, write_json
from rans.scenario import EVALUATION_SEED
from rans.terminal import Terminal, progress

if TYPE_CHECKING:
    from rans.evaluation.fly.agent import LoadedRun
    from rans.flight import Flight


@dataclass(frozen=True)
class Evaluate:
    """Fly an agent from fixed starts; write metrics with 95 % intervals, episodes and figures.

    They go into its run folder, those of other contestants into runs/evaluations/: evaluation.json,
    episodes.npz, evaluation.svg and episode.svg; with a protocol, evaluation-paper.json and so on.
    """

    contestant: Annotated[str, Positional, arg(metavar="RUN")]
    """A run folder, pretrained:NAME, or CONTROLLER:TASK-2d or -3d (with @SPACECRAFT if you like)."""
    protocol: Literal["own", "paper", "original"] = "own"
    """Conditions: those of the training, with the task's evaluation starts; or of the paper: the floating
    platform, 250 steps, starts 3 to 4 m away, with 1 N a thruster (paper) or in all (original)."""
    conditions: str | None = None
    """What episodes do not promise: a name (see `rans list CONDITIONS`), perfect, or your own TOML file; by
    default those of its training."""
    episodes: int = 1024
    """Number of flights."""
    seed: int = EVALUATION_SEED
    """Of starts and goals."""
    engine: Literal["fast", "drake", "both"] = "fast"
    """What computes the motion: the shared equations, Drake as an independent judge, or both side by
    side, with exit code 1 if they disagree."""
    trajectories: bool = False
    """Write all states and commands into episodes.npz too."""
    trust: bool = False
    """Run the module of a task that a run folder names as MODULE:NAME; only if you know its author."""

    def run(self) -> int:
        """Print the tables of metrics; a multi-task agent is judged on each of its tasks."""
        from rans.evaluation.fly.contestants import judged_separately

        check_count("--episodes", self.episodes)
        passed = [replace(self, contestant=spec).judge() for spec in judged_separately(self.contestant)]
        return 0 if all(passed) else 1

    def judge(self) -> bool:
        """Evaluate on one task; whether the engines agree, where both were asked for."""
        from rans.evaluation.fly.contestants import contestant, output_folder
        from rans.evaluation.measure.aggregate import ROOM, measure
        from rans.evaluation.measure.agreement import compare_engines

        run = contestant(self.contestant, self.protocol).under(self.conditions)
        ready_folder(output_folder(self.contestant))
        flights = self._fly(run)
        measured = {name: measure(flight) for name, flight in flights.items()}
        console = Terminal(room=ROOM)
        if run.conditions is not None:
            console.print(f"Conditions: {run.conditions.description or self.conditions}.")
        for metrics in measured.values():
            console.print(metrics.table(console.width))
        results: dict[str, Any] = {name: metrics.to_json() for name, metrics in measured.items()}
        passed = True
        if self.engine == "both":
            comparison = compare_engines(flights["fast"], flights["drake"])
            console.print(comparison.table())
            results["both"], passed = comparison.to_json(), comparison.passed
        print(f"Written to {self._write(run, results, next(iter(flights.values())))}.")
        return passed

    def _fly(self, run: LoadedRun) -> dict[str, Flight]:
        """The flights by engine."""
        from rans.evaluation.fly.judge import EngineName, flown
        from rans.evaluation.measure.metrics import outran

        engines: tuple[EngineName, ...] = ("fast", "drake") if self.engine == "both" else (self.engine,)
        flights = {}
        with progress() as bars:
            for engine in engines:
                step = partial(bars.advance, bars.add_task(f"{engine} engine", total=self.episodes))
                flights[engine], stopped = flown(run.controller, run.judged, self.seed, self.episodes, engine,
                                                 progress=step)
                if stopped:
                    bars.console.print(f"rans: warning: {run.controller.name}'s solver stopped {stopped} "
                                       "times; the plan before was flown on.", soft_wrap=True)
                if engine == "fast" and (said := outran(flights[engine])):
                    bars.console.print(f"rans: warning: {said}", soft_wrap=True)
        return flights

    def _write(self, run: LoadedRun, results: dict[str, Any], flight: Flight) -> Path:
        """Write all files; results of the other engine under the same conditions are kept."""
        from rans.evaluation.fly.contestants import output_folder, picked_task
        from rans.evaluation.measure.aggregate import save_episodes
        from rans.show.figures import save_flight_figures

        folder, names = output_folder(self.contestant), (picked_task(self.contestant), self.protocol,
                                                         Path(self.conditions or "own").stem)
        suffix = "".join(f"-{name}" for name in names if name not in ("", "own"))
        file = folder / f"evaluation{suffix}.json"
        conditions = {"contestant": self.contestant, "protocol": self.protocol, "episodes": self.episodes,
                      "seed": self.seed}
        if run.conditions is not None:
            conditions["conditions"] = asdict(run.conditions)
        before = read_json(file) if file.exists() else {}
        if not isinstance(before, dict) or before.get("conditions") != conditions:
            before = {}
        about = {"command": command_line(), "environment": environment()}
        write_json(file, before | results | {"conditions": conditions, "about": about})
        save_episodes(flight, folder / f"episodes{suffix}.npz", self.trajectories)
        save_flight_figures(flight, folder, suffix)
        return file
