"""``rans optimal``: optimal trajectories from the starts of evaluations."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rans.extend import (
    EVALUATION_SEED,
    Bound,
    ConfigError,
    Event,
    Options,
    Problem,
    Progress,
    Scenario,
    Spacecraft,
    Task,
    Terminal,
    certificates,
    command_of,
    distinct,
    progress,
    ready_folder,
    stages,
    typed,
    whole,
    word,
)
from rans.model.spacecraft_file import spacecraft_label
from rans_optimal.functions import optimal_trajectory, setup_of, starts_of

if TYPE_CHECKING:
    from rans_optimal.optima import Optimum

_CONTROL_PERIOD, _INTERVALS = (
    inspect.signature(optimal_trajectory).parameters[name].default
    for name in ("control_period", "intervals")
)
_REPLAYED = 8
"""Largest number of trajectories in optimal.html, each a picture of its own."""


@command_of(
    optimal_trajectory,
    without=("seed", "control_period", "intervals", "guesses"),
    defaults={"task": inspect.Parameter.empty, "start": None},
    task=word("TASK"),
)
class Optimal(Options):
    """Compute optimal trajectories with partly open thrusters, and fly them in Drake.

    The trajectories are references: thrusters may open partly, so they are neither controllers nor
    certificates. Writes optimal.json, optimal.csv and optimal.html, a replay. The exit code is
    1 if a start has no trajectory that Drake flies.

    For missions on an orbit (dock, hold, rendezvous) it computes the least impulse by a deadline, with a
    lower bound from a conic program and a flight in both engines, start by start. These missions and landings
    refuse options that they do not use and that differ from their defaults.
    """

    group = "Limits"
    guide = "docs/optimal.md"
    divides_work = True
    examples = (
        "rans optimal go-to-pose --objective time",
        "rans optimal go-to-pose --episodes 4 --certify",
        "rans optimal go-to-pose --start 3 1 40deg --goal 0 0 0",
    )
    following = ("rans list CONTROLLERS",)

    episodes: int = 16
    """Number of starts."""
    certify: bool = False
    """Also compute what no controller can beat: certified for on/off thrusters where that is possible, else for
    thrusters of any kind and wheels. Craft without optimal trajectories, as with wheels, have bounds only."""
    certify_seconds: float = 20.0
    """With --certify: work for each question, by what a core at 3 GHz does in a second, so that every machine
    answers the same; less gives wider gaps."""
    output: Path | None = None
    """Folder to write into; by default runs/optimal-TASK-SPACECRAFT-OBJECTIVE."""

    def run(self) -> int:
        """Print a table of the starts, and write trajectories, figures and bounds; 1 if a start was lost."""
        from rans_optimal.checks import check_craft, check_task
        from rans_optimal.history import Replay
        from rans_optimal.objectives import objective_of
        from rans_optimal.optima import optima, optima_table, write

        self._check()
        ending = self.ending or "exact"
        craft, task = setup_of(typed(self.task), self.spacecraft)
        problem = Problem.of(task)
        if problem is not None and problem.solve is not None:
            return problem.solve(self, craft, task)
        # Objective and starts.
        if self.start and self.episodes != Optimal.episodes:
            raise ConfigError("--episodes is for starts of a seed, and --start is one.")
        objective = objective_of(self.objective, self.horizon, _CONTROL_PERIOD, ending, _INTERVALS)
        starts = self.sampled_starts(task, craft)
        # Before anything is written: what would stop the trajectories or their bounds.
        check_task(craft, task)
        reason = ""
        try:
            check_craft(craft)
        except ConfigError as error:
            if not self.certify:
                raise
            reason = str(error)
        if self.certify:
            certificates().check(craft, task, _CONTROL_PERIOD)
        about: dict[str, Any] = {
            "command": self.command_line(),
            "task": self.task,
            "spacecraft": craft.name,
            "objective": objective.name,
            "measure": objective.measure,
            "ending": objective.ending,
            "seed": None if self.start else EVALUATION_SEED,
        }
        if reason:
            Terminal().say(f"Bounds only, without trajectories: {reason}")
        folder = self.folder(craft, self.objective)
        answers: list[Optimum] = []
        if not reason:
            answers = self.with_progress(
                "optimal trajectories",
                lambda step: optima(craft, task, objective, starts, None, progress=step),
            )
        bounds: list[Bound] = []

        def write_all() -> None:
            if self.certify:
                about["bounds"] = [asdict(bound) for bound in bounds]
            write(folder, about, answers, craft)

        # Before all that takes long, may be interrupted or cannot be printed.
        write_all()
        if not reason:
            title = f"{objective.name}: {self.task} with {craft.name}, thrust between 0 and 1"
            Terminal().table(optima_table(title, objective, answers))
        flights = [replace(x.flight, first=k) for k, x in enumerate(answers) if x.flight]
        if flights:
            replay = Replay(flights[:_REPLAYED], f"{objective.name}: {self.task}")
            replay.save(folder / "optimal.html")
        if self.certify:
            # Bounds are for the goal set, so only trajectories that end in it are comparable.
            is_same = objective.ending == "set"
            costs = [a.trajectory.cost if is_same and a.good else math.nan for a in answers]
            period = _CONTROL_PERIOD
            event = Event(
                horizon=None if self.objective == "time" else objective.intervals * period
            )
            setup = craft, task, period, event, objective.measure, self.certify_seconds
            try:
                certificates().add_bounds(bounds, *setup, starts, costs)
            finally:  # an interrupt leaves those that are finished
                write_all()
        if not answers:
            Terminal().say(f"Written to {folder / 'optimal.json'}.")
            return 0
        lost = sum(not answer.good for answer in answers)
        page = "optimal.html, " if flights else ""
        Terminal().say(
            f"{len(answers) - lost} of {len(answers)} solved{' and flown in Drake' if page else ''}. Written to "
            f"{folder}: {page}"
            "optimal.json and optimal.csv."
        )
        # With a time of its own the objective may be too short for weak thrusters. Least time finds its own.
        if lost and self.objective != "time":
            longer = 2.0 * getattr(objective, "horizon", 0.0)
            Terminal().say(f"More time than {longer / 2.0:g} s may help: --horizon {longer:g}")
        return 1 if lost else 0

    def _check(self) -> None:
        whole("--episodes", self.episodes)
        if not self.certify_seconds > 0:
            raise ConfigError(f"--certify-seconds must be > 0, got {self.certify_seconds:g}.")
        if not self.certify and self.certify_seconds != Optimal.certify_seconds:
            raise ConfigError("--certify-seconds needs --certify.")
        if self.certify and self.objective not in ("fuel", "time"):
            raise ConfigError(f"--certify bounds fuel and time only, not {self.objective}.")

    def refuse_all_but(self, *used: str) -> None:
        """Reject (`ConfigError`) options that differ from their defaults and that this task does not use."""
        unused = [
            f"--{field.name.replace('_', '-')}"
            for field in fields(self)
            if field.name not in (*used, "task", "output")
            and getattr(self, field.name) != field.default
        ]
        if unused:
            options = ", ".join(f"--{name.replace('_', '-')}" for name in used)
            raise ConfigError(
                f"{', '.join(unused)} would change nothing for {self.task}, which takes {options} and --output."
            )

    def sampled_starts(self, task: Task, craft: Spacecraft) -> Scenario:
        """Scenarios of the seed, or the start and goal of the options."""
        count = 1 if self.start else self.episodes
        own = self.start or None, self.goal or None
        return starts_of(task, craft, EVALUATION_SEED, 0, count, *own)

    def folder(self, craft: Spacecraft, what: str) -> Path:
        """Folder to write into."""
        name = f"optimal-{distinct(self.task)}-{spacecraft_label(craft)}-{what}"
        return ready_folder(self.output or Path("runs") / name)

    def with_progress(self, what: str, work: Callable[[Progress], Any]) -> Any:
        """Do work that reports starts, with a bar of this title."""
        with progress() as bars:
            return work(stages(bars)(what, 1 if self.start else self.episodes))
