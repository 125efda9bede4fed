"""What each error of a spacecraft costs a mission: ``python -m campaigns error-sources``.

Guidance flies the same evaluation starts without errors, with each error alone and with all of them. Percentiles of
arrival, impulse and margin stand beside each other, and what each error adds.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from rans_missions.control.mission_guidance import MissionGuidance
from rans_missions.tasks import Dock

from campaigns.missions import least, of_first, row_of
from campaigns.parts import in_parts
from rans.base.files import number
from rans.episode.flight import fly
from rans.episode.scenario import EVALUATION_SEED, draws, scenarios
from rans.episode.step import Setup
from rans.evaluation.measure.metrics import PERCENTILES, impulses, settling_times, won
from rans.evaluation.measure.statistics import figure as rounded
from rans.model.actuators import Pulsed
from rans.model.spacecraft_file import load_spacecraft
from rans.randomization.conditions import (
    BodyConditions,
    Conditions,
    DisturbanceConditions,
    SensorConditions,
    SensorsConditions,
    ThrusterConditions,
)
from rans.tasks import TASKS

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
    """Fly all errors of all missions."""

    only: str = ""
    """Measure one mission alone, and keep the others as they are in the evidence."""
    episodes: int = 512
    """Number of starts of each row."""
    workers: int | None = None
    """Number of processes; None: one per processor."""
    seed: int = EVALUATION_SEED
    """Seed of starts and errors."""

    def measured(self) -> dict[str, Any]:
        """Rows of missions and errors."""
        return {"rows": [x for one in SIZES if self.only in ("", one) for x in self._mission(one)]}

    def _mission(self, mission: str) -> Iterator[dict[str, Any]]:
        """The rows of one mission, by error."""
        together = dict.fromkeys(sources(SIZES[mission]), _JOB)
        for name, parts in in_parts(
            flown, together, self.episodes, self.workers, self.seed, mission
        ):
            found = _row(*map(np.concatenate, zip(*parts, strict=True)))
            yield {"mission": mission, "error": name, **found}


def worlds() -> dict[str, tuple[Conditions, Pulsed | None]]:
    """Conditions and valves of docking, by what its page calls them; valves None: throttles."""
    of_dock = sources(SIZES["dock"])
    late, inexact, noise = (
        of_dock[name] for name in ("command delay", "thrust error", "navigation noise")
    )
    three = replace(noise, thrusters=replace(late.thrusters, thrust=inexact.thrusters.thrust))
    # Pulses of whole tenths of a second in a control period of 10 s.
    pulsed = Pulsed(counts=100)
    return {
        "perfect": (of_dock[_NONE], None),
        "command delay 0 to 1 s": (late, None),
        "thrust 0.95 to 1.05": (inexact, None),
        "noise 5 cm, 1 mm/s": (noise, None),
        "delay, thrust and noise": (three, None),
        "pulses of 0.1 s": (of_dock[_NONE], pulsed),
        "pulses, delay, thrust and noise": (three, pulsed),
    }


@dataclass(frozen=True)
class DockErrors:
    """Dock by 1,000 s with errors of sensors and thrusters, beside the bounds of a perfect world."""

    episodes: int = 1024
    """Held-out starts, the same for every world."""
    bounded: int = 32
    """The first of them, whose bounds are found."""
    seed: int = EVALUATION_SEED
    """Seed of the starts and of the errors."""

    def measured(self) -> Iterator[dict[str, Any]]:
        """A row of each world."""
        craft = load_spacecraft("afrl-deputy")
        deadline = 1000.0
        task: Any = Dock(deadline=(deadline, deadline)).for_evaluation()
        starts = scenarios(task, craft, self.seed, self.episodes)
        bounds = least(Setup(craft, task, task.timing), self.seed, self.bounded)
        lower = of_first(bounds, self.episodes)
        for name, (conditions, valves) in worlds().items():
            own = craft if valves is None else replace(craft, actuators=valves)
            flight = fly(
                own,
                task,
                MissionGuidance(own, task, task.timing, conditions),
                starts,
                task.timing,
                conditions=conditions.or_none,
                draws=draws(self.seed, self.episodes) if conditions.or_none else None,
            )
            yield row_of(f"{deadline:,.0f} s", name, flight, impulses(flight), lower)


def flown(_: None, name: str, first: int, count: int, seed: int, mission: str) -> tuple[Any, ...]:
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
    (margins,) = flight.margins.values()
    return (
        won(flight),
        flight.violated(),
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
        "arrival": [quantile(arrival, x / 100.0) for x in PERCENTILES],
        "impulse": [quantile(impulse, x / 100.0) for x in PERCENTILES],
        # The lower end: 99 % keep a margin that 1 % fall below.
        "margin": [quantile(least, 1.0 - x / 100.0) for x in PERCENTILES],
        "mean impulse": float(impulse.mean()),
    }


def quantile(values: np.ndarray, part: float) -> float:
    """Quantile of one value per flight: the least value that so large a part of the flights do not exceed."""
    return float(np.quantile(values, part, method="inverted_cdf"))


def of_mission(evidence: Any, mission: str) -> Iterator[dict[str, Any]]:
    """Rows of a mission, with the first and the last of `PERCENTILES` as text."""
    for row in evidence["rows"]:
        if row["mission"] == mission:
            quantiles = {
                what: " / ".join(rounded(number(x)) for x in (row[what][0], row[what][-1]))
                for what in ("arrival", "impulse", "margin")
            }
            yield {**row, **quantiles}
