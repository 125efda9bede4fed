"""Impulse against time of inspections, beside their lower bound: ``python -m campaigns.inspection``.

Circumnavigation for several times, the controller `visiting` and the agent behind the safety filter fly from the
same held-out starts. With ``--docs docs`` the command writes docs/validation/mission-inspect.json and the table of
docs/missions/inspect.md.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from rans_missions.control.circumnavigation import Circumnavigation
from rans_missions.control.visiting import Visiting
from rans_missions.convex.inspection import inspection_bound
from rans_missions.guard import safety_filter
from rans_missions.tasks.inspect import Inspect

from campaigns import standings
from campaigns.command import ended
from campaigns.markdown import Table
from rans.episode import Guard, Setup
from rans.evaluation.fly.contestants import contestant
from rans.evaluation.measure.metrics import impulses
from rans.files import environment, read_json, write_json
from rans.flight import Controller, Flight, fly
from rans.model.spacecraft_file import load_spacecraft
from rans.scenario import EVALUATION_SEED, Scenario, each, scenarios
from rans.terminal import Terminal

_WITHIN = (12_240.0, 7_200.0, 5_400.0, 4_200.0, 3_600.0)
"""Times within which circumnavigation is to inspect, s; the first one is the length of an episode."""
_HEADINGS = (
    "who",
    "succeeded, %",
    "limit broken, %",
    "time, median (worst), s",
    "impulse, mean (worst), N s",
    "bound, N s",
)


@dataclass(frozen=True)
class Row:
    """Flights of one contestant."""

    who: str
    succeeded: float
    """Share of the starts from which it succeeds without breaking a limit."""
    broken: float
    """Share of the flights that break a limit."""
    median: float
    """Median time of success, s."""
    slowest: float
    """Largest time of success, s."""
    impulse: float
    """Mean impulse of the flights that succeed, N s."""
    worst: float
    """Largest of them, N s."""
    bound: float
    """Mean of the least impulse of success in the time of the same flight, N s."""

    def cells(self) -> list[str]:
        """As the table has them."""
        return [
            self.who,
            f"{100.0 * self.succeeded:.1f}",
            f"{100.0 * self.broken:.1f}",
            f"{self.median:,.0f} ({self.slowest:,.0f})",
            f"{self.impulse:.2f} ({self.worst:.2f})",
            f"{self.bound:.2f}",
        ]


@dataclass(frozen=True)
class Inspection:
    """Fly all contestants, write the evidence, and print the table."""

    episodes: int = 64
    """Held-out starts."""
    only: str = ""
    """Fly one contestant alone, such as visiting; by default all."""
    seed: int = EVALUATION_SEED
    """Seed of the starts."""
    docs: Path | None = None
    """Folder of the documents whose table and evidence are written; by default nothing is."""

    def run(self) -> int:
        """Print and write."""
        rows = [*self.rows()]
        Terminal().show("inspection", _HEADINGS, [row.cells() for row in rows])
        if self.docs is not None:
            evidence = {
                "seed": self.seed,
                "episodes": self.episodes,
                "environment": environment(),
                "rows": [asdict(row) for row in rows],
            }
            write_json(self.docs / "validation" / "mission-inspect.json", evidence)
            in_document(self.docs).write(self.docs)
            standings.in_document(self.docs, "inspect").write(self.docs)
        return 0

    def rows(self) -> Iterator[Row]:
        """Every contestant's flights."""
        craft = load_spacecraft("afrl-deputy")
        task = Inspect().for_evaluation()
        starts = scenarios(task, craft, self.seed, self.episodes)
        agent = contestant("pretrained:inspect-3d")
        contestants: list[tuple[str, Controller, Guard | None]] = [
            (
                f"circumnavigation, {within:,.0f} s",
                Circumnavigation(craft, task, within=within),
                None,
            )
            for within in _WITHIN
        ]
        contestants.append(("visiting", Visiting(craft, task), None))
        guard = safety_filter(Setup(craft, task))
        contestants.append(("inspect-3d, filtered", agent.controller, guard))
        for who, controller, guarded in contestants:
            if self.only not in ("", who):
                continue
            flight = fly(craft, task, controller, starts, task.timing, guard=guarded)
            yield _row(who, flight, starts)


def _row(who: str, flight: Flight, starts: Scenario) -> Row:
    assert flight.done is not None
    assert flight.lengths is not None
    broken = flight.violated()
    won = flight.done & ~broken
    times = (flight.lengths * flight.timing.control_period)[won]
    spent = impulses(flight)[won]
    assert isinstance(flight.task, Inspect)
    bounds = []
    for one, good, steps in zip(each(starts), won, flight.lengths, strict=True):
        start: Any = one
        if good:
            time = float(steps) * flight.timing.control_period
            bounds.append(
                inspection_bound(
                    flight.craft, flight.task, start.start, start.goal, time, flight.timing
                )
            )
    return Row(
        who,
        float(won.mean()),
        float(broken.mean()),
        float(np.median(times)),
        float(times.max()),
        float(spent.mean()),
        float(spent.max()),
        float(np.mean(bounds)),
    )


def in_document(docs: Path) -> Table:
    """The table of the mission's page, of the evidence in docs/validation."""
    evidence = read_json(docs / "validation" / "mission-inspect.json")
    return Table(
        "missions/inspect.md",
        "python -m campaigns.inspection --docs docs",
        _HEADINGS,
        [Row(**row).cells() for row in evidence["rows"]],
        f"{evidence['episodes']:,} starts each. The bound is the mean of the least impulse of success in the time "
        "of the same flight. "
        "The values are in [mission-inspect.json](../../../docs/validation/mission-inspect.json).",
    )


if __name__ == "__main__":
    raise SystemExit(ended("inspection", lambda: tyro.cli(Inspection).run()))
