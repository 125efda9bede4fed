"""From which states the safety filter holds: ``python -m campaigns.safe_set``.

The spacecraft flies straight at the middle of a keep-out zone of the mission avoid, at several distances from its
surface and speeds relative to it, with any attitude and a spin of up to 0.5 rad/s. States within another zone are
left out. A state is *safe* if one of the filter's manoeuvres keeps every constraint from it
(`rans_missions.guard.FlownBackup.safe`). With ``--docs docs`` the command writes docs/validation/safe-set.json and
its table in docs/missions/guard.md.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from rans_missions.guard import safety_filter
from rans_missions.tasks import Avoid

from campaigns.command import ended
from campaigns.markdown import Table
from rans.episode import Setup, World
from rans.files import environment, read_json, write_json
from rans.model.fields import map_leaves, unflatten
from rans.model.spacecraft_file import load_spacecraft
from rans.scenario import scenarios
from rans.tasks import Task
from rans.terminal import Terminal

_CRAFT = {"plane": "floating-platform", "space": "free-flyer"}
_DISTANCES = (0.05, 0.1, 0.2, 0.4, 0.8)
"""From the zone's surface, m."""
_SPEEDS = (0.1, 0.2, 0.3, 0.5, 0.8)
"""Towards its centre, m/s."""
_SPIN = 0.5
"""Largest spin about each axis, rad/s."""
_SEED = 2031
_HEADINGS = ("", "towards the zone", *(f"{distance:g} m" for distance in _DISTANCES))


@dataclass(frozen=True)
class Row:
    """Shares of safe states at one speed, by distance."""

    mission: str
    speed: float
    safe: tuple[float, ...]

    def cells(self) -> list[str]:
        """As the table has them."""
        return [
            self.mission,
            f"{self.speed:g} m/s",
            *(f"{100.0 * share:.1f}" for share in self.safe),
        ]


@dataclass(frozen=True)
class SafeSet:
    """Judge states, write the evidence, and print the table."""

    states: int = 1024
    """States of every distance and speed."""
    docs: Path | None = None
    """Folder of the documents whose table and evidence are written; by default nothing is."""

    def run(self) -> int:
        """Print and write."""
        rows = [*self._rows()]
        Terminal().show("safe states, %", _HEADINGS, [row.cells() for row in rows])
        if self.docs is not None:
            evidence = {
                "seed": _SEED,
                "states": self.states,
                "environment": environment(),
                "rows": [asdict(row) for row in rows],
            }
            write_json(self.docs / "validation" / "safe-set.json", evidence)
            in_document(self.docs).write(self.docs)
        return 0

    def _rows(self) -> Iterator[Row]:
        for mission, name in _CRAFT.items():
            craft = load_spacecraft(name)
            task = Avoid().for_evaluation()
            setup = Setup(craft, task, task.timing)
            guard: Any = safety_filter(setup)
            world = World(setup)
            starts = scenarios(task, craft, _SEED, self.states)
            for speed in _SPEEDS:
                shares = []
                for distance in _DISTANCES:
                    state = _approach(task, starts.start, starts.goal, distance, speed)
                    margins = task.constraints(state, starts.goal).values()
                    outside = np.min([np.asarray(margin) for margin in margins], axis=0) >= 0.0
                    safe = np.asarray(guard.safe(world, state, starts.goal))
                    shares.append(float(np.mean(safe[outside])))
                yield Row(mission, speed, tuple(shares))


def _approach(task: Task, start: Any, goal: Any, distance: float, speed: float) -> Any:
    """States (N,) that fly straight at the first zone, with the attitudes of the starts."""
    random = np.random.default_rng(_SEED)
    zone: Any = task.scenery(goal)[0]
    count = len(np.asarray(start.p.x))
    away = random.normal(size=(len(zone.centre.columns()), count))
    away /= np.linalg.norm(away, axis=0)
    outwards = unflatten(zone.centre, list(away))
    spins = map_leaves(lambda x: random.uniform(-_SPIN, _SPIN, np.shape(x)), start.w)
    return replace(
        start,
        p=zone.centre + outwards.scale(zone.radius + distance),
        v=zone.v + outwards.scale(-speed),
        w=spins,
    )


def in_document(docs: Path) -> Table:
    """The table of the filter's page, of the evidence in docs/validation."""
    evidence = read_json(docs / "validation" / "safe-set.json")
    return Table(
        "missions/guard.md",
        "python -m campaigns.safe_set --docs docs",
        _HEADINGS,
        [Row(**row).cells() for row in evidence["rows"]],
        f"{evidence['states']:,} states each, in %. The values are in "
        "[safe-set.json](../../../docs/validation/safe-set.json).",
    )


if __name__ == "__main__":
    raise SystemExit(ended("safe states", lambda: tyro.cli(SafeSet).run()))
