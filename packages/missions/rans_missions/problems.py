"""Optimal problems of missions: their bounds in comparisons, and what ``rans optimal`` does with them.

The core finds it by entry points; a mission without an entry here has no bound in comparisons.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from rans import scenarios
from rans.extend import (
    EVALUATION_SEED,
    Problem,
    Spacecraft,
    Task,
    Terminal,
    distinct,
    environment,
    progress,
    ready_folder,
    stages,
    write_json,
)
from rans_missions.bounds.first_starts import add_bounds, bounded
from rans_missions.tasks import FinalApproach, Land
from rans_missions.tasks.orbital import OrbitalMission


def transfers(command: Any, craft: Spacecraft, task: Task) -> int:
    """Print and write the least impulse of a mission on an orbit from each start; 1 if a start has no flight."""
    from rans_missions.bounds.transfers import least_of_approaches, least_of_transfers

    folder = ready_folder(command.output or Path("runs") / f"optimal-{distinct(command.task)}")
    mission: Any = task
    least: Any = least_of_approaches
    until = ""
    if isinstance(task, FinalApproach):
        command.refuse_all_but("spacecraft", "episodes")
    else:
        command.refuse_all_but("spacecraft", "horizon", "episodes")
        mission = OrbitalMission.expected(task, "transfers end in missions")
        deadline = mission.deadline[1] if command.horizon is None else command.horizon
        mission = replace(mission, deadline=(deadline, deadline))
        least = least_of_transfers
        until = f" by {deadline:g} s"
    starts = scenarios(mission, craft, EVALUATION_SEED, command.episodes)
    found = command.with_progress("bounds", lambda step: least(craft, mission, starts, step))
    about = {"command": command.command_line()}
    write_json(folder / "optimal.json", about | found.to_json(), beside=())
    Terminal().table(found.table(f"least impulse: {command.task} with {craft.name}{until}"))
    lost = int((~np.isfinite(found.upper)).sum())
    Terminal().say(
        f"{len(found.upper) - lost} of {len(found.upper)} solved and flown in both engines. Written to "
        f"{folder / 'optimal.json'}."
    )
    return 1 if lost else 0


def landings(command: Any, craft: Spacecraft, task: Task) -> int:
    """Compute landings by convex programming; only starts and ending can be chosen."""
    from rans_missions.bounds.landings import landing_table, landings

    assert isinstance(task, Land)
    command.refuse_all_but("spacecraft", "ending", "episodes", "start", "goal")
    # Solve, then fly the solutions in Drake.
    starts = command.sampled_starts(task, craft)
    folder = command.folder(craft, "propellant")
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
    # Files, and how many are solved.
    about = {
        "command": command.command_line(),
        "task": command.task,
        "spacecraft": craft.name,
        "ending": command.ending or "set",
        "seed": None if command.start else EVALUATION_SEED,
        "environment": environment(),
        "starts": [answer.to_json() for answer in answers],
    }
    write_json(folder / "optimal.json", about, beside=())
    Terminal().table(landing_table(title, answers))
    lost = sum(not answer.good for answer in answers)
    Terminal().say(
        f"{len(answers) - lost} of {len(answers)} solved and flown in Drake. Written to "
        f"{folder / 'optimal.json'}."
    )
    return 1 if lost else 0


RENDEZVOUS = Problem(bounded, add_bounds, solve=transfers)
"""The least impulse to a position near a target on an orbit, by a deadline."""
LANDING = Problem(bounded, add_bounds, ("optimal",), landings)
"""The least propellant of a landing."""
INSPECTION = Problem(bounded, add_bounds, ("circumnavigation", "optimal"))
"""A lower bound of the impulse of an inspection; no optimum is known."""
AMONG = Problem(bounded, add_bounds)
"""A lower bound of the impulse of a flight among keep-out zones, or to a port; optima are trajectories."""
APPROACH = Problem(bounded, add_bounds, ("corridor", "optimal"), transfers)
"""The least impulse of a flight through the corridor of a port."""
