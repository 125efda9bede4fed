"""Optimal problems of missions: their bounds in comparisons, and what ``rans optimal`` does with them.

The core finds it by entry points; a mission without an entry here has no bound in comparisons.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rans.evaluation.problems import Problem
from rans.extend import (
    EVALUATION_SEED,
    Spacecraft,
    Task,
    Terminal,
    environment,
    progress,
    ready_folder,
    write_json,
)
from rans.files import distinct
from rans.model.spacecraft_file import spacecraft_label
from rans.terminal import stages
from rans_missions.bounds.first_starts import bounded, mission_bounds
from rans_missions.tasks import FinalApproach, Land
from rans_missions.tasks.orbital import OrbitalMission

if TYPE_CHECKING:
    from rans.cli.optimal import Optimal
    from rans_missions.bounds.transfers import TransferTable


def transfers(command: Optimal, craft: Spacecraft, task: Task) -> int:
    """Compare contestants with the bounds of a mission on an orbit; print and write the table."""
    from rans_missions.bounds.transfers import contestants_of, judged_transfers

    mission = OrbitalMission.expected(task, "transfers end in missions")
    command.refuse_all_but("spacecraft", "horizon", "episodes", "contestants")
    deadline = mission.deadline[1] if command.horizon is None else command.horizon
    folder = ready_folder(command.output or Path("runs") / f"optimal-{distinct(command.task)}")
    makers = contestants_of(craft, mission, command.contestants)
    table = command.with_progress(
        "bounds",
        lambda step: judged_transfers(
            craft, mission, makers, deadline, EVALUATION_SEED, command.episodes, progress=step
        ),
    )
    title = f"{command.task} with {craft.name} by {deadline:g} s, {command.episodes} starts"
    return _reported(title, folder, table)


def approaches(command: Optimal, craft: Spacecraft, task: Task) -> int:
    """Compare guidance with the bounds of a final approach; print and write the table."""
    from rans_missions.bounds.transfers import judged_approaches

    approach = FinalApproach.expected(task, "approaches end at ports")
    command.refuse_all_but("spacecraft", "episodes")
    folder = ready_folder(command.output or Path("runs") / f"optimal-{distinct(command.task)}")
    table = command.with_progress(
        "bounds",
        lambda step: judged_approaches(
            craft, approach, EVALUATION_SEED, command.episodes, progress=step
        ),
    )
    title = f"{command.task} with {craft.name}, {command.episodes} starts"
    return _reported(title, folder, table)


def _reported(title: str, folder: Path, table: TransferTable) -> int:
    """Print a table of missions and write optimal.json; 1 if a start has no flight."""
    Terminal().show(
        title,
        table.columns,
        table.cells(),
        caption="Impulse over the proven bound of the same start and deadline, of those who won.",
    )
    write_json(folder / "optimal.json", table.to_json())
    lost = int((~np.isfinite(table.upper)).sum())
    Terminal().say(
        f"{len(table.upper) - lost} of {len(table.upper)} solved and flown in both engines. Written to "
        f"{folder / 'optimal.json'}."
    )
    return 1 if lost else 0


def landings(command: Optimal, craft: Spacecraft, task: Task) -> int:
    """Compute landings by convex programming; only starts and ending can be chosen."""
    from rans_missions.bounds.landings import landing_table, landings

    assert isinstance(task, Land)
    command.refuse_all_but("spacecraft", "ending", "episodes", "start", "goal")
    # Solve, then fly the solutions in Drake.
    starts = command.sampled_starts(task, craft)
    name = f"optimal-{distinct(command.task)}-{spacecraft_label(craft)}-propellant"
    folder = ready_folder(command.output or Path("runs") / name)
    with progress() as bars:
        step = stages(bars)("landings", len(starts.start.p.x))
        answers = landings(craft, task, starts, command.ending == "exact", step)
    where = (
        "exactly at the site"
        if command.ending == "exact"
        else f"within {task.position_tolerance:g} m and {task.velocity_tolerance:g} m/s"
    )
    title = (
        f"least propellant to land {where}: {command.task} with {craft.name}, turned at once, thrust held for "
        f"{task.timing.control_period:g} s"
    )
    Terminal().table(landing_table(title, answers))
    # Files, and how many are solved.
    about = {
        "task": command.task,
        "spacecraft": craft.name,
        "ending": command.ending or "set",
        "seed": None if command.start else EVALUATION_SEED,
        "environment": environment(),
        "starts": [answer.to_json() for answer in answers],
    }
    write_json(folder / "optimal.json", about)
    lost = sum(not answer.good for answer in answers)
    Terminal().say(
        f"{len(answers) - lost} of {len(answers)} solved and flown in Drake. Written to "
        f"{folder / 'optimal.json'}."
    )
    return 1 if lost else 0


RENDEZVOUS = Problem(bounded, mission_bounds, solve=transfers)
"""The least impulse to a position near a target on an orbit, by a deadline."""
LANDING = Problem(bounded, mission_bounds, ("optimal",), landings)
"""The least propellant of a landing."""
INSPECTION = Problem(bounded, mission_bounds, ("circumnavigation", "optimal"))
"""A lower bound of the impulse of an inspection; no optimum is known."""
APPROACH = Problem(bounded, mission_bounds, ("corridor", "optimal"), approaches)
"""The least impulse of a flight through the corridor of a port."""
