"""``rans optimal``: the best a spacecraft can do, from the starts that agents are judged on."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
import tyro

from rans.cli import check_count
from rans.errors import ConfigError
from rans.files import distinct, ready_folder, write_json
from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import load_spacecraft, spacecraft_label
from rans.progress import Progress
from rans.scenario import EVALUATION_SEED, Scenario, scenarios
from rans.tasks import TASKS, Land, Task
from rans.tasks.orbital import OrbitalMission
from rans.terminal import Terminal, progress, stages

if TYPE_CHECKING:
    from rans.evaluation.compare.bounds import Bound
    from rans.evaluation.compare.optima import Optimum
    from rans.optimal.trajectory.objectives import Objective


@dataclass(frozen=True)
class Optimal:
    """Find optimal trajectories with relaxed thrust, and fly them in Drake.

    Thrust may be anything between shut and open, in Drake too: the trajectories are marks to measure by, no
    controllers and no certificates. Writes optimal.json and optimal.npz. Exit code 1 if any start was left
    without a trajectory that Drake flies.

    Of missions on an orbit (dock, hold, rendezvous) it finds the least impulse by a deadline, proven from below
    by a conic program and flown in both engines, and sets guidance, LQR and agents beside it, start by start.
    """

    task: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="TASK")]
    """What to do; `rans list` knows the tasks."""
    spacecraft: str | None = None
    """Name of a spacecraft that comes with RANS, or your own TOML file; by default the task's own, or
    floating-platform."""
    start: tuple[float, float, float, float, float, float] | None = None
    """Of land: position x y z, m, and velocity, m/s, in place of the task's starts; the site is 0 0 0."""
    objective: Literal["fuel", "time", "energy", "tracking", "reward"] = "fuel"
    """Least thrust-time, time or squared thrust, least squared distance, or the task's greatest reward."""
    ending: Literal["exact", "set"] = "exact"
    """Arrive exactly, or within the task's tolerances; for fuel, time and energy."""
    horizon: float | None = None
    """Length of the trajectory, s; by default 20, for reward 25. For time it follows. Of a mission on an orbit
    its deadline, by default the latest."""
    control_period: float = 0.2
    """Time a command is held, s; for time it follows, and is that of the on/off certificate."""
    intervals: int = 50
    """Control periods of a least time."""
    episodes: int = 16
    """Number of starts."""
    seed: int = EVALUATION_SEED
    """Seed of starts and goals."""
    guesses: int = 1
    """Motions to start the optimiser from; the best outcome counts."""
    certify: bool = False
    """Also find what nothing can beat: certified for on/off thrust where that is possible."""
    certify_seconds: float = 20.0
    """For every question of the certificate; less gives wider gaps."""
    agents: tuple[str, ...] = ()
    """Run folders or pretrained:NAME that fly a mission on an orbit beside its bound."""
    workers: int | None = None
    """Processes; by default one per processor."""
    output: Path | None = None
    """Folder to write into; by default runs/optimal-TASK-SPACECRAFT-OBJECTIVE."""

    def run(self) -> int:
        """Print a table of the starts."""
        from rans.evaluation.compare.optima import optima, table, write
        from rans.optimal.trajectory.allocation import check_attitude
        from rans.optimal.trajectory.arrival import check_goal
        from rans.optimal.trajectory.objectives import objective_of

        self._check()
        task = TASKS[self.task]().for_evaluation()
        craft = load_spacecraft(self.spacecraft or task.spacecraft or "floating-platform")
        if isinstance(task, OrbitalMission):
            return self._mission(craft, task)
        if isinstance(task, Land):
            return self._land(craft, task)
        if self.start is not None:
            raise ConfigError(f"--start is of land alone, not of {self.task}.")
        objective = objective_of(
            self.objective, self.horizon, self.control_period, self.ending, self.intervals
        )
        starts = scenarios(task, craft, self.seed, self.episodes)
        name = f"optimal-{distinct(self.task)}-{spacecraft_label(craft)}-{self.objective}"
        check_attitude(craft, task)
        check_goal(task)  # before anything is written
        folder = ready_folder(self.output or Path("runs") / name)
        answers = self._with_progress(
            "optimal trajectories",
            lambda step: optima(craft, task, objective, starts, self.guesses, self.workers, step),
        )
        Terminal().print(
            table(
                f"{objective.name}: {self.task} with {craft.name}, thrust between 0 and 1",
                objective,
                answers,
            )
        )
        about: dict[str, Any] = {
            "task": self.task,
            "spacecraft": craft.name,
            "objective": objective.name,
            "measure": objective.measure,
            "ending": objective.ending,
            "seed": self.seed,
        }
        write(folder, about, answers)  # bounds can take long: an interrupt must not lose these
        if self.certify:
            about["bounds"] = [
                asdict(b) for b in self._bounds(craft, task, objective, starts, answers)
            ]
            write(folder, about, answers)
        lost = sum(not answer.good for answer in answers)
        Terminal().say(
            f"{len(answers) - lost} of {len(answers)} solved and flown in Drake. Written to "
            f"{folder / 'optimal.json'} and optimal.npz."
        )
        return 1 if lost else 0

    def _mission(self, craft: Spacecraft, task: OrbitalMission) -> int:
        """Contestants beside the bounds of a mission on an orbit: print and write their table."""
        from rans.evaluation.compare.transfers import contestants_of, judged

        deadline = task.deadline[1] if self.horizon is None else self.horizon
        folder = ready_folder(self.output or Path("runs") / f"optimal-{distinct(self.task)}")
        makers = contestants_of(craft, self.agents)
        table = self._with_progress(
            "bounds",
            lambda step: judged(
                craft, task, makers, deadline, self.seed, self.episodes, progress=step
            ),
        )
        Terminal().show(
            f"{self.task} with {craft.name} by {deadline:g} s, {self.episodes} starts",
            table.columns,
            table.cells(),
            caption="Impulse over the proven bound of the same start and deadline, of those who won.",
        )
        write_json(folder / "optimal.json", table.to_json())
        lost = int((~np.isfinite(table.upper)).sum())
        Terminal().say(
            f"{self.episodes - lost} of {self.episodes} solved and flown in both engines. Written to "
            f"{folder / 'optimal.json'}."
        )
        return 1 if lost else 0

    def _land(self, craft: Spacecraft, task: Land) -> int:
        """Landings by convex programming, of which nothing but the starts and the ending is a choice."""
        from rans.evaluation.compare.landings import (
            landing_table,
            landings,
            single_start,
            write_landings,
        )

        starts = scenarios(task, craft, self.seed, self.episodes)
        if self.start is not None:
            starts = single_start(task, craft, self.start)
        name = f"optimal-{distinct(self.task)}-{spacecraft_label(craft)}-propellant"
        folder = ready_folder(self.output or Path("runs") / name)
        with progress() as bars:
            step = stages(bars)("landings", len(starts.start.p.x))
            answers = landings(craft, task, starts, self.ending == "exact", step)
        title = f"least propellant: {self.task} with {craft.name}, turned at once"
        Terminal().print(landing_table(title, answers))
        about = {"task": self.task, "spacecraft": craft.name, "seed": self.seed}
        write_landings(folder, about, answers)
        lost = sum(not answer.good for answer in answers)
        Terminal().say(
            f"{len(answers) - lost} of {len(answers)} solved and flown in Drake. Written to "
            f"{folder / 'optimal.json'} and optimal.npz."
        )
        return 1 if lost else 0

    def _check(self) -> None:
        for name in ("episodes", "guesses", "intervals", "workers"):
            check_count(f"--{name}", getattr(self, name))
        if not self.certify_seconds > 0:
            raise ConfigError(f"--certify-seconds must be > 0, got {self.certify_seconds:g}.")
        if self.certify and self.objective not in ("fuel", "time"):
            raise ConfigError(f"--certify bounds fuel and time only, not {self.objective}.")

    def _bounds(
        self,
        craft: Spacecraft,
        task: Task,
        objective: Objective,
        starts: Scenario,
        answers: list[Optimum],
    ) -> list[Bound]:
        """Of the trajectories' event, and of settling where that is a time; print them too."""
        from rans.evaluation.compare import bounds
        from rans.optimal.certificate.certificate import Effort
        from rans.scenario import each
        from rans.tasks.goal_set import aims

        period = self.control_period
        effort = Effort(self.certify_seconds)
        horizon = None if self.objective == "time" else objective.intervals * period
        costs = [answer.trajectory.cost if answer.good else math.nan for answer in answers]
        asked = {bounds.Event(horizon=horizon): (objective.measure, costs)}
        if horizon is None:  # the trajectories arrive, so their costs are of another event
            asked[bounds.Event("settling")] = "time s to settle", [math.nan] * self.episodes
        reason = bounds.no_certificate(craft, aims(task), period)
        sentence = f"No on/off certificate: {reason}" if reason else bounds.CERTIFIED
        every: list[Bound] = []
        for event, (measure, beside) in asked.items():
            questions = [
                bounds.question(craft, task, period, event, effort, one) for one in each(starts)
            ]
            found = [
                answer
                for _, answer in sorted(
                    self._with_progress(
                        "bounds",
                        lambda step, q=questions: [
                            *bounds.bounds(q, range(self.episodes), self.workers, step)
                        ],
                    ),
                    key=lambda pair: pair[0],
                )
            ]
            told = sentence if event.kind == "arrival" else f"{sentence} {bounds.SETTLING}"
            Terminal().print(bounds.table(told, measure, found, beside))
            every += found
        return every

    def _with_progress(self, what: str, work: Callable[[Progress], Any]) -> Any:
        with progress() as bars:
            return work(stages(bars)(what, self.episodes))
