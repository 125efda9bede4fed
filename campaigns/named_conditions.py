"""The table of `rans stress` without the rest of its sweep: ``python -m campaigns.named_conditions``.

`rans stress` flies the agents and controllers of the table under 94 sizes of disturbances too. Here they fly under
nominal conditions, the sets that come with RANS and failed thrusters alone, from the same starts. The command
writes docs/validation/stress.json, or that of another folder by ``--docs``, which then has no sizes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import tyro
from rans_assurance.pages.stress_page import StressReport
from rans_assurance.stress.run import prepared

from campaigns.command import ended
from campaigns.table import table
from rans.evaluation.compare.entrants import contest_of
from rans.files import write_json
from rans.randomization.conditions_file import load_conditions
from rans.scenario import EVALUATION_SEED
from rans.terminal import Terminal

_AGENTS = ("go-to-pose-2d-robust", "go-to-pose-2d-faults", "go-to-pose-2d")
_CONTROLLERS = ("lqr", "switching")
_SETS = ("lab", "roboran", "orbit", "harsh")


@dataclass(frozen=True)
class NamedConditions:
    """Fly the contestants of the page's table under conditions without a size."""

    episodes: int = 256
    """Flights of each contestant under each set of conditions."""
    seed: int = EVALUATION_SEED
    """Seed of the starts and of the conditions."""
    docs: Path = Path("docs")
    """Folder of the documents whose evidence is written."""

    def run(self) -> int:
        """Fly, write and print."""
        specs = [*(f"pretrained:{name}" for name in _AGENTS), *_CONTROLLERS]
        conditions = {name: load_conditions(name) for name in _SETS}
        contest = contest_of(specs[0], self.episodes, self.seed)
        planned = replace(prepared(contest, specs, conditions, (), self.episodes), effects=())
        planned.fly()
        report = StressReport(planned, Path(), 0, "python -m campaigns.named_conditions")
        write_json(self.docs / "validation" / "stress.json", report.to_json())
        found = table(self.docs, "stress")
        Terminal().show("solved, %", found.headings, found.rows)
        return 0


if __name__ == "__main__":
    raise SystemExit(ended("named conditions", lambda: tyro.cli(NamedConditions).run()))
