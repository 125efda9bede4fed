"""The table of `rans stress` without the rest of its sweep: ``python -m campaigns named-conditions``.

`rans stress` flies the agents and controllers of the table under 94 sizes of disturbances too. Here they fly under
nominal conditions, the sets that come with RANS and failed thrusters alone, from the same starts. The evidence
then has no sizes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from rans_assurance.stress.report import StressReport
from rans_assurance.stress.run import prepared

from rans.episode.scenario import EVALUATION_SEED
from rans.evaluation.compare.entrants import contest_of
from rans.randomization.conditions_file import load_conditions

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

    def measured(self) -> dict[str, Any]:
        """What each solves."""
        specs = [*(f"pretrained:{name}" for name in _AGENTS), *_CONTROLLERS]
        conditions = {name: load_conditions(name) for name in _SETS}
        contest = contest_of(specs[0], self.episodes, self.seed)
        planned = replace(prepared(contest, specs, conditions, (), self.episodes), effects=())
        planned.fly()
        return StressReport(planned, Path(), 0, "python -m campaigns named-conditions").to_json()
