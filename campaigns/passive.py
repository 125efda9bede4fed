"""Passive safety and percentiles of guidance on an orbit: ``python -m campaigns.passive``.

With ``--docs docs`` the command writes docs/validation/passive-safety.json and both tables of
docs/missions/passive_safety.md.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tyro

from campaigns import standings
from campaigns.command import ended
from campaigns.markdown import Table
from rans.evaluation.measure.metrics import PERCENTILES, impulses, settling_times, solved
from rans.evaluation.measure.passive import passive_safety
from rans.evaluation.measure.statistics import figure
from rans.files import environment, number, read_json, write_json
from rans.flight import Controller, fly
from rans.model.spacecraft_file import load_spacecraft
from rans.optimal.control.circumnavigation import Circumnavigation
from rans.optimal.control.mission_guidance import MissionGuidance
from rans.optimal.control.passive_approach import PassiveApproach
from rans.optimal.control.passive_entry import PassiveEntry
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


CONTESTANTS: dict[str, tuple[str, Callable[..., Controller], int]] = {
    "hold, mission": ("hold", MissionGuidance, 128),
    "hold, passive": ("hold", PassiveApproach, 32),
    "dock, mission": ("dock", MissionGuidance, 128),
    "dock, passive-entry": ("dock", PassiveEntry, 128),
    "rendezvous, mission": ("rendezvous", MissionGuidance, 64),
    "rendezvous, passive-entry": ("rendezvous", PassiveEntry, 64),
    "inspect, circumnavigation": ("inspect", Circumnavigation, 16),
    "inspect, circumnavigation, safe coasts": ("inspect", _safe_circumnavigation, 16),
}
"""Missions, what makes their guidance of craft, task and timing, and numbers of starts, by the names of rows."""


@dataclass(frozen=True)
class Passive:
    """Fly all guidance from evaluation starts, and print both tables."""

    only: str = ""
    """Measure one row alone, such as "hold, mission", and keep the others as they are in the evidence."""
    starts: int = 128
    """Largest number of starts of a row; each has a smaller number of its own."""
    seed: int = EVALUATION_SEED
    """Seed of the starts."""
    docs: Path | None = None
    """Folder of the documents whose tables and evidence are written; None: they are not."""

    def run(self) -> int:
        """Fly, print and write."""
        file = None if self.docs is None else self.docs / "validation" / _FILE
        before = read_json(file)["rows"] if self.only and file and file.exists() else []
        known = {row["who"]: row for row in before}
        for name, (mission, made, count) in CONTESTANTS.items():
            if self.only in ("", name):
                known[name] = {"who": name, **self._row(mission, made, min(count, self.starts))}
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

    def _row(self, mission: str, made: Callable[..., Controller], count: int) -> dict[str, Any]:
        """What the flights of one mission are."""
        task = TASKS[mission]().for_evaluation()
        assert task.spacecraft is not None
        craft = load_spacecraft(task.spacecraft)
        starts = scenarios(task, craft, self.seed, count)
        flight = fly(craft, task, made(craft, task, task.timing), starts, task.timing)
        safety = passive_safety(flight)
        spent = impulses(flight)
        of_flights = {"arrival, s": settling_times(flight), "impulse, N s": spent}
        quantiles = {
            name: [_quantile(values, x / 100.0) for x in PERCENTILES]
            for name, values in of_flights.items()
        }
        for name, margins in flight.margins.items():
            unit = "m/s" if name == "speed" else "m"
            least = margins.min(axis=0)
            quantiles[f"margin of {name}, {unit}"] = [
                _quantile(least, 1.0 - x / 100.0) for x in PERCENTILES
            ]
        return {
            "starts": count,
            "won": float((solved(flight) & ~flight.violated()).mean()),
            "unsafe": float(safety.unsafe.mean()),
            "unsafe_start": float(safety.unsafe_start.mean()),
            "zone": safety.zone.radius,
            "approach": safety.zone.approach,
            "least": float(safety.distance.min()),
            "impulse": float(spent.mean()),
            "percentiles": quantiles,
        }


def _quantile(values: np.ndarray, part: float) -> float:
    """Quantile of one value per flight: the least value that so large a part of the flights do not exceed."""
    return float(np.quantile(values, part, method="inverted_cdf"))


def _cells(row: dict[str, Any]) -> list[str]:
    zone = f"{row['zone']:g}" + (f", until {row['approach']:g}" if row["approach"] else "")
    return [
        row["who"],
        f"{row['starts']}",
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
        f"The values are in [{_FILE}](../validation/{_FILE}).",
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
    raise SystemExit(ended("passive", lambda: tyro.cli(Passive).run()))
