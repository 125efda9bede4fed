"""What a batch of flights is worth, in numbers with confidence intervals."""

from __future__ import annotations

import dataclasses
import itertools
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from rich.table import Table

from rans.evaluation.measure.metrics import Sample, samples
from rans.flight import Flight

RESAMPLES = 1000
"""Bootstrap resamples: the ends of a 95 % interval then rest on 25 resamples each."""

COLUMNS = ("metric", "value", "95 % interval", "meaning")
"""Headings of `Metrics.lines`."""
ROOM = 110
"""Columns of a terminal in which all of these stand without broken words."""


@dataclass(frozen=True)
class Metric:
    """One number about all episodes and its 95 % confidence interval."""

    group: str
    """Heading under which it belongs."""
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

    def lines(self) -> Iterator[tuple[str, tuple[str, str, str, str]]]:
        """Group and texts of `COLUMNS`, as tables show them.

        Metrics that differ in a bound only share a line; their interval is then the widest, as ±.
        """
        for (group, _, _), rows in itertools.groupby(self.rows, lambda r: (r.group, r.meaning, r.unit)):
            yield group, _line(tuple(rows))

    def table(self, width: int = ROOM) -> Table:
        """A table for a terminal of so many columns; a narrow one is not told what each metric means."""
        shown = COLUMNS if width >= ROOM else COLUMNS[:-1]
        table = Table(*shown, title=self.title(), title_justify="left", caption_justify="left")
        if len(shown) < len(COLUMNS):
            table.caption = f"A terminal of {ROOM} columns or more shows what each of them means."
        for column in table.columns[1:3]:
            column.no_wrap = True
        for group, lines in itertools.groupby(self.lines(), lambda line: line[0]):
            table.add_row(f"[bold]{group}[/]")
            for _, texts in lines:
                table.add_row(*texts[:len(shown)])
            table.add_section()
        return table


def measure(flight: Flight, seed: int = 0) -> Metrics:
    """Measure a batch of episodes.

    Args:
        flight: N episodes of any task.
        seed: of the bootstrap's generator; the same flight and seed give the same intervals.
    """
    steps, episodes, _ = flight.commands.shape
    picks = np.random.default_rng(seed).integers(0, episodes, (RESAMPLES, episodes))
    rows = tuple(_metric(sample, picks) for sample in samples(flight))
    return Metrics(flight.controller, flight.engine, flight.craft.name, episodes, steps,
                   flight.timing.control_period, rows)


def _metric(sample: Sample, picks: np.ndarray) -> Metric:
    """Percentile bootstrap over episodes (Efron and Tibshirani, 1993, section 13.3).

    The interval has no width where all episodes agree; N of N successes then still leave about 3/N
    of failures possible at 95 % (rule of three).
    """
    values = np.asarray(sample.values)
    # "inverted_cdf" takes an order statistic: interpolating between two infinities gives NaN.
    resampled = sample.centre(values[picks], axis=1)
    low, high = np.quantile(resampled, (0.025, 0.975), method="inverted_cdf")
    return Metric(sample.group, sample.name, sample.meaning, sample.unit,
                  float(sample.centre(values)), float(low), float(high))


def _line(rows: Sequence[Metric]) -> tuple[str, str, str, str]:
    first = rows[0]
    bounds = (re.sub(r"^\D*", "", row.name) for row in rows[1:])
    name = " / ".join((first.name, *bounds))
    unit = first.unit if math.isfinite(first.value) else ""
    value = f"{' / '.join(_text(row.value) for row in rows)} {unit}".strip()
    interval = f"{_text(first.low)} to {_text(first.high)}"
    if len(rows) > 1:
        widest = max(max(row.high - row.value, row.value - row.low) for row in rows)
        interval = f"up to ± {_text(widest)}"
    return name, value, interval, first.meaning


def _jsonable(value: Any) -> Any:
    return str(value) if isinstance(value, float) and not math.isfinite(value) else value


def _text(value: float) -> str:
    return "never" if value == math.inf else f"{value:.3g}"
