"""Optimal trajectories from the evaluation starts: flights in Drake, tables and files."""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from rans import RansWarning
from rans.extend import (
    QUANTITIES,
    ConfigError,
    Flight,
    Heading,
    Progress,
    Scenario,
    Spacecraft,
    Table,
    Task,
    Timing,
    each,
    environment,
    leaves,
    map_leaves,
    require,
    to_toml,
    unseen,
    write_json,
    write_text,
)
from rans_optimal.checks import moves_goal
from rans_optimal.objectives import Objective
from rans_optimal.pool import solve_all
from rans_optimal.transcription import START_IS_GOAL, Trajectory, usual_guesses

REPLAY_BOUND = 1e-3
"""Largest distance between an optimised and the flown path, m: a fiftieth of the tolerance of tasks."""

_SENTENCES = {
    "Infeasible_Problem_Detected": "the optimiser found no trajectory that arrives in this time",
    "Restoration_Failed": "the optimiser found no trajectory that arrives in this time",
    "Maximum_Iterations_Exceeded": "the solver stopped after 500 iterations without an answer",
    "Invalid_Number_Detected": "a number became NaN or infinite: the start, goal or task has one",
    "Worker_Died": "the process that solved it died, usually for lack of memory",
}
"""Sentences for results of the optimiser. It searches locally: only a certificate proves that nothing arrives."""

_AS_PLANNED = Timing(episode_steps=1)


@dataclass(frozen=True)
class Optimum:
    """Optimum of one start."""

    start: int
    """Number of the scenario."""
    trajectory: Trajectory
    replay_error: float = math.nan
    """Largest distance between the optimised path and the flight in Drake, m."""
    errors: dict[str, float] = field(default_factory=dict)
    """The task's errors at the trajectory's end in Drake, SI units."""
    flight: Flight | None = None
    """Flight in Drake; see `episode`. None: there is no trajectory, or Drake is not installed."""

    def __repr__(self) -> str:
        path = self.trajectory
        return (
            f"<Optimum of {path.objective} from start {self.start}: {path.cost:g}, {self.sentence}>"
        )

    @property
    def good(self) -> bool:
        """Whether there is a trajectory, and the flight in Drake, if there is one, follows it."""
        flies = self.flight is None or self.replay_error <= REPLAY_BOUND
        return bool(self.trajectory.solved and flies)

    @property
    def sentence(self) -> str:
        """Result in words."""
        status = self.trajectory.status
        if not self.trajectory.solved:
            return _SENTENCES.get(status, f"the solver stopped: {status.replace('_', ' ').lower()}")
        if status == START_IS_GOAL:
            return "0 s: the start is the goal"
        if self.flight is None:
            return "solved, not flown"
        return "solved" if self.good else "solved, but Drake flies elsewhere"

    def to_json(self) -> dict[str, Any]:
        """Entry of a start in optimal.json; numbers that are missing are NaN. Units are those of `Trajectory`.

        Keys are an interface of `rans optimal`.
        """
        path = self.trajectory
        result = 1.0 if path.solved else math.nan
        return {
            "start": self.start,
            "status": path.status,
            "good": self.good,
            "sentence": self.sentence,
            "cost": result * path.cost,
            "time": result * path.control_period * len(path.commands),
            "replay_error": self.replay_error,
            "seconds": path.seconds,
            "iterations": path.iterations,
            "attempts": path.attempts,
            "agreeing": path.agreeing,
            "optima": path.optima,
            "errors": self.errors,
        }


def optima(
    craft: Spacecraft,
    task: Task,
    objective: Objective,
    starts: Scenario,
    guesses: int | None = 1,
    workers: int | None = None,
    progress: Progress = unseen,
    timing: Timing = _AS_PLANNED,
) -> list[Optimum]:
    """Optimise from every start and fly the trajectories in Drake; there is an answer for every start.

    Without Drake nothing is flown, which a warning says before the work.

    Args:
        craft: spacecraft.
        task: task.
        objective: objective to minimise.
        starts: starts, whose fields are arrays (N,).
        guesses: see `rans_optimal.transcription.Transcription.solve`; None: the usual number.
        workers: see `rans_optimal.pool.solve_all`.
        progress: reports solved problems.
        timing: length of flights, see `episode`; by default that of their trajectories.
    """
    try:
        require("pydrake")
        flies = True
    except ConfigError as reason:
        flies = False
        warnings.warn(f"trajectories are not flown in Drake: {reason}", RansWarning, stacklevel=2)
    if guesses is None:
        guesses = usual_guesses(craft, task, objective)
    trajectories = solve_all(craft, task, objective, starts, workers, progress, guesses)
    return [
        _judged(k, trajectory, episode(craft, task, timing, scenario, trajectory))
        if trajectory.solved and flies
        else Optimum(k, trajectory)
        for k, (trajectory, scenario) in enumerate(zip(trajectories, each(starts), strict=True))
    ]


