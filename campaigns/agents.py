"""What the agents are worth beside the original system's: three trainings a row, the worst one counts.

``python -m campaigns agents FOLDER`` judges the runs FOLDER/NAME-seed0, -seed1, ... of every row on 1,024 episodes.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from rans_assurance.follow.follow import fly_path
from rans_assurance.follow.paths import LookAhead, find_path
from tyro.conf import Positional

from campaigns.agent_rows import ROWS, Goal, Row
from rans.episode import Setup
from rans.errors import ConfigError, SolverFailed
from rans.evaluation.compare.optima import optima
from rans.evaluation.fly.contestants import contestant
from rans.evaluation.measure.metrics import samples
from rans.flight import Controller, fly
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from rans.optimal.trajectory.objectives import MinimumTime
from rans.scenario import EVALUATION_SEED, scenarios
from rans.tasks import Task

_FLIGHTS = 16
"""Along a path."""
_SPEED = 0.25
_LOOK_AHEAD = 0.25
"""m/s and m (paper, section 4.2)."""
_CENTRES = {"settling time": np.median}
"""Of metrics that are not shown by their mean: episodes that never settle have no time."""

Values = Mapping[str, np.ndarray]
"""By metric, one value per episode."""


@dataclass(frozen=True)
class Line:
    """One figure, or a few alike, of a row of the table."""

    row: str
    """Task and protocol."""
    what: str
    unit: str
    original: str
    """The original system's best published agent."""
    targets: tuple[float, ...]
    at_least: bool
    runs: dict[str, tuple[float, ...]]
    """Values of every training, by the name of its run."""
    command: str
    """Repeats it with the agent that comes with RANS."""

    @property
    def worst(self) -> tuple[float, ...]:
        """Every figure's worst training."""
        worst = min if self.at_least else max
        return tuple(worst(values) for values in zip(*self.runs.values(), strict=True))

    @property
    def passed(self) -> bool:
        """Whether the worst trainings keep every target; NaN keeps none."""
        pairs = zip(self.worst, self.targets, strict=True)
        return all(value >= bound if self.at_least else value <= bound for value, bound in pairs)

    def cells(self) -> dict[str, str]:
        """Texts of the table; says so where it is not the worst of three trainings."""
        target = f"{'≥' if self.at_least else '≤'} {joined(self.targets)} {self.unit}"
        few = "" if len(self.runs) == 3 else f" (of {len(self.runs)})"
        return {
            "target": target,
            "ours": f"{joined(self.worst)} {self.unit}{few}",
            "verdict": "met" if self.passed else "missed",
        }


@dataclass(frozen=True)
class Agents:
    """Judge the trainings of every row; it fails where a target is missed."""

    folder: Positional[Path]
    """Holds the run folders, NAME-seed0, NAME-seed1 and NAME-seed2 of every row."""
    episodes: int = 1024
    """Flights of an agent; along a path it is 16."""
    starts: int = 128
    """So many of them, from the first on, are set beside time-optimal trajectories."""

    def measured(self) -> dict[str, Any]:
        """The lines of the rows that something was trained for.

        Raises:
            ConfigError: there is no such run, or an option or a file is wrong.
        """
        if not 1 <= self.starts <= self.episodes:
            raise ConfigError(
                f"--starts must be from 1 to the {self.episodes} episodes, got {self.starts}."
            )
        lines = [line for row in ROWS for line in self._lines(row)]
        if not lines:
            names = ", ".join(dict.fromkeys(row.agent for row in ROWS))
            raise ConfigError(
                f"{self.folder} holds no run named {names}, each followed by -seed0 and so on."
            )
        rows = [asdict(line) | {"worst": line.worst, "passed": line.passed} for line in lines]
        return {"seed": EVALUATION_SEED, "lines": rows}

    def failed(self, evidence: Any) -> bool:
        """Whether a target is missed."""
        return not all(line["passed"] for line in evidence["lines"])

    def _lines(self, row: Row) -> Iterator[Line]:
        runs = sorted(self.folder.glob(f"{row.agent}-seed*"))
        if not runs:
            return
        measured = {run.name: self._measured(row, run) for run in runs}
        optimal = self._optimal(row, runs[0]) if any(goal.slack for goal in row.goals) else {}
        for goal in row.goals:
            count = self.starts if goal.slack else None
            values = {run: means(found, goal, count) for run, found in measured.items()}
            targets = goal.targets
            what = short(goal.metrics)
            if goal.slack:
                best = means(optimal, goal)
                targets = tuple(value - goal.slack for value in best)
                what += f", first {self.starts} starts; time-optimal: {joined(best)} %"
            yield Line(
                row.title,
                what,
                goal.unit,
                goal.original,
                targets,
                goal.at_least,
                values,
                row.command,
            )

    def _measured(self, row: Row, run: Path) -> Values:
        controller, setup = conditions_of(row, run)
        if row.path:
            planner = LookAhead(find_path(row.path), _SPEED, _LOOK_AHEAD)
            craft, task, timing, _, _ = setup
            following = fly_path(
                craft, task, controller, planner, timing, EVALUATION_SEED, _FLIGHTS
            )
            return {quantity.name: quantity.values for quantity in following.quantities()}
        craft, task, timing, _, _ = setup
        starts = scenarios(task, craft, EVALUATION_SEED, self.episodes)
        return {s.name: s.numbers for s in samples(fly(craft, task, controller, starts, timing))}

    def _optimal(self, row: Row, run: Path) -> Values:
        _, (craft, task, timing, _, _) = conditions_of(row, run)
        return time_optimal(craft, task, timing, EVALUATION_SEED, self.starts)


