"""Passive safety and percentiles of guidance on an orbit: ``python -m campaigns passive-safety``."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from rans_missions.control.circumnavigation import Circumnavigation
from rans_missions.control.mission_guidance import MissionGuidance
from rans_missions.control.passive_approach import PassiveApproach
from rans_missions.passive_flights import passive_safety

from campaigns.parts import in_parts
from rans.evaluation.measure.metrics import PERCENTILES, impulses, settling_times, won
from rans.evaluation.measure.statistics import figure
from rans.files import number
from rans.flight import Controller, fly
from rans.model.spacecraft_file import load_spacecraft
from rans.scenario import EVALUATION_SEED, scenarios
from rans.tasks import TASKS

_PLANNED, _AT_ONCE = 64, 512
"""Numbers of starts that a process flies together, of guidance that plans start by start and of the others."""
CONTESTANTS: dict[str, tuple[str, Callable[..., Controller], int]] = {
    "hold, mission": ("hold", MissionGuidance, _AT_ONCE),
    "hold, passive": ("hold", PassiveApproach, _PLANNED),
    "dock, mission": ("dock", MissionGuidance, _AT_ONCE),
    "rendezvous, mission": ("rendezvous", MissionGuidance, _AT_ONCE),
    "inspect, circumnavigation": ("inspect", Circumnavigation, _PLANNED),
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
    """Fly all guidance from evaluation starts."""

    only: tuple[str, ...] = ()
    """Measure these rows alone, such as "hold, mission", and keep the others as they are in the evidence."""
    episodes: int = 1024
    """Number of starts of every row."""
    workers: int | None = None
    """Number of processes; None: one per processor."""
    seed: int = EVALUATION_SEED
    """Seed of the starts."""

    def measured(self) -> Iterator[dict[str, Any]]:
        """A row of every guidance."""
        together = {
            name: size
            for name, (_, _, size) in CONTESTANTS.items()
            if not self.only or name in self.only
        }
        for name, parts in in_parts(flights, together, self.episodes, self.workers, self.seed):
            yield {"who": name, **_row(CONTESTANTS[name][0], joined(parts))}


def _row(mission: str, flown: Flown) -> dict[str, Any]:
    """What the flights of one row are."""
    of_flights = {"arrival, s": flown.arrival, "impulse, N s": flown.impulse}
    quantiles = {
        name: [quantile(values, x / 100.0) for x in PERCENTILES]
        for name, values in of_flights.items()
    }
    for name, least in flown.margins.items():
        unit = "m/s" if name == "speed" else "m"
        quantiles[f"margin of {name}, {unit}"] = [
            quantile(least, 1.0 - x / 100.0) for x in PERCENTILES
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
    }


def flights(_: None, name: str, first: int, count: int, seed: int) -> Flown:
    """What so many starts of a row of the table are, from the first one on; a job of a worker."""
    mission, made = CONTESTANTS[name][:2]
    task = TASKS[mission]().for_evaluation()
    assert task.spacecraft is not None
    craft = load_spacecraft(task.spacecraft)
    starts = scenarios(task, craft, seed, count, first)
    flight = fly(craft, task, made(craft, task, task.timing), starts, task.timing)
    safety = passive_safety(flight)
    return Flown(
        won(flight),
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


def quantile(values: np.ndarray, part: float) -> float:
    """Quantile of one value per flight: the least value that so large a part of the flights do not exceed."""
    return float(np.quantile(values, part, method="inverted_cdf"))


def percentiles(evidence: Any) -> Iterator[dict[str, Any]]:
    """Rows of the table of percentiles."""
    for row in evidence["rows"]:
        for name, values in row["percentiles"].items():
            texts = [figure(number(x)) for x in values]
            yield {"who": row["who"], "quantity": name, "values": texts}


def zone(row: Any) -> str:
    """Cell of the radius of a row's zone, m, and until which distance it counts."""
    return f"{row['zone']:g}" + (f", until {row['approach']:g}" if row["approach"] else "")
