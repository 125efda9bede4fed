"""Safety filters between a policy and the effectors, which replace commands that would violate a constraint."""

from __future__ import annotations

from rans.extend import ConfigError, Guard, Setup, scenario
from rans_missions.guard.backup import FlownBackup
from rans_missions.guard.expected import Expected
from rans_missions.guard.manoeuvres import check_throttles

__all__ = ["FlownBackup", "safety_filter"]


def safety_filter(setup: Setup) -> Guard:
    """Safety filter for the spacecraft, task and conditions of a setup.

    It is a `FlownBackup`. Under conditions it keeps a reserve for noise, and flies the commands ahead that a delay
    has queued (`rans_missions.guard.expected.Expected`).

    >>> craft = rans.load_spacecraft("floating-platform")
    >>> safety_filter(Setup(craft, rans.load_task("avoid"))).name
    'flown backup'

    Raises:
        ConfigError: the task has no constraints, or the filter cannot brake with the craft's throttles.
    """
    task = setup.task
    name = type(task).__name__
    example = scenario(task, setup.craft.dimension, seed=0, episode=0)
    if not task.constraints(example.start, example.goal):
        raise ConfigError(
            f"a safety filter enforces the constraints of a task, but {name} has none; fly a mission such as "
            "avoid or dock-port, or define constraints in a task of your own."
        )
    expected = Expected.of(setup)
    if setup.craft.actuators.kind == "throttle":
        check_throttles(setup.craft)
    return FlownBackup(reserve=expected.reserve, delay=expected.delay)
