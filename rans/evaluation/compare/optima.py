"""Optimal trajectories from the evaluation starts: flown in Drake, bounded, in tables and in files."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from rans import terminal
from rans.evaluation.measure.aggregate import save_arrays
from rans.evaluation.measure.metrics import DISPLAY
from rans.files import environment, write_json
from rans.flight import Flight
from rans.model.actuators import Pulsed, Throttle
from rans.model.fields import leaves, map_leaves
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from rans.optimal.trajectory.arrival import moves_goal
from rans.optimal.trajectory.objectives import Objective
from rans.optimal.trajectory.pool import solve_all
from rans.optimal.trajectory.transcription import Trajectory
from rans.progress import Progress, unseen
from rans.reference.flight import replay
from rans.scenario import Scenario, each
from rans.tasks.base import Task

REPLAY_BOUND = 1e-3
"""Largest distance between an optimised and the flown path, m: a fiftieth of what tasks tolerate."""

_SENTENCES = {
    "Infeasible_Problem_Detected": "nothing found that arrives: the goal is out of reach in this time",
    "Restoration_Failed": "nothing found that arrives: the goal is out of reach, or the time too short",
    "Maximum_Iterations_Exceeded": "the solver stopped after 500 iterations without an answer",
    "Invalid_Number_Detected": "a number became NaN or infinite: the start, goal or task has one",
    "Worker_Died": "the process that solved it died, usually for lack of memory",
}
"""How the optimiser ended, in words."""

_AS_PLANNED = Timing(episode_steps=1)

_LEAVES = {
    6: "p.x p.y heading v.x v.y w",
    13: "p.x p.y p.z q.w q.x q.y q.z v.x v.y v.z w.x w.y w.z",
}
"""Names of a state's values, by how many it has."""


@dataclass(frozen=True)
class Optimum:
    """The answer for one start."""

    start: int
    """Number of the scenario."""
    trajectory: Trajectory
    replay_error: float = math.nan
    """Largest distance between the optimised path and the one Drake flies, m."""
    errors: dict[str, float] = field(default_factory=dict)
    """The task's errors at the trajectory's end in Drake, SI units."""
    flight: Flight | None = None
    """By Drake, see `episode`."""

    def __repr__(self) -> str:
        path = self.trajectory
        return (
            f"<Optimum of {path.objective} from start {self.start}: {path.cost:g}, {self.sentence}>"
        )

    @property
    def good(self) -> bool:
        """Whether there is a trajectory, and Drake flies it."""
        return self.trajectory.solved and self.replay_error <= REPLAY_BOUND

    @property
    def sentence(self) -> str:
        """How it ended, in words."""
        status = self.trajectory.status
        if not self.trajectory.solved:
            return _SENTENCES.get(status, f"the solver stopped: {status.replace('_', ' ').lower()}")
        return "solved" if self.good else "solved, but Drake flies elsewhere"

    def to_json(self) -> dict[str, Any]:
        """For `rans.files.write_json`; what is missing is NaN."""
        path = self.trajectory
        found = 1.0 if path.solved else math.nan
        return {
            "start": self.start,
            "status": path.status,
            "good": self.good,
            "sentence": self.sentence,
            "cost": found * path.cost,
            "time": found * path.control_period * len(path.commands),
            "replay_error": self.replay_error,
            "seconds": path.seconds,
            "iterations": path.iterations,
            "attempts": path.attempts,
            "errors": self.errors,
        }


def optima(
    craft: Spacecraft,
    task: Task,
    objective: Objective,
    starts: Scenario,
    guesses: int = 1,
    workers: int | None = None,
    progress: Progress = unseen,
    timing: Timing = _AS_PLANNED,
) -> list[Optimum]:
    """Solve from every start and fly what was found in Drake: one answer per start, solved or not.

    Args:
        craft: what flies.
        task: where to, or what for.
        objective: what to minimise.
        starts: fields of arrays (N,).
        guesses: see `rans.optimal.trajectory.transcription.Transcription.solve`.
        workers: see `rans.optimal.trajectory.pool.solve_all`.
        progress: reports solved problems.
        timing: how long flights last, see `episode`; by default as long as their trajectories.
    """
    [found] = solve_all(craft, task, [objective], starts, workers, progress, guesses)
    return [
        _judged(k, trajectory, episode(craft, task, timing, scenario, trajectory))
        if trajectory.solved
        else Optimum(k, trajectory)
        for k, (trajectory, scenario) in enumerate(zip(found, each(starts), strict=True))
    ]


