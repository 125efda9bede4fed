"""Protocols of evaluation: spacecraft, starts and length of the episodes."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any, get_args

from rans.base.choices import ProtocolName
from rans.base.errors import ConfigError, one_of
from rans.episode.step import Setup
from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import SPACECRAFT
from rans.model.timing import Timing
from rans.tasks import Task

_SPACECRAFT: dict[ProtocolName, str] = {
    "paper": "floating-platform",
    "original": "floating-platform-shared",
}
_STEPS = 250
"""50 s at 5 Hz (original system's evaluations)."""
_START = (3.0, 4.0)
"""Distance of the starts, m (paper, section 4.1)."""


def under_protocol(protocol: ProtocolName, own: Setup) -> Setup:
    """Setup of a protocol, from a contestant's own setup.

    "own" changes nothing. "paper" is the floating platform of 5.32 kg with 1 N a thruster, 250 steps of
    0.2 s and, where a task starts away from its goal, starts 3 to 4 m away (paper, section 4.1).
    "original" is the same with a total thrust of 1 N that the open thrusters share, as the published
    code of the original system has it.

    Raises:
        ConfigError: the protocol is "paper" or "original", and the craft is not planar with eight thrusters.
    """
    one_of("protocol", protocol, get_args(ProtocolName))
    if protocol == "own":
        return own
    craft = SPACECRAFT[_SPACECRAFT[protocol]].craft
    if (own.craft.dimension, own.craft.command_count) != (craft.dimension, craft.command_count):
        raise ConfigError(
            f"--protocol {protocol} is for planar spacecraft with {craft.thruster_count} "
            f"thrusters, but {own.craft.name} is another kind; use --protocol own."
        )
    return Setup(craft, _started_away(own.task), replace(Timing(), episode_steps=_STEPS))


def fitting_protocols(craft: Spacecraft) -> tuple[ProtocolName, ...]:
    """Protocols for a spacecraft: "own", and those whose spacecraft it can replace."""
    return ("own", *(name for name, craft_name in _SPACECRAFT.items() if craft_name == craft.name))


def _started_away(task: Any) -> Task:
    names = {field.name for field in fields(task)}
    return replace(task, evaluation_distance=_START) if "evaluation_distance" in names else task
