"""What each error of a spacecraft costs a mission: ``python -m campaigns.error_sources``.

Guidance flies the same evaluation starts without errors, with each error alone and with all of them. Percentiles of
arrival, impulse and margin stand beside each other, and what each error adds. A craft that LQR keeps at the hold
point is compared with linear covariance (`campaigns.linear_covariance`). With ``--docs docs`` the command writes
docs/validation/error-sources.json, the tables of docs/missions/errors.md and its figure.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import tyro
from rans_missions.control.mission_guidance import MissionGuidance
from rans_missions.tasks import Hold

from campaigns.command import ended
from campaigns.linear_covariance import LinearCovariance, linear_covariance, spread
from campaigns.markdown import Table
from rans.evaluation.measure.metrics import PERCENTILES, impulses, settling_times, solved
from rans.evaluation.measure.statistics import figure as rounded
from rans.files import environment, number, read_json, write_json, write_text
from rans.flight import fly
from rans.model.dynamics import SpatialState
from rans.model.fields import Quat, Vec3, map_leaves
from rans.model.spacecraft_file import load_spacecraft
from rans.model.timing import Timing
from rans.optimal.control.lqr import LQR
from rans.optimal.control.regulator import Deadband
from rans.processes import Workers
from rans.randomization.conditions import (
    BodyConditions,
    Conditions,
    DisturbanceConditions,
    SensorConditions,
    SensorsConditions,
    ThrusterConditions,
)
from rans.scenario import EVALUATION_SEED, Scenario, draws, scenarios
from rans.tasks import TASKS
from rans.terminal import Terminal

_FILE = "error-sources.json"
_PAGE = "missions/errors.md"
_PICTURE = "pictures/missions/error-sources.svg"
_COMMAND = "python -m campaigns.error_sources --docs docs"
_JOB = 512
"""Number of starts that a process flies together."""


class Errors(NamedTuple):
    """Sizes of a mission's errors."""

    position: float
    """Standard deviation of the noise of each component of a measured position, m; largest constant error."""
    velocity: float
    """Standard deviation of the noise of each component of a measured velocity, m/s; largest constant error."""
    force: float
    """Largest constant force, N, in a random direction: differential drag and others."""
    delay: float
    """Largest command delay, s."""
    part: float = 0.05
    """Largest relative error of the thrust of each thruster, and of the mass."""


SIZES = {
    "dock": Errors(0.05, 1e-3, 1e-4, 1.0),
    "hold": Errors(0.3, 1e-3, 5e-3, 1.0),
}
"""By mission. The forces are accelerations of 1e-5 m/s^2: ten times the drag of a small satellite at 400 km."""
_NONE = "none"
_ALL = "all"


def sources(errors: Errors) -> dict[str, Conditions]:
    """Conditions by the name of their error: none, each alone, and all together."""
    around = (1.0 - errors.part, 1.0 + errors.part)
    noise = SensorsConditions(
        position=SensorConditions(noise=errors.position),
        velocity=SensorConditions(noise=errors.velocity),
    )
    bias = SensorsConditions(
        position=SensorConditions(bias=(0.0, errors.position)),
        velocity=SensorConditions(bias=(0.0, errors.velocity)),
    )
    both = SensorsConditions(
        position=replace(noise.position, bias=bias.position.bias),
        velocity=replace(noise.velocity, bias=bias.velocity.bias),
    )
    late = (0.0, errors.delay)
    body = BodyConditions(mass=around)
    pushed = DisturbanceConditions(force=(0.0, errors.force))
    return {
        _NONE: Conditions(),
        "navigation noise": Conditions(sensors=noise),
        "navigation bias": Conditions(sensors=bias),
        "thrust error": Conditions(thrusters=ThrusterConditions(thrust=around)),
        "command delay": Conditions(thrusters=ThrusterConditions(command_delay=late)),
        "mass": Conditions(body=body),
        "constant force": Conditions(disturbances=pushed),
        _ALL: Conditions(
            body=body,
            thrusters=ThrusterConditions(thrust=around, command_delay=late),
            disturbances=pushed,
            sensors=both,
        ),
    }


