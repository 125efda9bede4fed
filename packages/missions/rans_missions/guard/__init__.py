"""Safety filters between a policy and the effectors, which replace commands that would violate a constraint."""

from __future__ import annotations

from rans.episode import Guard
from rans.extend import ConfigError, Setup, positive, scenario
from rans_missions.guard.ahead import SLACK
from rans_missions.guard.backup import FlownBackup
from rans_missions.guard.expected import Expected
from rans_missions.guard.manoeuvres import check_throttles

__all__ = ["FlownBackup", "safety_filter"]


def safety_filter(setup: Setup, slack: float | None = None) -> Guard:
    """Safety filter for the spacecraft, task and conditions of a setup.

    It is a `FlownBackup`. Under conditions it keeps a reserve for noise, and flies the commands ahead that a delay
    has queued (`rans_missions.guard.expected.Expected`).

    Args:
        setup: spacecraft, task, timing and conditions.
        slack: least margin in the unit of each constraint, in place of that for noise; None: that for noise.

    >>> craft = rans.load_spacecraft("floating-platform")
    >>> safety_filter(Setup(craft, rans.load_task("avoid"))).name
    'flown backup'

    Raises:
        ConfigError: the task has no constraints, the filter cannot brake with the craft's throttles, or the slack
            is no finite number above 0.
    """
    task = setup.task
    name = type(task).__name__
    example = scenario(task, setup.craft.dimension, seed=0, episode=0)
    if not task.constraints(example.start, example.goal):
        raise ConfigError(
            f"a safety filter enforces the constraints of a task, but {name} has none; fly a mission such as "
            "avoid or dock-port, or define constraints in a task of your own."
        )
    if slack is not None:
        positive("the slack of a safety filter, in the unit of each constraint (m or m/s),", slack)
    # What noise and delays ask for, unless the user sets the slack.
    expected = Expected.of(setup)
    reserve = expected.reserve if slack is None else ()
    least = SLACK if slack is None else slack
    if setup.craft.actuators.kind == "throttle":
        check_throttles(setup.craft)
    return FlownBackup(slack=least, reserve=reserve, delay=expected.delay)
