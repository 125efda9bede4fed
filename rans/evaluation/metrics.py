"""What a batch of flights is worth, in numbers with confidence intervals.

"Steps" are the T states that follow the commands; the start is nobody's merit and is left out. The
"last fifth" is the last T/5 of them, rounded down but at least one.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from rich.table import Table

from rans.dynamics import thrust
from rans.fields import map_leaves
from rans.flight import Flight
from rans.tasks import reached

RESAMPLES = 1000
"""Bootstrap resamples: the ends of a 95 % interval then rest on 25 resamples each."""

DISPLAY = {"position": (100.0, "cm"), "attitude": (math.degrees(1.0), "deg"),
           "velocity": (100.0, "cm/s"), "spin": (math.degrees(1.0), "deg/s")}
"""Factor from the SI unit and the unit in which people read an error."""

_TIME_WITHIN = {"position": "PT", "attitude": "OT", "velocity": "VT", "spin": "ST"}
"""PT and OT are the original system's names (2023); VT and ST continue them."""

_BOUNDS = (5, 2, 1)
"""Bounds of the time within, in the units of `DISPLAY`."""


class _Sample(NamedTuple):
    """What one metric is made of."""

    name: str
    meaning: str
    unit: str
    values: ArrayLike
    """(N,), one per episode."""
    centre: Callable[..., Any] = np.mean


@dataclass(frozen=True)
class Metric:
    """One number about all episodes and its 95 % confidence interval."""

    name: str
    meaning: str
    unit: str
    value: float
    """Mean over episodes, or their median where the meaning says so; infinite where most episodes
    never get there."""
    low: float
    """Lower end of the interval."""
    high: float
    """Upper end of the interval."""

    def texts(self) -> tuple[str, str, str, str]:
        """Name, value with unit, interval and meaning, as tables show them."""
        value, low, high = _text(self.value), _text(self.low), _text(self.high)
        unit = self.unit if math.isfinite(self.value) else ""
        return self.name, f"{value} {unit}".strip(), f"{low} to {high}", self.meaning


COLUMNS = ("metric", "value", "95 % interval", "meaning")
"""Headings of `Metric.texts`."""


@dataclass(frozen=True)
class Metrics:
    """Everything measured on one flight."""

    controller: str
    engine: str
    spacecraft: str
    episodes: int
    steps: int
    control_period: float
    """s."""
    rows: tuple[Metric, ...]

    def __getitem__(self, name: str) -> Metric:
        """The metric of this name.

        Raises:
            KeyError: the flight's task has none of this name.
        """
        return {row.name: row for row in self.rows}[name]

    def to_json(self) -> dict[str, Any]:
        """Plain values for a JSON file; infinities and NaN as the texts ``float`` reads back."""
        table = dataclasses.asdict(self)
        table["rows"] = [{k: _jsonable(v) for k, v in row.items()} for row in table["rows"]]
        return table

    @classmethod
    def from_json(cls, table: dict[str, Any]) -> Metrics:
        """The metrics that `to_json` wrote."""
        numbers = ("value", "low", "high")
        rows = [Metric(**(row | {k: float(row[k]) for k in numbers})) for row in table["rows"]]
        return cls(**{**table, "rows": tuple(rows)})

    def title(self) -> str:
        """What was measured, in one line."""
        duration = self.steps * self.control_period
        return (f"{self.controller}: {self.episodes} episodes of {duration:g} s with {self.spacecraft} "
                f"({self.engine} engine)")

    def table(self) -> Table:
        """A table for the terminal."""
        table = Table(*COLUMNS, title=self.title(), title_justify="left")
        for column in table.columns[:3]:
            column.no_wrap = True
        for row in self.rows:
            table.add_row(*row.texts())
        return table


def measure(flight: Flight, seed: int = 0) -> Metrics:
    """Measure a batch of episodes.

    Args:
        flight: N episodes of any task.
        seed: of the bootstrap's generator; the same flight and seed give the same intervals.
    """
    steps, episodes, _ = flight.commands.shape
    picks = np.random.default_rng(seed).integers(0, episodes, (RESAMPLES, episodes))
    rows = tuple(_metric(sample, picks) for sample in _samples(flight))
    return Metrics(flight.controller, flight.engine, flight.craft.name, episodes, steps,
                   flight.timing.control_period, rows)


def settling_times(flight: Flight) -> np.ndarray:
    """Time at which each episode enters all tolerances for good, (N,) s; infinite if it never does."""
    inside = reached(flight.task, flight.states, flight.goals)
    stays = np.logical_and.accumulate(inside[::-1])[::-1]
    waited = (~stays).sum(axis=0)
    return np.where(waited < len(stays), waited * flight.timing.control_period, np.inf)