@dataclass(frozen=True)
class ErrorSources:
    """Fly all errors of all missions, and print the tables."""

    only: str = ""
    """Measure one mission alone, or "linear", and keep the others as they are in the evidence."""
    episodes: int = 512
    """Number of starts of each row."""
    flights: int = 2048
    """Number of flights that are compared with linear covariance."""
    workers: int | None = None
    """Number of processes; None: one per processor."""
    seed: int = EVALUATION_SEED
    """Seed of starts and errors."""
    docs: Path | None = None
    """Folder of the documents whose tables, evidence and figure are written; None: they are not."""

    def run(self) -> int:
        """Fly, print and write."""
        file = None if self.docs is None else self.docs / "validation" / _FILE
        known = read_json(file) if self.only and file and file.exists() else {}
        missions: dict[str, Any] = known.get("missions", {})
        for mission in SIZES:
            if self.only in ("", mission):
                missions[mission] = self._mission(mission)
        linear = known.get("linear")
        if linear is None or self.only in ("", "linear"):
            linear = beside_flights(self.flights, self.seed, self.workers)
        evidence = {
            "seed": self.seed,
            "environment": environment(),
            "missions": missions,
            "linear": linear,
        }
        for mission, rows in missions.items():
            Terminal().show(mission, _headings(mission), _cells(rows))
            Terminal().show(f"{mission}, sensitivity", _SENSITIVITY, _costs(rows))
        Terminal().show("linear covariance", _LINEAR, _linear_cells(linear))
        if self.docs is not None and file is not None:
            write_json(file, evidence)
            for table in tables(self.docs).values():
                table.write(self.docs)
            if missions:
                write_text(self.docs / _PICTURE, picture(missions))
        return 0

    def _mission(self, mission: str) -> dict[str, Any]:
        """The rows of one mission, by error."""
        names = [*sources(SIZES[mission])]
        firsts = range(0, self.episodes, _JOB)
        jobs = [
            (mission, name, self.seed, first, min(_JOB, self.episodes - first))
            for name in names
            for first in firsts
        ]
        parts = [*Workers(int, (), self.workers, "flew starts").ordered(flown, jobs)]
        rows = {}
        for k, name in enumerate(names):
            mine = parts[k * len(firsts) : (k + 1) * len(firsts)]
            rows[name] = _row(*(np.concatenate(values) for values in zip(*mine, strict=True)))
        return rows


def flown(_: int, mission: str, name: str, seed: int, first: int, count: int) -> tuple[Any, ...]:
    """Flights of so many starts of a mission with one error, from the first one on; a job of a worker.

    Returns:
        Whether each flight won and broke a limit, its arrival (s), impulse (N s) and least margin (m or m/s).
    """
    conditions = sources(SIZES[mission])[name]
    task = TASKS[mission]().for_evaluation()
    assert task.spacecraft is not None
    craft = load_spacecraft(task.spacecraft)
    flight = fly(
        craft,
        task,
        MissionGuidance(craft, task, task.timing, conditions),
        scenarios(task, craft, seed, count, first),
        task.timing,
        conditions=conditions.or_none,
        draws=draws(seed, count, first) if conditions.or_none else None,
    )
    broken = flight.violated()
    (margins,) = flight.margins.values()
    return (
        solved(flight) & ~broken,
        broken,
        settling_times(flight),
        impulses(flight),
        margins.min(axis=0),
    )


def _row(
    won: np.ndarray, broken: np.ndarray, arrival: np.ndarray, impulse: np.ndarray, least: np.ndarray
) -> dict[str, Any]:
    return {
        "starts": len(won),
        "won": float(won.mean()),
        "broken": float(broken.mean()),
        "arrival": [_quantile(arrival, x / 100.0) for x in PERCENTILES],
        "impulse": [_quantile(impulse, x / 100.0) for x in PERCENTILES],
        # The lower end: 99 % keep a margin that 1 % fall below.
        "margin": [_quantile(least, 1.0 - x / 100.0) for x in PERCENTILES],
        "mean impulse": float(impulse.mean()),
    }


def _quantile(values: np.ndarray, part: float) -> float:
    """Quantile of one value per flight: the least value that so large a part of the flights do not exceed."""
    return float(np.quantile(values, part, method="inverted_cdf"))


