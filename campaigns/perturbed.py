"""Holding a point near a target around the oblate Earth, with drag: ``python -m campaigns.perturbed``.

Mission guidance flies the same starts of hold around a sphere and around the oblate Earth with drag, once with an
orbit that it knows and once with the circle around a sphere in its place. Some flights are repeated in two-body
gravity with J2 and an atmosphere. With ``--docs docs`` the command writes docs/validation/perturbed.json and its
table in docs/missions/perturbed.md.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import tyro

from campaigns.command import ended
from campaigns.markdown import Table
from rans.evaluation.measure.metrics import impulses
from rans.files import environment, read_json, write_json
from rans.flight import fly
from rans.model.spacecraft_file import load_spacecraft
from rans.optimal.control.mission_guidance import MissionGuidance
from rans.scenario import EVALUATION_SEED, scenarios
from rans.tasks import TargetOrbit
from rans.tasks.hold import Hold
from rans.terminal import Terminal
from validation.two_body import Perturbations, TwoBodyMover

_DEADLINE = 1000.0
"""s"""
_INCLINATION = 51.6
"""Degrees, that of the International Space Station."""
_TARGET_DRAG = 0.02
"""Drag coefficient times area over mass of the target, m^2/kg: 2.2 times 1 m^2 for 110 kg."""
_DECELERATION = 3.7e-7
"""Acceleration by which the air at 500 km slows the target down, m/s^2: 6.967e-13 kg/m^3 and 7,320 m/s against the
air, which turns with the Earth."""
_RATIO = 0.5
"""Ballistic coefficient of the craft over that of the target."""
_HEADINGS = (
    "who",
    "flown in",
    "starts",
    "won, %",
    "limit broken, %",
    "mean spent, N s",
    "over the sphere, %",
    "worst, %",
)


@dataclass(frozen=True)
class Perturbed:
    """Fly all rows, print them, and write the evidence."""

    episodes: int = 32
    """Held-out starts."""
    true: int = 8
    """Number of starts, the first ones, that are flown in two-body gravity."""
    seed: int = EVALUATION_SEED
    """Seed of the starts."""
    docs: Path | None = None
    """Folder of the documents whose table and evidence are written; by default nothing is."""

    def run(self) -> int:
        """Print and write."""
        rows = self._flown()
        Terminal().show(f"hold by {_DEADLINE:,.0f} s, seed {self.seed}", _HEADINGS, _cells(rows))
        if self.docs is not None:
            evidence = {
                "seed": self.seed,
                "episodes": self.episodes,
                "true": self.true,
                "environment": environment(),
                "rows": rows,
            }
            write_json(self.docs / "validation" / "perturbed.json", evidence)
            in_document(self.docs).write(self.docs)
        return 0

    def _flown(self) -> list[dict[str, Any]]:
        craft = load_spacecraft("vbar-chaser")
        sphere = Hold(deadline=(_DEADLINE, _DEADLINE))
        orbit = TargetOrbit(
            oblate=True,
            inclination_degrees=_INCLINATION,
            target_drag=_DECELERATION,
            ballistic_ratio=_RATIO,
        )
        perturbed = replace(sphere, orbit=orbit)
        steps = round((_DEADLINE + sphere.hold_seconds) / Hold.timing.control_period) + 1
        timing = replace(Hold.timing, episode_steps=steps)
        air = Perturbations(
            math.radians(_INCLINATION),
            np.zeros(1),
            target_drag=_TARGET_DRAG,
            craft_drag=_TARGET_DRAG / _RATIO,
        )
        gravity = TwoBodyMover(craft, timing, sphere.mean_motion, perturbations=air)
        calm = np.zeros(0)
        rows = []
        for who, knows, flown_in, task, mover, count in (
            ("mission guidance", sphere, "sphere", sphere, None, self.episodes),
            ("mission guidance", perturbed, "J2, drag", perturbed, None, self.episodes),
            ("mission guidance for a sphere", sphere, "J2, drag", perturbed, None, self.episodes),
            (
                "mission guidance",
                perturbed,
                "two-body gravity, J2, air",
                perturbed,
                gravity,
                self.true,
            ),
        ):
            # The same positions and deadlines; the angle of the target is drawn besides.
            starts = scenarios(task, craft, self.seed, count)
            pilot = MissionGuidance(craft, knows)
            flight = fly(craft, task, pilot, starts, timing, "fast", mover)
            assert flight.done is not None
            spent = impulses(flight)
            if not len(calm):
                calm = spent
            more = 100.0 * (spent / calm[:count] - 1.0)
            rows.append(
                {
                    "who": who,
                    "flown in": flown_in,
                    "starts": count,
                    "won": 100.0 * float((flight.done & ~flight.violated()).mean()),
                    "broken": 100.0 * float(flight.violated().mean()),
                    "spent": float(spent.mean()),
                    "more": 100.0 * float(spent.sum() / calm[:count].sum() - 1.0),
                    "worst": float(more.max()),
                }
            )
        return rows


def _cells(rows: list[Any]) -> list[list[str]]:
    """Rows of the table."""
    return [
        [
            row["who"],
            row["flown in"],
            f"{row['starts']:,}",
            f"{row['won']:.1f}",
            f"{row['broken']:.1f}",
            f"{row['spent']:.0f}",
            f"{row['more']:+.1f}",
            f"{row['worst']:+.1f}",
        ]
        for row in rows
    ]


def in_document(docs: Path) -> Table:
    """The table of the evidence in docs/validation."""
    evidence = read_json(docs / "validation" / "perturbed.json")
    return Table(
        "missions/perturbed.md",
        "python -m campaigns.perturbed --docs docs",
        _HEADINGS,
        _cells(evidence["rows"]),
        f"The deadline is {_DEADLINE:,.0f} s. The values are in [perturbed.json](../validation/perturbed.json).",
    )


if __name__ == "__main__":
    raise SystemExit(ended("perturbed orbits", lambda: tyro.cli(Perturbed).run()))
