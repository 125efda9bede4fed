"""Docking with contact in Drake, beside the mission's own verdict: ``python -m campaigns.dock_contact``.

The agents of dock-port that come with RANS fly held-out starts twice in Drake: with bodies that touch nothing, and
with a probe, a plate and latches (`campaigns.contact`). With ``--docs docs`` the command writes
docs/validation/dock-contact.json and its table in docs/missions/dock-port.md.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import tyro
from rans_missions.tasks import DockPort

from campaigns.command import ended
from campaigns.contact import CaptureSystem, Docking, fly_to_contact
from campaigns.markdown import Table
from rans.episode import Setup
from rans.evaluation.fly.contestants import contestant
from rans.files import environment, read_json, write_json
from rans.model.fields import map_leaves
from rans.reference.flight import fly_in_drake
from rans.scenario import EVALUATION_SEED, scenarios
from rans.terminal import Terminal

_AGENTS = ("dock-port-2d", "dock-port-2d-atmos", "dock-port-3d")
_RATES = {"at rest": 0.0, "3 deg/s": math.radians(3.0)}
"""Rates of the port, rad/s."""
_HEADINGS = (
    "agent",
    "port",
    "docked, %",
    "docked with contact, %",
    "captured, %",
    "touched before, %",
    "at most, cm/s",
    "contact at most, N",
    "latches at most, N",
)


@dataclass(frozen=True)
class Row:
    """One agent and one rate of the port."""

    agent: str
    port: str
    docked: float
    """Share of the flights that dock where bodies do not touch, by the mission's verdict."""
    with_contact: float
    """Share that dock by the same verdict where bodies touch."""
    captured: float
    """Share of all flights that are captured."""
    touched: float
    """Share that touch the plate before the verdict."""
    contact_speed: float
    """Largest speed of a first contact, m/s."""
    contact_force: float
    """Largest contact force, N."""
    latch_load: float
    """Largest load of the latches, N."""

    def cells(self) -> list[str]:
        """As the table has them."""
        shares = (self.docked, self.with_contact, self.captured, self.touched)
        return [
            self.agent,
            self.port,
            *(f"{100.0 * share:.1f}" for share in shares),
            f"{100.0 * self.contact_speed:.1f}",
            f"{self.contact_force:.1f}",
            f"{self.latch_load:.1f}",
        ]


@dataclass(frozen=True)
class DockContact:
    """Fly every agent at every rate, write the evidence, and print the table."""

    episodes: int = 64
    """Held-out starts."""
    seed: int = EVALUATION_SEED
    """Seed of the starts."""
    docs: Path | None = None
    """Folder of the documents whose table and evidence are written; by default nothing is."""

    def run(self) -> int:
        """Print and write."""
        rows = [*self._rows()]
        Terminal().show("docking with contact", _HEADINGS, [row.cells() for row in rows])
        if self.docs is not None:
            evidence = {
                "seed": self.seed,
                "episodes": self.episodes,
                "system": asdict(CaptureSystem()),
                "environment": environment(),
                "rows": [asdict(row) for row in rows],
            }
            write_json(self.docs / "validation" / "dock-contact.json", evidence)
            in_document(self.docs).write(self.docs)
        return 0

    def _rows(self) -> Iterator[Row]:
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
                assert free.done is not None
                docked = free.done & ~free.violated()
                yield _row(name, port, docked, dockings)


def _row(agent: str, port: str, docked: np.ndarray, dockings: list[Docking]) -> Row:
    captures = [one.capture for one in dockings if one.capture is not None]
    return Row(
        agent,
        port,
        float(np.mean(docked)),
        float(np.mean([one.docked for one in dockings])),
        sum(one.captured for one in captures) / len(dockings),
        float(np.mean([one.touched for one in dockings])),
        max(one.contact_speed for one in dockings),
        max(one.contact_force for one in dockings),
        max((one.load for one in captures), default=0.0),
    )


def in_document(docs: Path) -> Table:
    """The table of dock-port's page, of the evidence in docs/validation."""
    evidence = read_json(docs / "validation" / "dock-contact.json")
    return Table(
        "missions/dock-port.md",
        "python -m campaigns.dock_contact --docs docs",
        _HEADINGS,
        [Row(**row).cells() for row in evidence["rows"]],
        f"{evidence['episodes']:,} starts each. The values are in "
        "[dock-contact.json](../../../docs/validation/dock-contact.json).",
    )


if __name__ == "__main__":
    raise SystemExit(ended("docking with contact", lambda: tyro.cli(DockContact).run()))