def beside_flights(count: int, seed: int, workers: int | None) -> dict[str, Any]:
    """Spreads of a craft that LQR keeps at the hold point, by linear covariance and of so many flights."""
    names = [name for name in sources(SIZES["hold"]) if name != _NONE]
    jobs = [(name, count, seed) for name in names]
    rows = {}
    for name, (linear, flights) in zip(
        names, Workers(int, (), workers, "flew starts").ordered(largest_spreads, jobs), strict=True
    ):
        rows[name] = {"linear": linear, "flights": flights}
    return {"flights": count, "seconds": _STEPS * Hold.timing.control_period, "rows": rows}


def largest_spreads(_: int, name: str, count: int, seed: int) -> tuple[list[float], list[float]]:
    """Largest spreads of the whole flight with one error, of position (m) and velocity (m/s); a job of a worker."""
    covariance, flights = spreads(sources(SIZES["hold"])[name], count, seed)
    linear = spread(covariance.all).max(axis=0)
    return [float(x) for x in linear], [float(x) for x in flights.max(axis=0)]


_OFFSET = (10.0, -15.0, 8.0)
"""Position from which LQR goes to the hold point, from there, m: near enough that no thruster saturates."""
_STEPS = 40
"""Number of control periods: before the ten minutes that end the mission."""


def spreads(conditions: Conditions, count: int, seed: int) -> tuple[LinearCovariance, np.ndarray]:
    """Linear covariance of LQR at the hold point, and `spread` (T + 1, 2) of so many flights of the engine."""
    task = replace(Hold(), deadline=(2000.0, 2000.0))
    craft = load_spacecraft("vbar-chaser")
    timing = Timing(Hold.timing.control_period, _STEPS)
    # A linear law: without the dead band, in which thrusters stay shut. It stays far from the keep-out ball.
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="LQR does not know the constraints")
        law = LQR(craft, task, timing, deadband=Deadband(share=0.0))
    starts = scenarios(task, craft, seed, count)
    offset = Vec3(*_OFFSET)
    start = replace(starts.start, p=starts.goal.p + offset)
    flight = fly(
        craft,
        task,
        law,
        Scenario(start, task.plan(start, starts.goal, np.full(count, 2000.0))),
        timing,
        conditions=conditions,
        draws=draws(seed, count),
    )
    states = np.stack([*flight.states.p.columns(), *flight.states.v.columns()], axis=-1)
    one = map_leaves(lambda x: np.asarray(x)[:1], starts.goal)
    commands = partial(_commands, law, one)
    begin = np.array([*(float(x[0]) for x in start.p.columns()), 0.0, 0.0, 0.0])
    covariance = linear_covariance(
        craft, task.drift, commands, begin, timing.control_period, _STEPS, conditions
    )
    deviations = states - states.mean(axis=1, keepdims=True)
    square = (deviations**2).mean(axis=1)
    return covariance, np.sqrt(
        np.stack([square[:, :3].sum(axis=1), square[:, 3:].sum(axis=1)], axis=1)
    )


def _commands(law: LQR, goal: Any, states: np.ndarray) -> np.ndarray:
    """Commands (N, thrusters) of LQR for states (N, 6)."""
    zero = np.zeros(len(states))
    still = Vec3(zero, zero, zero)
    state = SpatialState(
        Vec3(*states[:, :3].T), Quat(zero + 1.0, zero, zero, zero), Vec3(*states[:, 3:].T), still
    )
    goals = map_leaves(lambda x: np.broadcast_to(x, len(states)), goal)
    law.reset(len(states))
    return law.act(state, goals, np.zeros((len(states), 0)))


_SENSITIVITY = (
    "error",
    "impulse, mean",
    "impulse, 99.7 %",
    "arrival, 99.7 %",
    "margin lost, 99.7 %",
    "flights lost, %",
)
_LINEAR = ("error", "position, linear", "flights", "ratio", "velocity, linear", "flights", "ratio")
_UNITS = {"dock": "m/s", "hold": "m"}
"""Units of the margins of the missions' limits."""


def _headings(mission: str) -> tuple[str, ...]:
    return (
        "error",
        "won, %",
        "limit broken, %",
        "arrival, s",
        "impulse, N s",
        f"margin, {_UNITS[mission]}",
    )


def _cells(rows: dict[str, Any]) -> list[list[str]]:
    """Percentiles of a mission, in the order of `PERCENTILES`."""
    return [
        [
            name,
            f"{100.0 * row['won']:.1f}",
            f"{100.0 * row['broken']:.1f}",
            *(
                " / ".join(rounded(number(x)) for x in row[what])
                for what in ("arrival", "impulse", "margin")
            ),
        ]
        for name, row in rows.items()
    ]


