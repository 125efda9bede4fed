"""Safety filters between a policy and the effectors, which replace commands that would violate a constraint."""

from __future__ import annotations

from rans.episode import Guard, Setup
from rans.errors import ConfigError
from rans.guard.backup import FlownBackup
from rans.guard.barrier import BarrierProgram, check_throttles
from rans.scenario import scenario

__all__ = ["BarrierProgram", "FlownBackup", "safety_filter"]


def safety_filter(setup: Setup) -> Guard:
    """Safety filter with default settings for the spacecraft and task of a setup.

    It is a `BarrierProgram` for throttles, and a `FlownBackup` for on/off and pulsed thrusters.

    >>> craft = rans.load_spacecraft("floating-platform")
    >>> safety_filter(Setup(craft, rans.load_task("avoid"))).name
    'flown backup'

    Raises:
        ConfigError: the task has no constraints, or the filter cannot brake with the craft's throttles.
    """
    task = setup.task
    name = type(task).__name__
    one = scenario(task, setup.craft.dimension, seed=0, episode=0)
    if not task.constraints(one.start, one.goal):
        raise ConfigError(
            f"a safety filter enforces the constraints of a task, but {name} has none; fly a mission such as "
            "avoid or dock-port, or define constraints in a task of your own."
        )
    if setup.craft.actuators.kind == "throttle":
        check_throttles(setup.craft)
        return BarrierProgram()
    return FlownBackup()
