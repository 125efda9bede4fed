"""What a spacecraft or a controller cannot do that its task or its conditions ask for."""

from __future__ import annotations

import warnings

from rans.base.errors import ConfigError, RansWarning
from rans.model.pace import seconds_for_a_metre, seconds_for_half_a_turn
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from rans.tasks.base import SingleTask, Task
from rans.tasks.go_to_attitude import GoToAttitude
from rans.tasks.go_to_pose import GoToPose
from rans.tasks.go_to_position import GoToPosition


def obstacles(craft: Spacecraft, task: Task, timing: Timing) -> list[str]:
    """Reasons for which no controller can solve a task, each as a sentence; empty if none is known.

    The length of an episode is the larger of that of the timing and of the task's own, since short episodes may be
    meant.
    """
    if (
        craft.actuators.low > 0.0
    ):  # engines that cannot be shut turn and push with the rest of their range
        return []
    result = []
    own = task.timing
    episode = max(source.control_period * source.episode_steps for source in (timing, own))
    name = f"spacecraft {craft.name!r}"
    parts = task.parts().values()
    asked = sorted({name for part in parts for name in part.tolerances()})
    if not craft.thrusters:
        if moves := [name for name in asked if name in ("position", "velocity")]:
            result.append(
                f"{name} has no thruster, and {type(task).__name__} asks for a {moves[0]}: wheels turn a craft and "
                "cannot push it. Fly go-to-attitude"
            )
    elif (metre := seconds_for_a_metre(craft)) > episode:
        result.append(
            f"{name} needs at least {metre:.3g} s for 1 m from rest to rest, and an episode has {episode:g} s: the "
            "usual cause is a mass in g or forces in kN, where RANS takes kg and N"
        )
    if "attitude" not in asked:
        return result
    if not craft.can_turn:
        result.append(
            f"{name} cannot turn: all of its thrusters push through its centre of mass, and {type(task).__name__} "
            "asks for an attitude; the usual cause is a direction that was copied from the position"
        )
    elif (turn := seconds_for_half_a_turn(craft)) > episode:
        result.append(
            f"{name} needs at least {turn:.3g} s for half a turn from rest to rest, and an episode has "
            f"{episode:g} s: the usual cause is an inertia in kg mm^2 or forces in kN, where RANS takes kg m^2 "
            "and N"
        )
    return result


def fitting_task(craft: Spacecraft) -> str | None:
    """Name of the first of go-to-pose, go-to-position and go-to-attitude without `obstacles`; None: there is none.

    A craft that cannot be steered, such as a lander that only pushes downwards, has none.
    """
    if not craft.is_steerable:
        return None
    tasks: dict[str, SingleTask] = {
        "go-to-pose": GoToPose(),
        "go-to-position": GoToPosition(),
        "go-to-attitude": GoToAttitude(),
    }
    return next((name for name, x in tasks.items() if not obstacles(craft, x, x.timing)), None)


def warn_of_obstacles(craft: Spacecraft, task: Task, timing: Timing) -> None:
    """Warn of each of the `obstacles`."""
    for obstacle in obstacles(craft, task, timing):
        warnings.warn(f"{obstacle}.", RansWarning, stacklevel=3)


def check_feasible(craft: Spacecraft, task: Task, timing: Timing) -> None:
    """Refuse a training that can solve nothing.

    Raises:
        ConfigError: there are `obstacles`; the message is the first one.
    """
    for obstacle in obstacles(craft, task, timing):
        raise ConfigError(f"{obstacle}. Nothing is trained.")
