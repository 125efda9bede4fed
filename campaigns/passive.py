"""Passive safety and percentiles of guidance on an orbit: ``python -m campaigns.passive``.

With ``--docs docs`` the command writes docs/validation/passive-safety.json and both tables of
docs/missions/passive_safety.md.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import tyro
from rans_missions.control.circumnavigation import Circumnavigation
from rans_missions.control.mission_guidance import MissionGuidance
from rans_missions.control.passive_approach import PassiveApproach
from rans_missions.control.passive_entry import PassiveEntry
from rans_missions.passive_flights import passive_safety

from campaigns import standings
from campaigns.command import ended
from campaigns.markdown import Table
from rans.evaluation.measure.metrics import PERCENTILES, impulses, settling_times, solved
from rans.evaluation.measure.statistics import figure
from rans.files import environment, number, read_json, write_json
from rans.flight import Controller, fly
from rans.model.spacecraft_file import load_spacecraft
from rans.processes import Workers
from rans.scenario import EVALUATION_SEED, scenarios
from rans.tasks import TASKS
from rans.terminal import Terminal

_FILE = "passive-safety.json"
_PAGE = "missions/passive_safety.md"
_HEADINGS = (
    "guidance",
    "starts",
    "won, %",
    "unsafe flights, %",
    "unsafe starts, %",
    "zone, m",
    "least coast distance, m",
    "impulse, N s",
)
_PERCENTILE_HEADINGS = ("guidance", "quantity", *(f"{x:g} %" for x in PERCENTILES))


def _safe_circumnavigation(*flown: Any) -> Controller:
    return Circumnavigation(*flown, safe_coasts=True)


_LISTED = 32
"""Largest number of lost or unsafe starts that the evidence names."""
_PLANNED, _AT_ONCE = 64, 512
"""Numbers of starts that a process flies together, of guidance that plans start by start and of the others."""
CONTESTANTS: dict[str, tuple[str, Callable[..., Controller], int]] = {
    "hold, mission": ("hold", MissionGuidance, _AT_ONCE),
    "hold, passive": ("hold", PassiveApproach, _PLANNED),
    "dock, mission": ("dock", MissionGuidance, _AT_ONCE),
    "dock, passive-entry": ("dock", PassiveEntry, _PLANNED),
    "rendezvous, mission": ("rendezvous", MissionGuidance, _AT_ONCE),
    "rendezvous, passive-entry": ("rendezvous", PassiveEntry, _PLANNED),
    "inspect, circumnavigation": ("inspect", Circumnavigation, _PLANNED),
    "inspect, circumnavigation, safe coasts": ("inspect", _safe_circumnavigation, _PLANNED),
}
"""Missions, what makes their guidance of craft, task and timing, and starts of a job, by the names of rows."""


class Flown(NamedTuple):
    """What N flights were: arrays (N,), of margins for each constraint."""

    won: np.ndarray
    arrival: np.ndarray
    """Time of success, s; infinite: never."""
    impulse: np.ndarray
    """N s"""
    distance: np.ndarray
    """Least distance of coasts from the target, m."""
    unsafe: np.ndarray
    unsafe_start: np.ndarray
    margins: dict[str, np.ndarray]
    """Least margin of each constraint, SI units."""


@dataclass(frozen=True)
class Passive:
    """Fly all guidance from evaluation starts, and print both tables."""

    only: tuple[str, ...] = ()
    """Measure these rows alone, such as "hold, mission", and keep the others as they are in the evidence."""
    episodes: int = 1024
    """Number of starts of every row."""
    again: bool = False
    """Fly only the starts that the evidence of these rows names as lost or unsafe, and print them."""
    workers: int | None = None
    """Number of processes; None: one per processor."""
    seed: int = EVALUATION_SEED
    """Seed of the starts."""
    docs: Path | None = None
    """Folder of the documents whose tables and evidence are written; None: they are not."""

    def run(self) -> int:
        """Fly, print and write."""
        file = None if self.docs is None else self.docs / "validation" / _FILE
        before = read_json(file)["rows"] if self.only and file and file.exists() else []
        known = {row["who"]: row for row in before}
        if self.again:
            self._fly_again(known)
            return 0
        # The jobs of all rows together, so that no processor waits.
        jobs = [
            (name, self.seed, first, min(size, self.episodes - first))
            for name, (_, _, size) in CONTESTANTS.items()
            if not self.only or name in self.only
            for first in range(0, self.episodes, size)
        ]
        parts = Workers(int, (), self.workers, "flew starts").ordered(flights, jobs)
        of_rows: dict[str, list[Flown]] = {}
        for (name, *_), part in zip(jobs, parts, strict=True):
            of_rows.setdefault(name, []).append(part)
        for name, flown in of_rows.items():
            known[name] = {"who": name, **_row(CONTESTANTS[name][0], joined(flown))}
        rows = [known[name] for name in CONTESTANTS if name in known]
        evidence = {"seed": self.seed, "environment": environment(), "rows": rows}
        Terminal().show("Passive safety", _HEADINGS, [_cells(row) for row in rows])
        percentiles = [cells for row in rows for cells in _percentile_cells(row)]
        Terminal().show("Percentiles", _PERCENTILE_HEADINGS, percentiles)
        if self.docs is not None and file is not None:
            write_json(file, evidence)
            in_document(self.docs).write(self.docs)
            percentiles_in_document(self.docs).write(self.docs)
            for mission in standings.MISSIONS:
                standings.in_document(self.docs, mission).write(self.docs)
        return 0

    def _fly_again(self, known: dict[str, dict[str, Any]]) -> None:
        """Print a line of each start that was lost or unsafe."""
        jobs = [
            (name, self.seed, start, 1)
            for name in self.only
            for start in sorted({*known[name]["lost"], *known[name]["entered"]})
        ]
        parts = Workers(int, (), self.workers, "flew starts").ordered(flights, jobs)
        for (name, _, start, _), part in zip(jobs, parts, strict=True):
            Terminal().say(
                f"{name}, start {start}: {'won' if part.won[0] else 'lost'} at {part.arrival[0]:,.0f} s, "
                f"{'unsafe' if part.unsafe[0] else 'safe'}, coasts {part.distance[0]:.2f} m away, "
                f"{part.impulse[0]:.3g} N s"
            )


def _row(mission: str, flown: Flown) -> dict[str, Any]:
    """What the flights of one row are."""
    of_flights = {"arrival, s": flown.arrival, "impulse, N s": flown.impulse}
    quantiles = {
        name: [_quantile(values, x / 100.0) for x in PERCENTILES]
        for name, values in of_flights.items()
    }
    for name, least in flown.margins.items():
        unit = "m/s" if name == "speed" else "m"
        quantiles[f"margin of {name}, {unit}"] = [
            _quantile(least, 1.0 - x / 100.0) for x in PERCENTILES
        ]
    zone = TASKS[mission]().for_evaluation().coast_zone
    assert zone is not None
    return {
        "starts": len(flown.won),
        "won": float(flown.won.mean()),
        "unsafe": float(flown.unsafe.mean()),
        "unsafe_start": float(flown.unsafe_start.mean()),
        "zone": zone.radius,
        "approach": zone.approach,
        "least": float(flown.distance.min()),
        "impulse": float(flown.impulse.mean()),
        "percentiles": quantiles,
        # Numbers of the first starts, to fly them alone.
        "lost": [int(k) for k in np.flatnonzero(~flown.won)[:_LISTED]],
        "entered": [int(k) for k in np.flatnonzero(flown.unsafe)[:_LISTED]],
    }


def flights(_: int, name: str, seed: int, first: int, count: int) -> Flown:
    """What so many starts of a row of the table are, from the first one on; a job of a worker."""
    mission, made, _ = CONTESTANTS[name]
    task = TASKS[mission]().for_evaluation()
    assert task.spacecraft is not None
    craft = load_spacecraft(task.spacecraft)
    starts = scenarios(task, craft, seed, count, first)
    flight = fly(craft, task, made(craft, task, task.timing), starts, task.timing)
    safety = passive_safety(flight)
    return Flown(
        solved(flight) & ~flight.violated(),
        settling_times(flight),
        impulses(flight),
        safety.distance,
        safety.unsafe,
        safety.unsafe_start,
        {name: margins.min(axis=0) for name, margins in flight.margins.items()},
    )


def joined(parts: list[Flown]) -> Flown:
    """Flights of several jobs, one after the other."""
    *arrays, margins = zip(*parts, strict=True)
    together = {name: np.concatenate([part[name] for part in margins]) for name in margins[0]}
    return Flown._make([*map(np.concatenate, arrays), together])


def _quantile(values: np.ndarray, part: float) -> float:
    """Quantile of one value per flight: the least value that so large a part of the flights do not exceed."""
    return float(np.quantile(values, part, method="inverted_cdf"))


def _cells(row: dict[str, Any]) -> list[str]:
    zone = f"{row['zone']:g}" + (f", until {row['approach']:g}" if row["approach"] else "")
    return [
        row["who"],
        f"{row['starts']:,}",
        f"{100.0 * row['won']:.1f}",
        f"{100.0 * row['unsafe']:.1f}",
        f"{100.0 * row['unsafe_start']:.1f}",
        zone,
        f"{row['least']:.1f}",
        f"{row['impulse']:.3g}",
    ]


def _percentile_cells(row: dict[str, Any]) -> list[list[str]]:
    return [
        [row["who"], name, *(figure(number(x)) for x in values)]
        for name, values in row["percentiles"].items()
    ]


def in_document(docs: Path) -> Table:
    """The table of passive safety."""
    rows = read_json(docs / "validation" / _FILE)["rows"]
    return Table(
        _PAGE,
        "python -m campaigns.passive --docs docs",
        _HEADINGS,
        [_cells(row) for row in rows],
        f"The values are in [{_FILE}](../../../docs/validation/{_FILE}).",
    )


def percentiles_in_document(docs: Path) -> Table:
    """The table of percentiles."""
    rows = read_json(docs / "validation" / _FILE)["rows"]
    return Table(
        _PAGE,
        "python -m campaigns.passive --docs docs, percentiles",
        _PERCENTILE_HEADINGS,
        [cells for row in rows for cells in _percentile_cells(row)],
        "",
    )


if __name__ == "__main__":
    # Jobs of other processes are in the module of its own name.
    from campaigns import passive

    raise SystemExit(ended("passive", lambda: tyro.cli(passive.Passive).run()))
