"""Timing of a task for the craft of a user's file.

Every contestant for such a craft flies by it: the agent for any craft, others and controllers.
"""

from __future__ import annotations

import math
from dataclasses import replace

from rans.base.errors import ConfigError
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from rans.policy.backbones import any_craft
from rans.tasks import Task
from rans.tasks.derived import layout

_LONGEST = 120.0
"""Longest episode of a craft of a file, s, for other contestants than the agent for any craft, whose slowest craft
in training needs 99 s. A slower one is rather in other units (`rans.tasks.feasible`)."""


def timing_of_file(
    craft: Spacecraft, task: Task, named: str, period: float | None = None
) -> Timing:
    """Timing of a task for the craft of a user's file, for every contestant; for other craft that of the task.

    Args:
        craft: what flies.
        task: what it does; where this is to fly to a pose, craft of files have a timing of their own.
        named: name of the craft as the user gave it, which of a file ends in ".toml".
        period: control period, s; None: chosen for the craft, or that of the task.
    """
    own = task.timing
    if named.endswith(".toml") and flies_to_a_pose(task, craft):
        try:
            chosen = any_craft().timing(craft, own, period)
        except ConfigError:  # other contestants may fly what the agent for any craft cannot
            chosen = own
        if chosen.episode_steps * chosen.control_period <= _LONGEST:
            own = chosen
    if period is None or own.control_period == period:
        return own
    length = own.episode_steps * own.control_period
    steps = math.ceil(length / period - 1e-9) if period > 0.0 else own.episode_steps
    return replace(own, control_period=period, episode_steps=steps)


def flies_to_a_pose(task: Task, craft: Spacecraft) -> bool:
    """Whether the agent for any craft of this dimension flies the task: it observes what it needs, and rests."""
    asked = {name for part in task.parts().values() for name in part.tolerances()}
    if asked != {"position", "attitude"}:
        return False
    return any_craft().observes(layout(task, craft.dimension))
