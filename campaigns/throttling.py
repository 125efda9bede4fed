"""What a lander gains by throttling its engines one by one: ``python -m campaigns.throttling``.

With all engines and without the first, it finds lower bounds of the propellant from held-out starts of land, with
engines that are throttled alike, and one by one. The craft turns at once. From starts without a landing it finds
the bound again for a craft of the same mass, of which twice as much is propellant.
Where it is more than the real craft has, nothing lands. With ``--docs docs`` the command writes
docs/validation/throttling.json and its table in docs/missions/land.md.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import tyro
from rans_missions.convex.landing import Descent, Lander, best_landing, thrust_offset
from rans_missions.tasks.land import Land

from campaigns.command import ended
from campaigns.markdown import Table
from rans.files import environment, number, read_json, write_json
from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import load_spacecraft
from rans.scenario import EVALUATION_SEED, each, scenarios
from rans.terminal import Terminal

_ENGINES: dict[str, tuple[int, ...]] = {"all": (), "without the first": (0,)}
"""Dead engines, by what the table calls it."""
_HEADINGS = (
    "engines",
    "starts",
    "with a landing, throttled alike",
    "one by one",
    "least propellant, alike",
    "one by one, at least",
    "other starts, at least",
)


@dataclass(frozen=True)
class Row:
    """Bounds of all starts with the same engines, kg; infinite where there is no landing."""

    engines: str
    alike: tuple[float, ...]
    """Engines throttled alike."""
    apart: tuple[float, ...]
    """Engines throttled one by one."""
    needed: tuple[float, ...]
    """Least propellant with twice as much in the tank, from the starts without a landing, kg."""

    def cells(self) -> list[str]:
        """As the table has them."""
        alike, apart = np.array(self.alike), np.array(self.apart)
        both = np.isfinite(alike) & np.isfinite(apart)
        needed = [kg for kg in self.needed if math.isfinite(kg)]
        others = []
        if needed:
            others.append(f"{len(needed)}: {min(needed):.0f} to {max(needed):.0f} kg")
        if weak := len(self.needed) - len(needed):
            others.append(f"{weak}: too little thrust")
        return [
            self.engines,
            str(len(alike)),
            str(np.isfinite(alike).sum()),
            str(np.isfinite(apart).sum()),
            f"{alike[both].mean():.1f} kg",
            f"{apart[both].mean():.1f} kg",
            "; ".join(others) or "-",
        ]


@dataclass(frozen=True)
class Throttling:
    """Find the bounds, write the evidence, and print the table."""

    episodes: int = 32
    """Held-out starts."""
    docs: Path | None = None
    """Folder of the documents whose table and evidence are written; by default nothing is."""

    def run(self) -> int:
        """Print and write."""
        task = Land()
        assert task.spacecraft is not None
        rows = [*_rows(load_spacecraft(task.spacecraft), task, self.episodes)]
        Terminal().show(
            "engines throttled alike and one by one", _HEADINGS, [row.cells() for row in rows]
        )
        if self.docs is not None:
            evidence = {
                "seed": EVALUATION_SEED,
                "episodes": self.episodes,
                "environment": environment(),
                "rows": [asdict(row) for row in rows],
            }
            write_json(self.docs / "validation" / "throttling.json", evidence)
            in_document(self.docs).write(self.docs)
        return 0


def _rows(craft: Spacecraft, task: Land, count: int) -> Iterator[Row]:
    period = task.timing.control_period
    longest = period * task.timing.episode_steps
    descent = Descent.of(task)
    starts = [
        (np.array(one.start.p.columns()), np.array(one.start.v.columns()))
        for one in each(scenarios(task, craft, EVALUATION_SEED, count))
    ]
    for engines, dead in _ENGINES.items():
        # Thrust that is off the craft's axis may be tilted by so much more than the craft.
        offset = thrust_offset(craft, dead) if dead else 0.0
        alike = Lander.of(craft, dead), replace(descent, tilt=descent.tilt + offset)
        apart = Lander.of(craft, dead, apart=True), descent
        found = []
        for lander, limits in (alike, apart):
            best = [
                best_landing(lander, limits, start, period, "bound", (2.0, longest))
                for start in starts
            ]
            found.append(tuple(math.inf if one is None else one.dual for one in best))
        lander = replace(apart[0], propellant=2.0 * apart[0].propellant)
        needed = []
        for start, least in zip(starts, found[1], strict=True):
            if math.isinf(least):
                one = best_landing(lander, descent, start, period, "bound", (2.0, longest))
                needed.append(math.inf if one is None else one.dual)
        yield Row(engines, found[0], found[1], tuple(needed))


def in_document(docs: Path) -> Table:
    """The table of the landing's page, of the evidence in docs/validation."""
    evidence = read_json(docs / "validation" / "throttling.json")
    rows = []
    for row in evidence["rows"]:
        bounds = {key: tuple(number(kg) for kg in row[key]) for key in ("alike", "apart", "needed")}
        rows.append(Row(row["engines"], **bounds).cells())
    return Table(
        "missions/land.md",
        "python -m campaigns.throttling --docs docs",
        _HEADINGS,
        rows,
        "The values are in [throttling.json](../../../docs/validation/throttling.json).",
    )


if __name__ == "__main__":
    raise SystemExit(ended("throttling", lambda: tyro.cli(Throttling).run()))
