"""Metrics of a batch of flights, with confidence intervals."""

from __future__ import annotations

import dataclasses
import io
import itertools
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rans.base.display import NotebookRepr
from rans.base.errors import NoSuchKey, brief, counted, meant
from rans.base.files import number, replace_file
from rans.base.table import Table
from rans.episode.flight import Flight
from rans.evaluation.measure.metrics import Sample, samples
from rans.evaluation.measure.statistics import (
    Bootstrap,
    Estimate,
    figure,
    interval,
    quantity,
    share,
)
from rans.model.fields import leaves

COLUMNS = ("metric", "value", "95 % interval", "meaning")
"""Headings of `Metrics.lines`."""
ROOM = 110
"""Width of a terminal, in columns, in which all of these fit without broken words."""
_FIRST = ("solved", "settling time", "failed")
"""Metrics of a short table before the final errors; after them are the impulse and key metrics (`Sample.key`)."""
_STATES = {2: "x y heading v_x v_y w_z", 3: "x y z q_w q_x q_y q_z v_x v_y v_z w_x w_y w_z"}
"""Position in W (m), heading (rad) or attitude quaternion R_WB, velocity in W (m/s), spin in B (rad/s)."""


@dataclass(frozen=True)
class Metric:
    """One number about all episodes and its 95 % confidence interval."""

    group: str
    """Heading of its group in tables."""
    name: str
    meaning: str
    unit: str
    value: float
    """Mean over episodes, or their median if the meaning says so; infinite if the event of most never happens."""
    low: float
    high: float
    key: bool = False
    """Whether short tables have it, besides those that all tasks have there."""

    def __repr__(self) -> str:
        return f"{self.name} {quantity(self.value, self.unit)}"


@dataclass(frozen=True)
class Metrics(NotebookRepr, Mapping[str, Metric]):
    """All metrics of a batch of flights, by their names."""

    controller: str
    engine: str
    spacecraft: str
    episodes: int
    steps: int
    control_period: float
    """Control period, s."""
    rows: tuple[Metric, ...]

    def __repr__(self) -> str:
        return f"<{self.title()}: {', '.join(map(repr, self.rows))}>"

    def __getitem__(self, name: str) -> Metric:
        metrics = {row.name: row for row in self.rows}
        if name not in metrics:
            raise NoSuchKey(
                f"there is no metric {brief(name)}{meant(str(name), metrics)}; there are {', '.join(metrics)}."
            )
        return metrics[name]

    def __iter__(self) -> Iterator[str]:
        return (row.name for row in self.rows)

    def __len__(self) -> int:
        return len(self.rows)

    def to_json(self) -> dict[str, Any]:
        """Data for `rans.base.files.write_json`."""
        return dataclasses.asdict(self)

    @classmethod
    def from_json(cls, table: dict[str, Any]) -> Metrics:
        """Metrics from the result of `to_json`."""
        rows = [
            Metric(**(row | {k: number(row[k]) for k in ("value", "low", "high")}))
            for row in table["rows"]
        ]
        return cls(**(table | {"rows": tuple(rows)}))

    def title(self) -> str:
        """Title in one line: controller, spacecraft, engine and episodes."""
        duration = self.steps * self.control_period
        return (
            f"{self.controller}: {counted(self.episodes, 'episode')} of {duration:g} s with "
            f"{self.spacecraft} ({self.engine} engine)"
        )

    def lines(self) -> Iterator[tuple[str, tuple[str, str, str, str]]]:
        """Group and cells of each line of a table, in the order of `COLUMNS`.

        Metrics that differ in a bound only share a line, whose interval is the widest of theirs, as ±.
        """
        for (group, _, _), rows in itertools.groupby(
            self.rows, lambda r: (r.group, r.meaning, r.unit)
        ):
            yield group, _line(tuple(rows))

    def key_lines(self) -> list[tuple[str, tuple[str, str, str, str]]]:
        """Lines of a short table, as `lines` has them: success, time, errors, impulse and percentiles.

        Names are those of the rows, which files and pages use.
        """
        lines = list(self.lines())
        order = [
            *(name for name in _FIRST),
            *(texts[0] for _, texts in lines if texts[0].endswith(" error")),
            "impulse",
            *(row.name for row in self.rows if row.key),
            *(texts[0] for group, texts in lines if group == "percentiles"),
        ]
        by_name = {texts[0]: (group, texts) for group, texts in lines}
        return [by_name[name] for name in order if name in by_name]

    def table(self, width: int = ROOM, full: bool = True) -> Table:
        """Table for a terminal of ``width`` characters, of all lines or of the `key_lines`.

        A narrow table has no column of meanings.
        """
        columns = COLUMNS if width >= ROOM else COLUMNS[:-1]
        if not full:
            rows = [texts[: len(columns)] for _, texts in self.key_lines()]
            return Table(columns, rows, self.title(), whole=COLUMNS[1:3])
        groups: dict[str, list[tuple[str, ...]]] = {}
        for group, texts in self.lines():
            groups.setdefault(group, []).append(texts[: len(columns)])
        rows = [row for group, lines in groups.items() for row in ((group,), *lines)]
        hint = f"A terminal of {ROOM} columns or more shows what each of them means."
        note = "" if width >= ROOM else hint
        return Table(columns, rows, self.title(), note, whole=COLUMNS[1:3])


