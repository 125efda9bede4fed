"""Controllers beside each other and beside what is possible, from the same starts."""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from rich.table import Table

from rans.evaluation.metrics import DISPLAY, final_errors, impulses, on_times, settling_times
from rans.fields import map_leaves
from rans.flight import Controller, Flight, fly, scenarios
from rans.optimal.objectives import MinimumFuel, MinimumTime, Objective
from rans.optimal.pool import solve_all
from rans.optimal.transcription import Trajectory
from rans.reference.flight import replay
from rans.scenario import Scenario
from rans.spacecraft import Spacecraft
from rans.tasks.base import Task
from rans.timing import Timing

_TRANSFER_SHARE = 0.8
"""Part of an episode that the minimum-fuel trajectory takes: it rests in the last fifth, where final
errors are measured."""

_TEXT = (
    "All fly from the same starts. Controllers open and shut thrusters. A bound is a locally optimal "
    "trajectory with relaxed thrust (anything between shut and open), planned to the exact goal with "
    "the future known: a mark, no controller and no certificate. It is flown in Drake before it is "
    "reported and coasts there once it has arrived; replay error is the largest distance (m) between "
    "the optimised and the flown path. Settling time (s) is when all errors enter their tolerances for "
    "good, on-time is in thruster-seconds, impulse in N s; errors are means over the last fifth of the "
    "episode."
)


_HEADINGS = {
    "median_settling_time": "median settling time s", "mean_on_time": "mean on-time s",
    "mean_impulse": "mean impulse N s", "largest_replay_error": "largest replay error m",
    "median_solve_time": "median solve time s",
}
"""How the terminal names the quantities of a summary."""


@dataclass(frozen=True)
class Row:
    """One contestant from one start."""

    start: int
    """Number of the scenario."""
    contestant: str
    kind: Literal["controller", "bound"]
    status: str
    """"flown", "failed" (the task ended the episode as lost), or how the optimiser ended."""
    settling_time: float | None = None
    """Time at which all errors enter their tolerances for good, s; None if they never do."""
    on_time: float | None = None
    """Summed time the thrusters were open, thruster-seconds; None if nothing was flown."""
    impulse: float | None = None
    """Thrust times time, summed over the thrusters, N s; None if nothing was flown."""
    errors: dict[str, float] | None = None
    """Mean over the last fifth of the episode, by quantity, SI units; None if nothing was flown."""
    replay_error: float | None = None
    """Of a bound: largest distance between the optimised and the flown path, m."""
    solve_time: float | None = None
    """Of a bound: wall time of the optimiser, s."""

    def to_json(self) -> dict[str, Any]:
        """Plain values; errors as people read them, with their unit in the key."""
        head = {"start": self.start, "contestant": self.contestant, "kind": self.kind,
                "status": self.status, "settling_time": self.settling_time, "on_time": self.on_time,
                "impulse": self.impulse}
        return head | _readable(self.errors or {}) | {"replay_error": self.replay_error,
                                                      "solve_time": self.solve_time}


@dataclass(frozen=True)
class Comparison:
    """Every contestant from every start."""

    title: str
    rows: tuple[Row, ...]

    def contestants(self) -> dict[str, list[Row]]:
        """Rows by contestant, in the order they were compared."""
        groups: dict[str, list[Row]] = {}
        for row in self.rows:
            groups.setdefault(row.contestant, []).append(row)
        return groups

    @property
    def unsolved(self) -> list[Row]:
        """Bounds whose optimiser found no trajectory."""
        return [row for row in self.rows if row.kind == "bound" and row.on_time is None]

    def summary(self) -> list[dict[str, Any]]:
        """One row of plain values a contestant."""
        return [_summary(name, rows) for name, rows in self.contestants().items()]

    def to_json(self) -> dict[str, Any]:
        """Plain values: what was compared, the summary and every start."""
        return {"title": self.title, "text": _TEXT, "summary": self.summary(),
                "starts": [row.to_json() for row in self.rows]}

    def tables(self) -> tuple[Table, Table]:
        """The starts (settling time and impulse of everyone) and the summary, for the terminal."""
        return self._starts_table(), self._summary_table()

    def _starts_table(self) -> Table:
        groups = self.contestants()
        table = Table("start", *groups, title="settling time and impulse", title_justify="left")
        for k, rows in enumerate(zip(*groups.values(), strict=True)):
            table.add_row(str(k), *(_outcome(row) for row in rows))
        return table

    def _summary_table(self) -> Table:
        summary = self.summary()
        table = Table("", *(str(row["contestant"]) for row in summary), title=self.title,
                      title_justify="left")
        for key in dict.fromkeys(key for row in summary for key in row if key != "contestant"):
            heading = _HEADINGS.get(key, key.replace("_", " "))
            table.add_row(heading, *(_cell(row.get(key)) for row in summary))
        return table


