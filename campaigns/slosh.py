"""What a sloshing liquid costs agents that know nothing of it: ``python -m campaigns.slosh``.

Each agent flies its own craft, in which a share of the mass swings. Mass and inertia stay as they are. With
``--docs docs`` the command writes docs/validation/slosh.json and its table in docs/missions/slosh.md.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import tyro

from campaigns.command import ended
from campaigns.markdown import Table
from rans.evaluation.fly.contestants import contestant
from rans.evaluation.fly.episodes import fly_episodes
from rans.evaluation.measure.metrics import impulses, settling_times, solved
from rans.files import environment, number, read_json, write_json
from rans.flight import Flight
from rans.model.slosh import Slosh
from rans.model.spacecraft import Spacecraft
from rans.scenario import EVALUATION_SEED
from rans.terminal import Terminal

_CONTESTANTS = (
    "pretrained:go-to-pose-2d",
    "pretrained:go-to-pose-2d-robust",
    "lqr:go-to-pose-2d",
    "pretrained:dock-port-2d",
    "pretrained:dock-port-2d-atmos",
    "pretrained:go-to-pose-3d",
    "pretrained:any-craft-3d",
    "pretrained:dock-port-3d",
)
SHARES = (0.0, 0.05, 0.1, 0.2)
"""Mass that swings over the mass of the craft."""
_RADIUS = 0.1
_DEPTH = 0.1
"""Radius of the cylindrical tank and depth of its liquid, m: a tank that is half full at twice its radius."""
_BEHIND = 0.1
"""Distance from the craft's centre of mass back to the middle of the liquid, m."""
_DAMPING_RATIO = 0.005
"""Damping of the pendulum over its critical damping, in a smooth tank without baffles, at the acceleration below
(Dodge 2000, chapter 2)."""
_ACCELERATION = 0.2
"""m/s^2, as of the floating platform with one thruster."""
HEADINGS = (
    "who",
    "swings, % of the mass",
    "settled or docked, %",
    "limit broken, %",
    "median time, s",
    "impulse, N s",
    "first starts, %",
    "in Drake, %",
)


@dataclass(frozen=True)
class Measured:
    """A contestant with one share of its mass swinging."""

    who: str
    share: float
    starts: int
    won: float
    """Share that settled, or docked without breaking a limit."""
    violated: float
    """Share that broke a limit."""
    time: float
    """Median time of those that won, s; NaN where nobody did."""
    impulse: float
    """Mean impulse of those that won, N s."""
    swing: float
    """Median of the largest angle of the rod in each flight, degrees; NaN without slosh."""
    drake: float
    """Share of the first starts that win in Drake; NaN where none flew."""
    drake_starts: int
    drake_here: float
    """Share of these starts that win in RANS."""


@dataclass(frozen=True)
class Sloshing:
    """Fly everybody, write the evidence, and print the table."""

    episodes: int = 256
    """Held-out starts."""
    drake: int = 16
    """Number of starts, the first ones, that fly in Drake too, with the largest share."""
    seed: int = EVALUATION_SEED
    """Seed of the starts."""
    docs: Path | None = None
    """Folder of the documents whose table and evidence are written; by default nothing is."""

    def run(self) -> int:
        """Print and write."""
        measured = [asdict(self._flown(who, share)) for who in _CONTESTANTS for share in SHARES]
        Terminal().show(f"slosh, seed {self.seed}", HEADINGS, [_cells(x) for x in measured])
        if self.docs is not None:
            evidence = {
                "seed": self.seed,
                "environment": environment(),
                "rows": measured,
            }
            write_json(self.docs / "validation" / "slosh.json", evidence)
            in_document(self.docs).write(self.docs)
        return 0

    def _flown(self, who: str, share: float) -> Measured:
        run = contestant(who)
        setup = run.judged._replace(craft=with_slosh(run.craft, share))
        flight = fly_episodes(run.controller, setup, self.seed, self.episodes).flight
        won = _won(flight)
        times = settling_times(flight)[won]
        drake = 0 if share < max(SHARES) else min(self.drake, self.episodes)
        there = float("nan")
        if drake:
            other = fly_episodes(run.controller, setup, self.seed, drake, "drake", workers=1)
            there = float(_won(other.flight).mean())
        return Measured(
            who.removeprefix("pretrained:"),
            share,
            self.episodes,
            float(won.mean()),
            float(flight.violated().mean()),
            float(np.median(times)) if len(times) else float("nan"),
            float(impulses(flight)[won].mean()) if won.any() else float("nan"),
            _swing(flight),
            there,
            drake,
            float(won[:drake].mean()) if drake else float("nan"),
        )


def with_slosh(craft: Spacecraft, share: float) -> Spacecraft:
    """The craft in which a share of the mass swings, in a half-full tank behind its centre of mass."""
    if share == 0.0:
        return craft
    x, y, z = craft.centre_of_mass
    middle = x - _BEHIND
    tank = (_RADIUS, _DEPTH, (middle - 0.5 * _DEPTH, y, z), (-1.0, 0.0, 0.0))
    of_one = Slosh.in_cylinder(1.0, *tank, _DAMPING_RATIO, _ACCELERATION)
    liquid = share * craft.mass / of_one.mass
    slosh = Slosh.in_cylinder(liquid, *tank, _DAMPING_RATIO, _ACCELERATION)
    return replace(craft, slosh=slosh)


def _won(flight: Flight) -> np.ndarray:
    return solved(flight) & ~flight.violated()


def _swing(flight: Flight) -> float:
    """Median of the largest angle of the rod, degrees."""
    if flight.craft.slosh is None:
        return float("nan")
    stores = dict(
        zip((store.name for store in flight.craft.stores), flight.states.stores, strict=True)
    )
    if flight.craft.dimension == 2:
        angles = np.abs(stores["slosh angle"])
    else:
        rest = flight.craft.slosh.direction
        along = sum(stores[f"slosh direction {a}"] * e for a, e in zip("xyz", rest, strict=True))
        angles = np.arccos(np.clip(along, -1.0, 1.0))
    return float(np.degrees(np.median(np.nanmax(angles, axis=0))))


def _cells(measured: dict[str, Any]) -> list[str]:
    return [
        measured["who"],
        f"{100.0 * measured['share']:g}",
        f"{100.0 * measured['won']:.1f}",
        f"{100.0 * measured['violated']:.1f}",
        _number(measured["time"], 1),
        _number(measured["impulse"], 1),
        _number(100.0 * number(measured["drake_here"]), 1),
        _number(100.0 * number(measured["drake"]), 1),
    ]


def _number(value: float, digits: int) -> str:
    return f"{number(value):,.{digits}f}" if np.isfinite(number(value)) else "-"


def in_document(docs: Path) -> Table:
    """The table of flights, of the evidence in docs/validation."""
    evidence = read_json(docs / "validation" / "slosh.json")
    rows = evidence["rows"]
    drake = max(row["drake_starts"] for row in rows)
    return Table(
        "missions/slosh.md",
        "python -m campaigns.slosh --docs docs",
        HEADINGS,
        [_cells(x) for x in rows],
        f"{rows[0]['starts']:,} starts each. The first {drake} fly in Drake too. The values are in "
        "[slosh.json](../../../docs/validation/slosh.json).",
    )


if __name__ == "__main__":
    raise SystemExit(ended("slosh", lambda: tyro.cli(Sloshing).run()))
