"""Objectives, craft and tasks of optimal trajectories; all others are refused with a sentence."""

from __future__ import annotations

from typing import Literal

from rans.control.allocation import check_aims
from rans.extend import ConfigError, Spacecraft, Task, aims, counted

ObjectiveName = Literal["fuel", "time", "energy", "reward"]
"""What an optimal trajectory minimizes, see `rans_optimal.objectives`."""


def check_craft(craft: Spacecraft) -> None:
    """Refuse a craft for which optimal control has no equations yet.

    Raises:
        ConfigError: it has effectors besides thrusters, propellant, or throttles that are shut below a least level.
    """
    if craft.acting_effectors or craft.wheels or not craft.is_rigid:
        kinds = " and ".join(effector.label for effector in craft.further_effectors)
        wheels = counted(craft.wheel_count, "reaction wheel")
        others = wheels if craft.wheels else f"effectors of other kinds ({kinds})"
        raise ConfigError(
            f"optimal trajectories command thrusters alone, but {craft.name!r} has {others}: LQR, switching and "
            "MPC fly reaction wheels too, and agents fly every kind."
        )
    if craft.propellant is not None:
        raise ConfigError(
            f"optimal trajectories are those of a constant mass, but {craft.name!r} uses propellant: take "
            "[propellant] out of its file for what its full mass could do. Controllers fly it as it is."
        )
    actuators = craft.actuators
    if (
        actuators.low == 0.0
        and getattr(actuators, "least", 0.0) > 0.0
        and actuators.kind == "throttle"
    ):
        raise ConfigError(
            f"the thrusters of {craft.name!r} are shut or give a least level, and optimal trajectories "
            "have commands without gaps: set always_lit = true, or least = 0 for a bound."
        )


def check_task(craft: Spacecraft, task: Task) -> None:
    """Refuse a task that the craft cannot do, or whose goal at a later time is not known beforehand.

    Raises:
        ConfigError: see `check_goal`; or nothing gives the craft a force or torque that the task asks for; or the
            task's drift is another one at other times.
    """
    check_aims(craft, task)
    check_goal(task)
    if not task.drift.steady:
        raise ConfigError(
            "a trajectory is computed for a drift that is the same at all times, and "
            f"{task.drift.name} changes along the orbit."
        )


def check_goal(task: Task) -> None:
    """Refuse a task whose goal at a later time is not known beforehand, or that has none of its own.

    Raises:
        ConfigError: it is a multi-task; or its goal remembers what the spacecraft did (`Task.remember`), so that
            it depends on the trajectory that is looked for.
    """
    aims(task)
    name = type(task).__name__
    if type(task).remember is not Task.remember:
        raise ConfigError(
            f"optimal trajectories are for goals that are known beforehand, and {name} remembers what the "
            "spacecraft did (`remember`)."
        )


def moves_goal(task: Task) -> bool:
    """Whether the goal of a task may be elsewhere later: it has a `Task.later` of its own."""
    return type(task).later is not Task.later