def on_times(flight: Flight) -> np.ndarray:
    """Summed time the thrusters of each episode were open, (N,) thruster-seconds."""
    return flight.commands.sum(axis=(0, 2)) * flight.timing.control_period


def impulses(flight: Flight) -> np.ndarray:
    """Thrust spent by each episode, force times time summed over thrusters, (N,) N s."""
    shares = thrust(flight.craft, tuple(np.moveaxis(flight.commands, 2, 0)))
    forces = (share * t.force for share, t in zip(shares, flight.craft.thrusters, strict=True))
    return np.sum([f.sum(axis=0) for f in forces], axis=0) * flight.timing.control_period


def final_errors(flight: Flight) -> dict[str, np.ndarray]:
    """Mean error of each episode over its last fifth, each (N,), SI units."""
    return {name: _last_fifth(error).mean(axis=0) for name, error in flight.errors().items()}


def _last_fifth(instants: np.ndarray) -> np.ndarray:
    """The end of an array whose first axis is the T + 1 instants."""
    return instants[-max(1, (len(instants) - 1) // 5):]


def _samples(flight: Flight) -> Iterator[_Sample]:
    yield from _success(flight)
    yield from _accuracy(flight)
    yield from _motion_and_effort(flight)


def _success(flight: Flight) -> Iterator[_Sample]:
    means, settling = final_errors(flight), settling_times(flight)
    every = _last_fifth(reached(flight.task, flight.states, flight.goals)).all(axis=0)
    mean = np.all([means[name] < bound for name, bound in flight.task.tolerances().items()], axis=0)
    yield _Sample("solved", "within all tolerances at every step of the last fifth", "%", 100.0 * every)
    yield _Sample("solved, mean", "mean errors of the last fifth within tolerances", "%", 100.0 * mean)
    yield _Sample("settled", "enters all tolerances and stays", "%", 100.0 * np.isfinite(settling))
    yield _Sample("settling time", "median time to enter and stay", "s", settling, np.median)
    yield _Sample("failed", "declared failed by the task at any time", "%", 100.0 * flight.failed())


def _accuracy(flight: Flight) -> Iterator[_Sample]:
    means = final_errors(flight)
    for quantity, error in flight.errors().items():
        factor, unit = DISPLAY[quantity]
        after = factor * error[1:]
        for bound in _BOUNDS:
            meaning = f"time steps with {quantity} error < {bound} {unit}"
            share = 100.0 * (after < bound).mean(axis=0)
            yield _Sample(f"{_TIME_WITHIN[quantity]}{bound}", meaning, "%", share)
        for bound in (2, 1) if quantity == "position" else ():
            share = 100.0 * (after < bound).any(axis=0)
            yield _Sample(f"reach {bound} cm", f"ever closer than {bound} cm", "%", share)
        yield _Sample(f"{quantity} error", "mean over the last fifth", unit, factor * means[quantity])


def _motion_and_effort(flight: Flight) -> Iterator[_Sample]:
    after = map_leaves(lambda x: x[1:], flight.states)
    spin = np.linalg.norm(after.spin(), axis=0)
    rewards = np.sum(list(flight.rewards().values()), axis=(0, 1))
    yield _Sample("speed", "mean linear speed", "m/s", after.v.norm().mean(axis=0))
    yield _Sample("spin", "mean angular speed", "rad/s", spin.mean(axis=0))
    yield _Sample("duty", "mean share of thrusters open", "%", 100.0 * flight.commands.mean(axis=(0, 2)))
    yield _Sample("on-time", "thruster-seconds an episode", "s", on_times(flight))
    yield _Sample("impulse", "thrust spent an episode", "N s", impulses(flight))
    yield _Sample("return", "sum of rewards of the full episode", "", rewards)


def _metric(sample: _Sample, picks: np.ndarray) -> Metric:
    """Percentile bootstrap over episodes (Efron and Tibshirani, 1993, section 13.3).

    The interval has no width where all episodes agree; N of N successes then still leave about 3/N
    of failures possible at 95 % (rule of three).
    """
    values = np.asarray(sample.values)
    # "inverted_cdf" takes an order statistic: interpolating between two infinities gives NaN.
    low, high = np.quantile(sample.centre(values[picks], axis=1), (0.025, 0.975), method="inverted_cdf")
    value = float(sample.centre(values))
    return Metric(sample.name, sample.meaning, sample.unit, value, float(low), float(high))


def _jsonable(value: Any) -> Any:
    return str(value) if isinstance(value, float) and not math.isfinite(value) else value


def _text(value: float) -> str:
    return "never" if value == math.inf else f"{value:.3g}"