def _costs(rows: dict[str, Any]) -> list[list[str]]:
    """What each error adds to the flights without errors, the largest impulse first."""
    base = rows[_NONE]
    cells = []
    for name, row in rows.items():
        if name == _NONE:
            continue
        mean = row["mean impulse"] / base["mean impulse"] - 1.0
        spent = row["impulse"][-1] / base["impulse"][-1] - 1.0
        later = number(row["arrival"][-1]) - number(base["arrival"][-1])
        less = base["margin"][-1] - row["margin"][-1]
        lost = base["won"] - row["won"]
        cells.append(
            (
                mean,
                [
                    name,
                    f"{100.0 * mean:+.1f} %",
                    f"{100.0 * spent:+.1f} %",
                    f"{later:+.0f} s" if np.isfinite(later) else "never",
                    f"{less:.2g}",
                    f"{100.0 * lost:.1f}",
                ],
            )
        )
    cells.sort(key=lambda one: -one[0])
    return [row for _, row in cells]


def _linear_cells(linear: dict[str, Any]) -> list[list[str]]:
    cells = []
    for name, row in linear["rows"].items():
        line = [name]
        for of_law, of_flights, unit, scale in zip(
            row["linear"], row["flights"], ("cm", "mm/s"), (100.0, 1000.0), strict=True
        ):
            line += [
                f"{scale * of_law:.3g} {unit}",
                f"{scale * of_flights:.3g} {unit}",
                f"{of_law / of_flights:.3f}",
            ]
        cells.append(line)
    return cells


def picture(missions: dict[str, Any]) -> str:
    """Figure (SVG) of the impulse that each error adds, in the mean and of 99.7 % of the flights."""
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    from rans.show.figures.panels import BLUE, INK, ORANGE, STYLE
    from rans.show.figures.svg import svg

    with rc_context(STYLE):
        figure = Figure(figsize=(9.0, 3.2), layout="constrained")
        panels = figure.subplots(1, len(missions), squeeze=False)[0]
        for axes, (mission, rows) in zip(panels, missions.items(), strict=True):
            names = [name for name in rows if name != _NONE]
            base = rows[_NONE]
            mean = [100.0 * (rows[x]["mean impulse"] / base["mean impulse"] - 1.0) for x in names]
            most = [100.0 * (rows[x]["impulse"][-1] / base["impulse"][-1] - 1.0) for x in names]
            where = np.arange(len(names))
            axes.barh(where - 0.2, mean, 0.4, label="mean", color=BLUE)
            axes.barh(where + 0.2, most, 0.4, label="99.7 % of the flights", color=ORANGE)
            axes.set_yticks(where, names)
            axes.invert_yaxis()
            axes.set_xlabel("impulse added, %")
            axes.set_title(mission)
            axes.axvline(0.0, color=INK, linewidth=0.8)
        figure.axes[0].legend()
        return svg(figure)


def tables(docs: Path) -> dict[str, Table]:
    """All tables of the page, by the end of their command."""
    evidence = read_json(docs / "validation" / _FILE)
    source = f"The values are in [{_FILE}](../../../docs/validation/{_FILE})."
    result = {}
    for mission, rows in evidence["missions"].items():
        result[mission] = Table(
            _PAGE, f"{_COMMAND}, {mission}", _headings(mission), _cells(rows), ""
        )
        result[f"sensitivity of {mission}"] = Table(
            _PAGE, f"{_COMMAND}, sensitivity of {mission}", _SENSITIVITY, _costs(rows), ""
        )
    linear = evidence["linear"]
    result["linear"] = Table(_PAGE, f"{_COMMAND}, linear", _LINEAR, _linear_cells(linear), source)
    return result


TABLE_NAMES = (*SIZES, *(f"sensitivity of {mission}" for mission in SIZES), "linear")
"""Names of `tables`."""


def in_document(docs: Path, table: str) -> Table:
    """One table of the page."""
    return tables(docs)[table]


if __name__ == "__main__":
    # Jobs of other processes are in the module of its own name.
    from campaigns import error_sources

    raise SystemExit(ended("error sources", lambda: tyro.cli(error_sources.ErrorSources).run()))
