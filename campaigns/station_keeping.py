"""What it costs to stay at the hold point for whole orbits: ``python -m campaigns station-keeping``."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from rans_missions.control.mission_guidance import MissionGuidance
from rans_missions.tasks import Hold, TargetOrbit

from campaigns.error_sources import SIZES, sources
from rans.evaluation.measure.metrics import solved
from rans.flight import fly
from rans.model.spacecraft_file import load_spacecraft
from rans.optimal.control.lqr import LQR
from rans.scenario import EVALUATION_SEED, draws, scenarios

_DAY = 86_400.0


@dataclass(frozen=True)
class StationKeeping:
    """Fly hold with whole orbits in place of 600 s within the tolerances, for the impulse of a day.

    Without errors the bound is zero.
    """

    controller: Literal["mission", "lqr"] = "mission"
    """Who flies."""
    orbits: int = 3
    """Orbits within the tolerances, of which the first has the arrival."""
    episodes: int = 64
    """Number of starts."""
    error: Literal[
        "none",
        "navigation noise",
        "navigation bias",
        "thrust error",
        "command delay",
        "mass",
        "constant force",
        "all",
    ] = "none"
    """Error of sensors, thrusters or craft, a row of docs/missions/errors.md; mission guidance expects it."""
    orbit: TargetOrbit = field(default_factory=TargetOrbit)
    """Orbit of the target, which mission guidance knows; by default a circle."""

    def measured(self) -> Iterator[dict[str, Any]]:
        """What the first and the last orbit cost those that hold."""
        usual = Hold(orbit=self.orbit)
        orbit = 2.0 * math.pi / usual.mean_motion
        seconds = self.orbits * orbit
        period = usual.timing.control_period
        task = replace(usual, hold_seconds=seconds).for_evaluation()
        # From the last arrival on, the time to hold, and a period.
        steps = usual.timing.episode_steps + math.ceil((seconds - usual.hold_seconds) / period) + 1
        timing = replace(usual.timing, episode_steps=steps)
        craft = load_spacecraft("vbar-chaser")
        conditions = sources(SIZES["hold"])[self.error]
        controller = (
            MissionGuidance(craft, task, timing, conditions)
            if self.controller == "mission"
            else LQR(craft, task, timing)
        )
        starts = scenarios(task, craft, EVALUATION_SEED, self.episodes)
        varied = conditions.or_none
        luck = draws(EVALUATION_SEED, self.episodes) if varied else None
        flight = fly(craft, task, controller, starts, timing, conditions=varied, draws=luck)
        won = solved(flight) & ~flight.violated()
        if not won.any():
            return
        # A success ends a flight: what it spent in its first and in its last orbit within the tolerances.
        lengths = np.full(self.episodes, steps) if flight.lengths is None else flight.lengths
        forces = np.array([thruster.force for thruster in craft.thrusters])
        spent = flight.commands @ forces * period
        for name, before in (("first", seconds), ("last", orbit)):
            orbital = np.array(
                [
                    spent[max(0, int(end) - round(before / period)) :][
                        : round(orbit / period), row
                    ].sum()
                    for row, end in enumerate(lengths)
                ]
            )[won]
            median = float(np.median(orbital))
            yield {
                "who": self.controller,
                "hold": f"{int(won.sum())} of {self.episodes}",
                "seconds": seconds,
                "orbit": name,
                "median": median,
                "least": float(orbital.min()),
                "largest": float(orbital.max()),
                "day": median * _DAY / orbit,
            }
