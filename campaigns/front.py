"""Impulse against time of a mission in the plane: proven bounds, and optimal trajectories beside them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from campaigns.markdown import Table
from rans.api.limits import optimal_trajectory
from rans.files import number, read_json, write_json
from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import load_spacecraft
from rans.scenario import EVALUATION_SEED, Scenario, scenario
from rans.tasks import TASKS

_CRAFT = "floating-platform"


@dataclass(frozen=True)
class Front:
    """Where the front of a mission is written, and its bound."""

    mission: str
    """Name of the task, of the page docs/missions/MISSION.md and of docs/validation/MISSION-front.json."""
    command: str
    """What measures it."""
    when: str
    """What the page calls the time."""
    least: Callable[[Spacecraft, Any, Scenario, float], float]
    """Bound on the impulse, N s, of craft, task, start and time, s."""

    def measure(self, docs: Path, times: Sequence[float], starts: int, guesses: int) -> int:
        """Write the evidence and the table; 1 if a trajectory is below its bound.

        Args:
            docs: folder of the documents.
            times: lengths of the trajectories, s.
            starts: number of starts, the first of the evaluation.
            guesses: guesses of each trajectory; the best counts.
        """
        task = TASKS[self.mission]().for_evaluation()
        craft = load_spacecraft(_CRAFT)
        rows = []
        for time in times:
            for k in range(starts):
                one = scenario(task, craft.dimension, EVALUATION_SEED, k)
                found = optimal_trajectory(
                    self.mission, craft, start=k, horizon=time, guesses=guesses
                )
                spent = found.trajectory.cost if found.trajectory.solved else math.inf
                bound = self.least(craft, task, one, time)
                rows.append({"time": time, "start": k, "bound": bound, "flight": spent})
        write_json(docs / self._file, {"rows": rows})
        self.in_document(docs).write(docs)
        return int(any(row["flight"] < row["bound"] for row in rows))

    def in_document(self, docs: Path) -> Table:
        """Means over the starts that have a trajectory."""
        found: dict[float, list[tuple[float, float]]] = {}
        for row in read_json(docs / self._file)["rows"]:
            found.setdefault(row["time"], []).append((row["bound"], number(row["flight"])))
        lines = []
        for time, pairs in found.items():
            solved = np.array([pair for pair in pairs if math.isfinite(pair[1])])
            bound, flight = solved.mean(axis=0)
            least = (solved[:, 0] / solved[:, 1]).min()
            cells = f"{bound:.2f} N s", f"{flight:.2f} N s", f"{bound / flight:.2f} (≥ {least:.2f})"
            lines.append([f"{time:g} s", f"{len(solved)} of {len(pairs)}", *cells])
        headings = self.when, "starts", "proven bound", "optimal trajectory", "bound over it"
        return Table(f"missions/{self.mission}.md", self.command, headings, lines, "")

    @property
    def _file(self) -> str:
        """The evidence, from docs."""
        return f"validation/{self.mission}-front.json"
