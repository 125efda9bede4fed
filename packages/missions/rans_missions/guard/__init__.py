"""Safety filters between a policy and the effectors, which replace commands that would violate a constraint."""

from __future__ import annotations

import math

from rans.episode import Guard
from rans.extend import ClohessyWiltshire, ConfigError, Setup, brief, is_finite, positive, scenario
from rans_missions.guard.ahead import SLACK
from rans_missions.guard.backup import FlownBackup
from rans_missions.guard.expected import Expected
from rans_missions.guard.manoeuvres import check_throttles
from rans_missions.guard.safe_coasts import SafeCoasts
from rans_missions.passive_safety import coast_zone

__all__ = ["FlownBackup", "SafeCoasts", "safety_filter"]


def safety_filter(
    setup: Setup, slack: float | None = None, safe_coasts: bool | float = False
) -> Guard:
    """Safety filter for the spacecraft, task and conditions of a setup.

    It is a `FlownBackup`. Under conditions it keeps a reserve for noise, and flies the commands ahead that a delay
    has queued (`rans_missions.guard.expected.Expected`).

    Args:
        setup: spacecraft, task, timing and conditions.
        slack: least margin in the unit of each constraint, in place of that for noise; None: that for noise.
        safe_coasts: whether it is a `SafeCoasts` around that filter: if all thrusters shut at any instant, the
            coast of the next orbit, or of a time in s, keeps out of `rans_missions.passive_safety.coast_zone`.

    >>> craft = rans.load_spacecraft("floating-platform")
    >>> safety_filter(Setup(craft, rans.load_task("avoid"))).name
    'flown backup'

    Raises:
        ConfigError: the task has no constraints, the filter cannot brake with the craft's throttles, the slack or
            the time of a coast is no finite number above 0, or coasts are to be safe, and the task has no zone for
            them.
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
    if not (isinstance(safe_coasts, bool) or (is_finite(safe_coasts) and safe_coasts > 0.0)):
        raise ConfigError(
            "safe_coasts must be True (coasts of an orbit), False, or the time of a coast, a finite number of s "
            f"above 0, got {brief(safe_coasts)}."
        )
    # What noise and delays ask for, unless the user sets the slack.
    expected = Expected.of(setup)
    reserve = expected.reserve if slack is None else ()
    least = SLACK if slack is None else slack
    if setup.craft.actuators.kind == "throttle":
        check_throttles(setup.craft)
    result = FlownBackup(slack=least, reserve=reserve, delay=expected.delay)
    if not safe_coasts:
        return result
    zone, drift = coast_zone(task), task.drift
    if zone is None or not isinstance(drift, ClohessyWiltshire) or setup.craft.dimension != 3:
        raise ConfigError(
            f"coasts are filtered in missions in space on a circular orbit, such as hold, and {name} is not one."
        )
    orbit = 2.0 * math.pi / drift.mean_motion
    seconds = orbit if safe_coasts is True else safe_coasts
    return SafeCoasts(result, zone, drift.mean_motion, seconds)
