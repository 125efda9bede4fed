"""What a user may do next with a spacecraft: commands of which it can do what they ask."""

from __future__ import annotations

import shlex

from rans.errors import ConfigError
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from rans.pretrained import FOR_ANY_CRAFT
from rans.tasks.feasible import fitting_task


def with_spacecraft(craft: Spacecraft, name: str) -> tuple[str, ...]:
    """A flight without training and a training, both of a task that suits the spacecraft.

    Args:
        craft: the spacecraft.
        name: its name, or its TOML file.
    """
    task = fitting_task(craft)
    pilot = FOR_ANY_CRAFT[craft.dimension]
    if task != "go-to-pose" or not _is_flown_without_training(craft):
        pilot = f"lqr:{task}-{craft.dimension}d"
    flight = [shlex.join(["rans", "evaluate", f"{pilot}@{name}"])] if task else []
    return *flight, *training(craft, name)


def training(craft: Spacecraft, name: str, *options: str) -> tuple[str]:
    """A training with a spacecraft, by its name or TOML file, of a task that suits it; else the list of tasks.

    A mission may be made for a craft that no other task suits.
    """
    task = fitting_task(craft)
    if task is None:
        return ("rans list TASKS",)
    return (shlex.join(["rans", "train", task, "--spacecraft", name, *options]),)


def _is_flown_without_training(craft: Spacecraft) -> bool:
    """Whether the agent for any craft can steer it."""
    from rans.policy.timing import timing_for

    try:
        timing_for(craft, Timing())
    except ConfigError:
        return False
    return True
