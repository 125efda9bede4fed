"""What a user may do next: with a result, by the table `NEXT`, and with a spacecraft, what it can do."""

from __future__ import annotations

import shlex
from dataclasses import fields
from typing import Any, cast

from rans.base.pretrained import FOR_ANY_CRAFT
from rans.cli.commands import COMMANDS
from rans.cli.door import Options
from rans.model.spacecraft import Spacecraft
from rans.tasks.feasible import fitting_task

NEXT = {
    "evaluate": ("evaluate --full", "compare", "view"),
    "compare": ("compare --full", "view", "stress"),
    "view": ("compare",),
}
"""Commands that follow the flights of a command; the same one again prints more."""
_OF_ITSELF = {"episodes", "output", "full", "seconds", "period"}
"""Options that suit the command that has them, and are left out of others."""


_NOT_REPEATED = {"agent", "contestants", "trust"}
"""Words, and what `rans.cli.next_of` adds."""


def after(command: Options, name: str, *contestants: str) -> tuple[str, ...]:
    """Commands that follow a command about the same contestants, with its options as far as they have them.

    Args:
        command: what has run.
        name: its name.
        *contestants: whom it flew; commands but for the same one are about the first.
    """
    own = {field.name for field in fields(command)}
    lines = []
    for line in NEXT[name]:
        other, *more = line.split()
        again = other == name
        if again and command.full:
            continue
        # A command of a package that is not installed is named without options.
        known = other in COMMANDS
        theirs = {field.name for field in fields(cast(Any, COMMANDS[other]))} if known else set()
        same = (own & theirs) - _NOT_REPEATED - ({"full"} if again else _OF_ITSELF)
        if getattr(command, "engine", "") == "both" and not again:
            same -= {"engine"}
        who = contestants if again else contestants[:1]
        options = command.changed(*(field.name for field in fields(command) if field.name in same))
        lines.append(shlex.join(["rans", other, *who, *options, *more]))
    return tuple(lines)


def with_spacecraft(craft: Spacecraft, name: str, *options: str) -> tuple[str, ...]:
    """A flight without training, a comparison and a training, all of a task that suits the spacecraft.

    Args:
        craft: the spacecraft.
        name: its name, or its TOML file.
        *options: further words of each.
    """
    task = fitting_task(craft)
    pilot = FOR_ANY_CRAFT[craft.dimension]
    if task != "go-to-pose" or not _is_flown_without_training(craft):
        pilot = f"lqr:{task}-{craft.dimension}d"
    # Controllers command thrusters and reaction wheels alone.
    is_flown = task and craft.command_count == craft.thruster_count + craft.wheel_count
    flight = (
        [
            shlex.join(["rans", word, f"{pilot}@{name}", *options])
            for word in ("evaluate", "compare")
        ]
        if is_flown
        else []
    )
    return *flight, *training(craft, name, *options)


def training(craft: Spacecraft, name: str, *options: str) -> tuple[str]:
    """A training with a spacecraft, by its name or TOML file, of a task that suits it; else the list of tasks.

    A mission may be made for a craft that no other task suits.
    """
    task = fitting_task(craft)
    if task is None:
        return ("rans list TASKS",)
    return (shlex.join(["rans", "train", task, "--spacecraft", name, *options]),)


def _is_flown_without_training(craft: Spacecraft) -> bool:
    """Whether the agent for any craft can steer it, by what its backbone asks for.

    It is asked here without the network, which a list need not load.
    """
    is_open_or_shut = (craft.actuators.low, craft.actuators.high) == (0.0, 1.0)
    return is_open_or_shut and not craft.acting_effectors and craft.controls_every_direction