def _judged(start: int, trajectory: Trajectory, flight: Flight) -> Optimum:
    """Against its flight in Drake."""
    last = len(trajectory.commands)
    planned = map_leaves(lambda x: x[: last + 1, 0], flight.states)
    end = map_leaves(lambda x: float(x[-1]), planned)
    goal = map_leaves(lambda x: float(x[last, 0] if x.ndim == 2 else x[0]), flight.goals)
    errors = {name: float(error) for name, error in flight.task.errors(end, goal).items()}
    return Optimum(
        start, trajectory, float((planned.p - trajectory.states.p).norm().max()), errors, flight
    )


def episode(
    craft: Spacecraft, task: Task, timing: Timing, scenario: Scenario, trajectory: Trajectory
) -> Flight:
    """A trajectory that was solved, flown by Drake for a whole episode, thrusters shut once it has arrived.

    The timing says how long; the control period is the trajectory's own. The scenario is of floats. Thrust is
    what the optimiser took it for: steady over each period, also of a craft whose valves give it in pulses.
    """
    if isinstance(craft.actuators, Pulsed):
        craft = replace(craft, actuators=Throttle())
    period = trajectory.control_period
    planned = len(trajectory.commands)
    steps = max(planned, math.ceil(timing.episode_steps * timing.control_period / period - 1e-9))
    commands = np.vstack([trajectory.commands, np.zeros((steps - planned, len(craft.thrusters)))])
    own = Timing(control_period=period, episode_steps=steps)
    states = map_leaves(
        lambda x: x[:, None], replay(craft, scenario.start, commands, own, task.drift)
    )
    goals = map_leaves(lambda x: np.array([x]), scenario.goal)
    if moves_goal(task):
        times = period * np.arange(steps + 1.0)
        goals = map_leaves(
            lambda x: np.broadcast_to(x, steps + 1)[:, None], task.later(scenario.goal, times)
        )
    after = map_leaves(lambda x: x[1:], states)
    then = map_leaves(lambda x: x[1:] if x.ndim == 2 else x, goals)
    margins = task.constraints(after, then)
    return Flight(
        craft,
        task,
        own,
        states,
        goals,
        commands[:, None],
        trajectory.objective,
        "drake",
        {name: np.broadcast_to(margin, (steps, 1)) for name, margin in margins.items()},
    )


def table(title: str, objective: Objective, answers: Sequence[Optimum]) -> Table:
    """A row per start, and a sentence for those without a trajectory."""
    lost: dict[str, list[str]] = {}
    for answer in answers:
        if not answer.good:
            lost.setdefault(answer.sentence, []).append(str(answer.start))
    notes = [f"Start {', '.join(starts)}: {sentence}." for sentence, starts in lost.items()]
    names = list(next((answer.errors for answer in answers if answer.errors), {}))
    errors = [f"{name} {DISPLAY[name][1]}" for name in names]
    columns = ("start", objective.measure, *errors, "replay mm", "steps", "ms", "")
    result = terminal.table(title, columns, (), "\n".join(notes), "right")
    for answer in answers:
        path = answer.trajectory
        good = answer.good
        numbers = (
            path.cost,
            *(DISPLAY[n][0] * answer.errors.get(n, math.nan) for n in names),
            1e3 * answer.replay_error,
        )
        shown = [f"{x:.3f}" if path.solved else "-" for x in numbers]
        result.add_row(
            str(answer.start),
            *shown,
            str(path.iterations),
            f"{1e3 * path.seconds:.0f}",
            "solved" if good else "lost",
            style=None if good else "red",
        )
    return result


def write(folder: Path, about: dict[str, Any], answers: Sequence[Optimum]) -> None:
    """Write optimal.json, the answers, and optimal.npz, the trajectories; `ConfigError` if the disk refused.

    The arrays of optimal.npz: ``states`` (N, T + 1, leaves) in the order that ``leaves`` names,
    ``commands`` (N, T, thrusters) and ``control_period`` (N,); NaN where a problem was not solved.
    """
    paths = [answer.trajectory for answer in answers]
    known = np.array([1.0 if p.solved else np.nan for p in paths])[:, None, None]
    save_arrays(
        folder / "optimal.npz",
        {
            "states": known * np.stack([np.stack(leaves(p.states), axis=-1) for p in paths]),
            "commands": known * np.stack([p.commands for p in paths]),
            "control_period": np.array([p.control_period for p in paths]),
            "leaves": np.array(_LEAVES[len(leaves(paths[0].states))].split()),
        },
    )
    write_json(
        folder / "optimal.json",
        {**about, "environment": environment(), "starts": [answer.to_json() for answer in answers]},
    )
