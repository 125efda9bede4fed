"""What it costs to stay at the hold point for whole orbits: ``python -m campaigns.station_keeping``."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import tyro

from campaigns.command import ended
from rans.evaluation.measure.metrics import solved
from rans.flight import fly
from rans.model.spacecraft_file import load_spacecraft
from rans.optimal.control.lqr import LQR
from rans.optimal.control.mission_guidance import MissionGuidance
from rans.scenario import EVALUATION_SEED, scenarios
from rans.tasks import Hold
from rans.terminal import Terminal

_DAY = 86_400.0
_CONTROLLERS = {"mission": MissionGuidance, "lqr": LQR}


@dataclass(frozen=True)
class StationKeeping:
    """Fly hold with whole orbits in place of 600 s within the tolerances, and print the impulse of a day."""

    controller: Literal["mission", "lqr"] = "mission"
    """Who flies."""
    orbits: int = 1
    """Orbits within the tolerances."""
    episodes: int = 8
    """Number of starts."""

    def run(self) -> int:
        """Fly and print."""
        usual = Hold()
        seconds = self.orbits * 2.0 * math.pi / usual.mean_motion
        period = usual.timing.control_period
        task = replace(usual, hold_seconds=seconds).for_evaluation()
        # From the last arrival on, the time to hold, and a period.
        steps = usual.timing.episode_steps + math.ceil((seconds - usual.hold_seconds) / period) + 1
        timing = replace(usual.timing, episode_steps=steps)
        craft = load_spacecraft("vbar-chaser")
        controller = _CONTROLLERS[self.controller](craft, task, timing)
        starts = scenarios(task, craft, EVALUATION_SEED, self.episodes)
        flight = fly(craft, task, controller, starts, timing)
        won = solved(flight) & ~flight.violated()
        # A success ends a flight: what it spent in its last orbits.
        lengths = np.full(self.episodes, steps) if flight.lengths is None else flight.lengths
        forces = np.array([thruster.force for thruster in craft.thrusters])
        spent = flight.commands @ forces * period
        days = seconds / _DAY
        daily = np.array(
            [
                spent[max(0, end - round(seconds / period)) : end, row].sum() / days
                for row, end in enumerate(np.asarray(lengths, int))
            ]
        )
        Terminal().say(
            f"{self.controller}: {int(won.sum())} of {self.episodes} hold for {seconds:,.0f} s; "
            f"impulse of a day: median {np.median(daily[won]):,.0f} N s, {daily[won].min():,.0f} to "
            f"{daily[won].max():,.0f} N s; bound: 0 N s"
            if won.any()
            else f"{self.controller}: none of {self.episodes} holds for {seconds:,.0f} s"
        )
        return 0


if __name__ == "__main__":
    raise SystemExit(ended("station_keeping", lambda: tyro.cli(StationKeeping).run()))