def conditions_of(row: Row, run: Path) -> tuple[Controller, Setup]:
    """The agent of a run, and what it is judged on."""
    loaded = contestant(str(run), row.protocol)
    controller = loaded.controller
    craft = loaded.craft
    settings = loaded.task
    timing = loaded.timing
    task: Any = settings
    if row.distance:
        task = replace(task, evaluation_distance=row.distance)
    return controller, Setup(craft, task.for_evaluation(), timing)


def time_optimal(
    craft: Spacecraft, task: Task, timing: Timing, seed: int, count: int, workers: int | None = None
) -> dict[str, np.ndarray]:
    """Every metric of the relaxed time-optimal trajectories, which no agent beats by much, one value per start.

    Their thrust is relaxed, anything between shut and open, and they know the future. They are flown in Drake and
    rest at the goal once they have arrived.

    Args:
        craft: what flies.
        task: where to; its own starts.
        timing: gives the length of an episode.
        seed: of the starts.
        count: starts 0 to count - 1 of it.
        workers: see `rans.optimal.trajectory.pool.solve_all`.

    Raises:
        SolverFailed: from some start none was found.
    """
    starts = scenarios(task, craft, seed, count)
    every = optima(craft, task, MinimumTime(), starts, workers=workers, timing=timing)
    lost = [one.start for one in every if one.flight is None]
    if lost:
        raise SolverFailed(
            f"no time-optimal trajectory was found from the starts {lost} of seed {seed}; the "
            f"first ended with {every[lost[0]].trajectory.status}."
        )
    found = [{s.name: s.values for s in samples(one.flight)} for one in every if one.flight]
    return {name: np.concatenate([values[name] for values in found]) for name in found[0]}


def means(values: Values, goal: Goal, count: int | None = None) -> tuple[float, ...]:
    """Means over the first episodes, by default all; of times to settle the median.

    Raises:
        ConfigError: something is asked that was not measured.
    """
    if missing := [name for name in goal.metrics if name not in values]:
        raise ConfigError(
            f"nothing is known of {', '.join(missing)}: the run is of another task, or its "
            "episodes are too short."
        )
    return tuple(float(_CENTRES.get(name, np.mean)(values[name][:count])) for name in goal.metrics)


def short(names: tuple[str, ...]) -> str:
    """PT5, PT2 and PT1 as PT5 / 2 / 1."""
    return " / ".join((names[0], *(re.sub(r"^\D*", "", name) for name in names[1:])))


def joined(values: Iterable[float]) -> str:
    """Numbers as a table shows them."""
    return " / ".join(f"{value:.3g}" for value in values)


def cells(evidence: Any) -> Iterator[dict[str, Any]]:
    """Rows of the table."""
    for line in evidence["lines"]:
        yield {**line, **Line(**{one.name: line[one.name] for one in fields(Line)}).cells()}
