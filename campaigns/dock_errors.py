"""How mission guidance docks with errors of sensors and thrusters: ``python -m campaigns dock-with-errors``.

All flights begin at the same held-out starts. The lower bounds of the first of them are those of a perfect world.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from rans_missions.bounds.transfers import transfer_bounds
from rans_missions.control.mission_guidance import MissionGuidance
from rans_missions.tasks import Dock

from campaigns.missions import row_of
from rans.evaluation.measure.metrics import impulses
from rans.flight import fly
from rans.model.actuators import Pulsed
from rans.model.spacecraft_file import load_spacecraft
from rans.randomization.conditions import (
    Conditions,
    SensorConditions,
    SensorsConditions,
    ThrusterConditions,
)
from rans.scenario import EVALUATION_SEED, draws, scenarios

_DEADLINES = (1000.0,)
"""s"""
_NOISE = SensorsConditions(
    position=SensorConditions(noise=0.05), velocity=SensorConditions(noise=0.001)
)
_LATE = ThrusterConditions(command_delay=(0.0, 1.0))
_INEXACT = ThrusterConditions(thrust=(0.95, 1.05))
_ALL = Conditions(thrusters=replace(_LATE, thrust=_INEXACT.thrust), sensors=_NOISE)
_PULSED = Pulsed(counts=100)
"""Pulses of whole tenths of a second in a control period of 10 s."""
_WORLDS = {
    "perfect": (Conditions(), None),
    "command delay 0 to 1 s": (Conditions(thrusters=_LATE), None),
    "thrust 0.95 to 1.05": (Conditions(thrusters=_INEXACT), None),
    "noise 5 cm, 1 mm/s": (Conditions(sensors=_NOISE), None),
    "delay, thrust and noise": (_ALL, None),
    "pulses of 0.1 s": (Conditions(), _PULSED),
    "pulses, delay, thrust and noise": (_ALL, _PULSED),
}
"""Conditions and valves by what the table calls them; valves None: throttles."""


@dataclass(frozen=True)
class DockErrors:
    """Fly every world."""

    episodes: int = 1024
    """Held-out starts."""
    bounded: int = 32
    """The first of them, whose bounds are found."""
    seed: int = EVALUATION_SEED
    """Of the starts and of the errors."""

    def measured(self) -> Iterator[dict[str, Any]]:
        """A row of each world."""
        craft = load_spacecraft("afrl-deputy")
        for deadline in _DEADLINES:
            task = Dock(deadline=(deadline, deadline)).for_evaluation()
            assert isinstance(task, Dock)
            starts = scenarios(task, craft, self.seed, self.episodes)
            few = scenarios(task, craft, self.seed, self.bounded)
            lower = np.full(self.episodes, np.nan)
            lower[: self.bounded] = [
                answer.lower for answer in transfer_bounds(craft, task, few, deadline)
            ]
            for name, (conditions, valves) in _WORLDS.items():
                flown = craft if valves is None else replace(craft, actuators=valves)
                guidance = MissionGuidance(flown, task, task.timing, conditions)
                drawn = draws(self.seed, self.episodes)
                flight = fly(
                    flown,
                    task,
                    guidance,
                    starts,
                    task.timing,
                    conditions=conditions.or_none,
                    draws=drawn if conditions.or_none else None,
                )
                yield row_of(f"{deadline:,.0f} s", name, flight, impulses(flight), lower)
