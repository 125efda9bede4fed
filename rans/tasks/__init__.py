"""The tasks: what a spacecraft is asked to do. One line here enrols a task everywhere."""

from __future__ import annotations

from typing import Any

from rans.errors import ConfigError
from rans.tasks.base import SingleTask, Task, observation, observation_columns, observation_width
from rans.tasks.go_to_pose import GoToPose
from rans.tasks.go_to_position import GoToPosition
from rans.tasks.multi_task import MultiTask
from rans.tasks.rewards import Transition
from rans.tasks.track_twist import TrackTwist
from rans.tasks.track_velocity import TrackVelocity
from rans.tasks.track_velocity_heading import TrackVelocityHeading

TASKS: dict[str, type] = {
    "go-to-position": GoToPosition,
    "go-to-pose": GoToPose,
    "track-velocity": TrackVelocity,
    "track-twist": TrackTwist,
    "track-velocity-heading": TrackVelocityHeading,
    "multi-task": MultiTask,
}
"""Every task by the name the command line uses."""

GYMNASIUM_IDS: dict[str, tuple[str, str]] = {
    "go-to-position": ("rans/GoToXY-v0", "rans/GoToXYZ-v0"),
    "go-to-pose": ("rans/GoToPose2D-v0", "rans/GoToPose3D-v0"),
    "track-velocity": ("rans/TrackXYVelocity-v0", "rans/TrackXYZVelocity-v0"),
    "track-twist": ("rans/TrackXYOVelocity-v0", "rans/TrackXYZOVelocity-v0"),
    "track-velocity-heading": ("rans/TrackXYVelocityHeading-v0", "rans/TrackXYZVelocityAttitude-v0"),
    "multi-task": ("rans/MultiTask2D-v0", "rans/MultiTask3D-v0"),
}
"""Gymnasium ids of every task: (plane, space)."""


def task_class(name: str) -> type:
    """The task of this name.

    Raises:
        ConfigError: there is none.
    """
    if name not in TASKS:
        raise ConfigError(f"there is no task named {name!r}; known are {', '.join(sorted(TASKS))}.")
    return TASKS[name]


def parts(task: Task) -> dict[str, Task]:
    """What an agent is judged on, by name: the task, or each of those that a multi-task draws from."""
    if isinstance(task, MultiTask):
        return dict(task.parts())
    return {next(name for name, kind in TASKS.items() if isinstance(task, kind)): task}


def drawn(task: Task, goal: Any) -> Task:
    """The task that one goal, of numbers, belongs to: itself, or the part a multi-task drew."""
    if not isinstance(task, MultiTask):
        return task
    return next(part for part in task.parts().values() if part.flag == round(float(goal.flag)))


__all__ = [
    "GYMNASIUM_IDS", "TASKS", "GoToPose", "GoToPosition", "MultiTask", "SingleTask", "Task", "TrackTwist",
    "Transition",    "TrackVelocity", "TrackVelocityHeading", "drawn", "observation", "observation_columns",
    "observation_width", "parts", "task_class",
]
