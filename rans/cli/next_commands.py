"""What a user may do next with a spacecraft: commands of which it can do what they ask."""

from __future__ import annotations

import shlex

from rans.model.spacecraft import Spacecraft, controls_every_direction
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
    # Controllers command thrusters and reaction wheels alone.
    is_flown = task and craft.command_count == craft.thruster_count + craft.wheel_count
    flight = [shlex.join(["rans", "evaluate", f"{pilot}@{name}"])] if is_flown else []
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
    """Whether the agent for any craft can steer it, by what `rans.policy.any_craft.authority` asks for.

    It is asked here without the network, which a list need not load.
    """
    is_open_or_shut = (craft.actuators.low, craft.actuators.high) == (0.0, 1.0)
    return is_open_or_shut and not craft.acting_effectors and controls_every_direction(craft)