def compare(controllers: Sequence[Controller], craft: Spacecraft, task: Task, timing: Timing, seed: int,
            episodes: int, objectives: Sequence[Objective] | None = None, workers: int | None = None,
            progress: Callable[[], object] = lambda: None) -> Comparison:
    """Fly the controllers and find the optimal trajectories from scenarios 0 to N - 1 of a seed.

    Args:
        controllers: flown with our equations.
        craft: what flies.
        task: where to, and the tolerances within which an episode has settled.
        timing: control period and length of an episode.
        seed: of the scenarios.
        episodes: N.
        objectives: of the bounds, by default `bounds`.
        workers: see `rans.optimal.pool.solve_all`.
        progress: called once per solved problem.
    """
    starts = scenarios(task, craft, seed, episodes)
    objectives = bounds(timing) if objectives is None else objectives
    rows = [row for c in controllers for row in _flown(fly(craft, task, c, starts, timing))]
    for trajectories in solve_all(craft, task, objectives, starts, workers, progress):
        rows += [_bound(craft, task, timing, starts, k, t) for k, t in enumerate(trajectories)]
    title = (f"{episodes} starts of seed {seed}, {craft.name}, "
             f"{timing.episode_steps * timing.control_period:g} s at {1 / timing.control_period:g} Hz")
    return Comparison(title, tuple(rows))


def bounds(timing: Timing) -> tuple[Objective, ...]:
    """The marks every controller is measured against: least time, and least fuel with time to rest."""
    steps = max(1, int(timing.episode_steps * _TRANSFER_SHARE))
    return (MinimumTime(), MinimumFuel(steps * timing.control_period, timing.control_period))


def _flown(flight: Flight) -> Iterator[Row]:
    for k, (failed, measured) in enumerate(zip(flight.failed(), _measured(flight), strict=True)):
        yield Row(k, flight.controller, "controller", "failed" if failed else "flown", **measured)


def _measured(flight: Flight) -> Iterator[dict[str, Any]]:
    """The measured fields of a `Row`, for every episode."""
    settling, open_for, spent = settling_times(flight), on_times(flight), impulses(flight)
    errors = final_errors(flight)
    for k in range(len(settling)):
        yield {
            "settling_time": float(settling[k]) if math.isfinite(settling[k]) else None,
            "on_time": float(open_for[k]), "impulse": float(spent[k]),
            "errors": {name: float(error[k]) for name, error in errors.items()},
        }


def _bound(craft: Spacecraft, task: Task, timing: Timing, starts: Scenario, k: int,
           trajectory: Trajectory) -> Row:
    name = f"{trajectory.objective} (bound)"
    if not trajectory.solved:
        return Row(k, name, "bound", trajectory.status, solve_time=trajectory.seconds)
    start, goal = (map_leaves(lambda x: x[k:k + 1], s) for s in (starts.start, starts.goal))
    flight = _in_drake(craft, task, timing, Scenario(start, goal), trajectory, name)
    arrived = len(trajectory.commands) + 1
    gap = map_leaves(lambda x: x[:arrived, 0], flight.states).p - trajectory.states.p
    return Row(k, name, "bound", trajectory.status, replay_error=float(np.max(gap.norm())),
               solve_time=trajectory.seconds, **next(_measured(flight)))


def _in_drake(craft: Spacecraft, task: Task, timing: Timing, scenario: Scenario, trajectory: Trajectory,
              name: str) -> Flight:
    """The trajectory flown open loop for a whole episode, thrusters shut once it has arrived."""
    duration, period = timing.episode_steps * timing.control_period, trajectory.control_period
    steps = max(len(trajectory.commands), math.ceil(duration / period - 1e-9))
    coast = np.zeros((steps - len(trajectory.commands), trajectory.commands.shape[1]))
    commands = np.vstack([trajectory.commands, coast])
    own = Timing(control_period=period, episode_steps=steps)
    states = replay(craft, map_leaves(lambda x: float(x[0]), scenario.start), commands, own)
    states = map_leaves(lambda x: x[:, None], states)
    return Flight(craft, task, own, states, scenario.goal, commands[:, None], name, "drake")


def _summary(name: str, rows: Sequence[Row]) -> dict[str, Any]:
    def known(values: Iterable[float | None]) -> list[float]:
        return [x for x in values if x is not None]

    settling = known(row.settling_time for row in rows)
    median = statistics.median(settling + [math.inf] * (len(rows) - len(settling)))
    flown = [row.errors for row in rows if row.errors is not None]
    quantities = flown[0] if flown else {}
    means = {key: statistics.mean(errors[key] for errors in flown) for key in quantities}
    return {
        "contestant": name, "kind": rows[0].kind, "starts": len(rows), "flown": len(flown),
        "settled": len(settling), "median_settling_time": median if math.isfinite(median) else None,
        "mean_on_time": _mean(known(row.on_time for row in rows)),
        "mean_impulse": _mean(known(row.impulse for row in rows)),
        **_readable(means),
        "largest_replay_error": max(known(row.replay_error for row in rows), default=None),
        "median_solve_time": _median(known(row.solve_time for row in rows)),
    }


def _mean(values: Sequence[float]) -> float | None:
    return statistics.mean(values) if values else None


def _median(values: Sequence[float]) -> float | None:
    return statistics.median(values) if values else None


def _readable(errors: dict[str, float]) -> dict[str, float]:
    """Errors in the units people read them in, which their keys name."""
    units = {name: DISPLAY[name] for name in errors}
    return {f"{name}_error_{unit.replace('/', '_per_')}": errors[name] * factor
            for name, (factor, unit) in units.items()}


def _outcome(row: Row) -> str:
    if row.impulse is None:
        return row.status
    settled = "never" if row.settling_time is None else f"{row.settling_time:.1f} s"
    return f"{settled}, {row.impulse:.2f} N s"


def _cell(value: Any) -> str:
    if value is None:
        return "-"
    return f"{value:.3g}" if isinstance(value, float) else str(value)
