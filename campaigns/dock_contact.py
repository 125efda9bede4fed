"""Docking with contact in Drake, beside the mission's own verdict: ``python -m campaigns docking-with-contact``.

The agents of dock-port that come with RANS fly held-out starts twice in Drake: with bodies that touch nothing, and
with a probe, a plate and latches (`rans_missions.contact`).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from rans_missions.contact import CaptureSystem, Docking, fly_to_contact
from rans_missions.tasks import DockPort

from rans.episode import Setup
from rans.evaluation.fly.contestants import contestant
from rans.evaluation.measure.metrics import won
from rans.model.fields import map_leaves
from rans.reference.flight import fly_in_drake
from rans.scenario import EVALUATION_SEED, scenarios

_AGENTS = ("dock-port-2d", "dock-port-2d-atmos", "dock-port-3d")
_RATES = {"at rest": 0.0, "3 deg/s": math.radians(3.0)}
"""Rates of the port, rad/s."""


@dataclass(frozen=True)
class DockContact:
    """Fly every agent at every rate."""

    episodes: int = 64
    """Held-out starts."""
    seed: int = EVALUATION_SEED
    """Seed of the starts."""

    def measured(self) -> dict[str, Any]:
        """A row of each agent and rate of the port, and the capture system."""
        return {"system": asdict(CaptureSystem()), "rows": [*self._rows()]}

    def _rows(self) -> Iterator[dict[str, Any]]:
        for name in _AGENTS:
            run = contestant(f"pretrained:{name}")
            for port, rate in _RATES.items():
                assert isinstance(run.task, DockPort)
                task = replace(run.task, port_rate=(rate, rate)).for_evaluation()
                starts = scenarios(task, run.craft, self.seed, self.episodes)
                free = fly_in_drake(run.craft, task, run.controller, starts, run.timing)
                dockings = [
                    fly_to_contact(
                        Setup(run.craft, task, run.timing),
                        run.controller,
                        map_leaves(lambda x, k=k: np.asarray(x)[k : k + 1], starts),
                    )
                    for k in range(self.episodes)
                ]
                yield _row(name, port, won(free), dockings)


def _row(agent: str, port: str, docked: np.ndarray, dockings: list[Docking]) -> dict[str, Any]:
    captures = [one.capture for one in dockings if one.capture is not None]
    return {
        "agent": agent,
        "port": port,
        # By the mission's verdict, where bodies do not touch and where they do.
        "docked": float(np.mean(docked)),
        "with_contact": float(np.mean([one.docked for one in dockings])),
        "captured": sum(one.captured for one in captures) / len(dockings),
        # Share that touch the plate before the verdict.
        "touched": float(np.mean([one.touched for one in dockings])),
        "contact_speed": max(one.contact_speed for one in dockings),
        "contact_force": max(one.contact_force for one in dockings),
        "latch_load": max((one.load for one in captures), default=0.0),
    }