def estimated(sample: Sample, bootstrap: Bootstrap) -> Estimate:
    """A metric over all episodes with its 95 % interval, see `measure`."""
    if sample.values.dtype == bool:
        return share(sample.values).scaled(100.0)
    return bootstrap.of(sample.centre, sample.values)


def measure(flight: Flight, own: Iterable[Sample] | None = None) -> Metrics:
    """Measure a batch of episodes of any task, by all metrics or by its own; equal flights have equal intervals.

    Intervals of shares are Wilson's, which have a width even if all succeed; others are those of a `Bootstrap`.
    """
    steps, episodes, _ = flight.commands.shape
    bootstrap = Bootstrap(episodes)
    rows = [
        Metric(*sample[:4], *dataclasses.astuple(estimated(sample, bootstrap)), key=sample.key)
        for sample in (samples(flight) if own is None else own)
    ]
    return Metrics(
        flight.controller,
        flight.engine,
        flight.craft.name,
        episodes,
        steps,
        flight.timing.control_period,
        tuple(rows),
    )


def _line(rows: Sequence[Metric]) -> tuple[str, str, str, str]:
    """Name, value, interval and meaning of metrics that share a line of the table, such as percentiles."""
    first = rows[0]
    name = " / ".join((first.name, *(re.sub(r"^\D*", "", row.name) for row in rows[1:])))
    unit = first.unit if math.isfinite(first.value) else ""
    value = f"{' / '.join(figure(row.value) for row in rows)} {unit}".strip()
    limits = interval(first.low, first.high)
    if len(rows) > 1:
        # Times that never come have an interval without width: inf - inf is no number.
        if all(row.low == math.inf for row in rows):
            limits = figure(math.inf)
        elif any(row.low < row.high == math.inf for row in rows):
            limits = f"up to {figure(math.inf)}"
        else:
            finite = [row for row in rows if row.low != math.inf]
            widest = max(max(row.high - row.value, row.value - row.low) for row in finite)
            limits = f"up to ± {figure(widest)}"
    return name, value, limits, first.meaning


def save_episodes(flight: Flight, file: Path, trajectories: bool = False) -> None:
    """Write the results of each of N episodes into an ``.npz`` file, float32.

    - one array (N,) per metric, in its unit, named as in the tables with "_" for spaces: ``PT5``,
      ``reach_2_cm``, ``settling_time`` (infinite if never), ``position_error``, ...
    - ``start`` and ``goal`` (N, k), and ``columns`` (k,), the names of their columns;
    - with trajectories: ``times`` (T + 1,) s, ``states`` (T + 1, N, k) and ``commands`` (T, N, commands).

    Raises:
        ConfigError: the file cannot be written.
    """
    # Percentiles have the values of other metrics.
    arrays: dict[str, Any] = {
        s.name.replace(" ", "_"): s.numbers for s in samples(flight) if s.group != "percentiles"
    }
    states = np.stack(leaves(flight.states), axis=-1)
    arrays |= {"start": states[0], "goal": np.stack(leaves(flight.goals), axis=-1)}
    if trajectories:
        arrays |= {"times": flight.times, "states": states, "commands": flight.commands}
    packed = {key: np.asarray(value, dtype=np.float32) for key, value in arrays.items()}
    names = [store.name.replace(" ", "_") for store in flight.craft.stores]
    columns = np.array([*_STATES[flight.craft.dimension].split(), *names])
    save_arrays(file, packed | {"columns": columns})


def save_arrays(file: Path, arrays: dict[str, Any]) -> None:
    """Write arrays into a file for `numpy.load`.

    Raises:
        ConfigError: the file cannot be written.
    """
    content = io.BytesIO()
    np.savez_compressed(content, **arrays)
    replace_file(file, lambda draft: draft.write_bytes(content.getvalue()))