def _judged(start: int, trajectory: Trajectory, flight: Flight) -> Optimum:
    """Optimum of a trajectory flown in Drake: largest distance between both (m), and errors at the end.

    The flight has one episode; states after its last command are left out.
    """
    last = len(trajectory.commands) if trajectory.control_period > 0.0 else 0
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
    """Fly a trajectory in Drake for a whole episode, with all thrusters shut after its end.

    The length is that of the timing, the control period that of the trajectory. Fields of the scenario are floats.
    Thrust is constant over each period, as in the optimization, even if the craft's valves give it in pulses.
    Margins of constraints are those at the ends of control periods, between which they are not checked. After a
    success states and commands remain those of the trajectory, with which they are compared.
    """
    from rans.reference.flight import replay

    steady = craft.actuators.steady()
    if steady != craft.actuators:
        craft = replace(craft, actuators=steady)
    period = trajectory.control_period
    planned = len(trajectory.commands)
    if period == 0.0:  # the start is the goal: all thrusters stay shut
        period = timing.control_period
        planned = 0
    # The trajectory's own period divides the episode; thrusters are shut after its end.
    steps = max(planned, math.ceil(timing.episode_steps * timing.control_period / period - 1e-9))
    planned_commands = trajectory.commands[:planned]
    commands = np.vstack([planned_commands, np.zeros((steps - planned, craft.thruster_count))])
    own = Timing(control_period=period, episode_steps=steps)
    states = map_leaves(
        lambda x: x[:, None], replay(craft, scenario.start, commands, own, task.drift)
    )
    # Goals that move are those of the task's own law.
    goals = map_leaves(lambda x: np.array([x]), scenario.goal)
    if moves_goal(task):
        times = period * np.arange(steps + 1.0)
        goals = map_leaves(
            lambda x: np.broadcast_to(x, steps + 1)[:, None], task.later(scenario.goal, times)
        )
    after = map_leaves(lambda x: x[1:], states)
    then = map_leaves(lambda x: x[1:] if x.ndim == 2 else x, goals)
    margins = {
        name: np.broadcast_to(margin, (steps, 1))
        for name, margin in task.constraints(after, then).items()
    }
    done = task.done(after, then)
    won: np.ndarray | None = None
    lengths: np.ndarray | None = None
    if done is not None:
        ever = np.broadcast_to(done, (steps, 1))
        won = np.asarray(ever.any(axis=0))
        lengths = np.where(won, ever.argmax(axis=0) + 1, steps)
        over = np.arange(steps)[:, None] >= lengths
        margins = {name: np.where(over, np.inf, margin) for name, margin in margins.items()}
    return Flight(
        craft,
        task,
        own,
        states,
        goals,
        commands[:, None],
        trajectory.objective,
        "drake",
        margins,
        won,
        lengths,
    )


def optima_table(title: str, objective: Objective, answers: Sequence[Optimum]) -> Table:
    """Table with a row for each start, and a sentence for those without a trajectory."""
    # Notes: starts without a trajectory, by reason.
    lost: dict[str, list[str]] = {}
    for answer in answers:
        if not answer.good or answer.trajectory.status == START_IS_GOAL:
            lost.setdefault(answer.sentence, []).append(str(answer.start))
    notes = [f"Start {', '.join(starts)}: {sentence}." for sentence, starts in lost.items()]
    if any(answer.trajectory.attempts > 1 for answer in answers):
        notes.append("guesses: those that led to this cost, of all.")
    # Columns: cost, errors at the end, and what agrees.
    names = list(next((answer.errors for answer in answers if answer.errors), {}))
    errors = [f"{name} {QUANTITIES[name].display[1]}" for name in names]
    columns = ("start", objective.measure, *errors, "replay mm", "guesses", "")
    rows = []
    for answer in answers:
        path = answer.trajectory
        numbers = (
            path.cost,
            *(QUANTITIES[n].display[0] * answer.errors.get(n, math.nan) for n in names),
            1e3 * answer.replay_error,
        )
        cells = [f"{x:.3f}" if path.solved else "-" for x in numbers]
        row = (
            str(answer.start),
            *cells,
            f"{path.agreeing} of {path.attempts}",
            "solved" if answer.good else "lost",
        )
        rows.append(row)
    lost_rows = [number for number, answer in enumerate(answers) if not answer.good]
    return Table(columns, rows, title, "\n".join(notes), right=columns, marked=lost_rows)


def write(
    folder: Path,
    about: dict[str, Any],
    answers: Sequence[Optimum],
    craft: Spacecraft,
) -> None:
    """Write optimal.json, the answers, and the trajectories, if there are some, as optimal.csv.

    It has a row for every instant of the trajectories that were solved, with the commands of the
    period that begins there, empty at the last one. spacecraft.toml is the spacecraft.

    Raises:
        ConfigError: a file cannot be written.
    """
    rows = {"starts": [answer.to_json() for answer in answers]} if answers else {}
    write_json(folder / "optimal.json", {**about, "environment": environment(), **rows}, beside=())
    if not answers:
        return
    write_text(folder / "spacecraft.toml", to_toml(craft))
    write_text(folder / "optimal.csv", _csv(answers))


def _names(states: Any) -> list[str]:
    """Names of a state's values.

    Position and velocity in W (m, m/s), heading (rad) or the quaternion R_WB, and the angular velocity (rad/s, in
    space on B).
    """
    if isinstance(states.attitude, Heading):
        return ["p.x", "p.y", "heading", "v.x", "v.y", "w"]
    vectors = [f"{name}.{axis}" for name in "pvw" for axis in "xyz"]
    return [*vectors[:3], "q.w", "q.x", "q.y", "q.z", *vectors[3:]]


def _csv(answers: Sequence[Optimum]) -> str:
    """Trajectories as a CSV file: a row for each state between control periods, with the command that follows.

    SI units; the last state of a start has no command. Readers rely on names and order of columns.
    """
    path = answers[0].trajectory
    commands = [f"command.{k}" for k in range(path.commands.shape[1])]
    lines = [",".join(["start", "time", *_names(path.states), *commands])]
    for answer in answers:
        path = answer.trajectory
        if not path.solved:
            continue
        columns = np.stack(leaves(path.states), axis=-1)
        for k, state in enumerate(columns):
            numbers = [f"{x:.10g}" for x in path.commands[k]] if k < len(path.commands) else []
            row = [f"{k * path.control_period:.10g}", *(f"{x:.10g}" for x in state), *numbers]
            row += [""] * (len(commands) - len(numbers))
            lines.append(",".join([str(answer.start), *row]))
    return "\n".join(lines) + "\n"
