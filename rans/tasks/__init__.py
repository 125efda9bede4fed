"""Tasks of a spacecraft. A line in `TASKS`, or an entry point, registers a task everywhere.

Names of this package are loaded on first use.
"""

from __future__ import annotations

import importlib
import re
from typing import TYPE_CHECKING, Any

from rans.base.lazy import homes
from rans.base.registry import Registry

if TYPE_CHECKING:
    from rans.tasks.base import SingleTask as SingleTask, Task as Task, observation as observation
    from rans.tasks.derived import (
        observation_columns as observation_columns,
        observation_width as observation_width,
    )
    from rans.tasks.go_to_attitude import GoToAttitude as GoToAttitude
    from rans.tasks.go_to_pose import GoToPose as GoToPose
    from rans.tasks.go_to_pose_priced import GoToPosePriced as GoToPosePriced
    from rans.tasks.go_to_position import GoToPosition as GoToPosition
    from rans.tasks.multi_task import MultiTask as MultiTask
    from rans.tasks.names import load_task as load_task, registered_name as registered_name
    from rans.tasks.rewards import RestReward as RestReward, Transition as Transition
    from rans.tasks.tracking import (
        TrackTwist as TrackTwist,
        TrackVelocity as TrackVelocity,
        TrackVelocityHeading as TrackVelocityHeading,
    )

_LAZY = homes(__file__)
"""Module of each name of this package, loaded on first use."""

TASKS: Registry[type[Any]] = Registry(
    "task",
    "rans.tasks",
    {
        "go-to-position": "rans.tasks.go_to_position:GoToPosition",
        "go-to-pose": "rans.tasks.go_to_pose:GoToPose",
        "go-to-attitude": "rans.tasks.go_to_attitude:GoToAttitude",
        "track-velocity": "rans.tasks.tracking:TrackVelocity",
        "track-twist": "rans.tasks.tracking:TrackTwist",
        "track-velocity-heading": "rans.tasks.tracking:TrackVelocityHeading",
        "multi-task": "rans.tasks.multi_task:MultiTask",
        "go-to-pose-priced": "rans.tasks.go_to_pose_priced:GoToPosePriced",
    },
    "rans.tasks.kind:checked",
)
"""Class of every task by its name on the command line."""

_PUBLISHED = {
    "go-to-position": ("GoToXY", "GoToXYZ"),
    "track-velocity": ("TrackXYVelocity", "TrackXYZVelocity"),
    "track-twist": ("TrackXYOVelocity", "TrackXYZOVelocity"),
    "track-velocity-heading": ("TrackXYVelocityHeading", "TrackXYZVelocityAttitude"),
}
"""Names of papers for tasks in the plane and in space, where they differ from NAME2D and NAME3D."""


_PLACES: dict[str, tuple[int, ...]] = {"plane": (2,), "space": (3,)}
"""Dimensions of tasks of packages, by the groups of entry points rans.tasks.plane and rans.tasks.space."""


def gymnasium_ids(name: str) -> dict[int, str]:
    """Gymnasium ids of a task by its dimensions, 2 in the plane and 3 in space, without loading it.

    Those of "my-task" are "rans/MyTask2D-v0" and "rans/MyTask3D-v0". A package whose task flies in space alone has
    its entry point in the group ``rans.tasks.space``, of the plane alone in ``rans.tasks.plane``.

    >>> rans.tasks.gymnasium_ids("go-to-attitude")
    {3: 'rans/GoToAttitude3D-v0'}
    """
    base = "".join(word[:1].upper() + word[1:] for word in re.split(r"\W+", name))
    ids = _PUBLISHED.get(name, (f"{base}2D", f"{base}3D"))
    if name in TASKS.own:
        from rans.tasks.derived import dimensions

        works: tuple[int, ...] = dimensions(TASKS.own[name]())
    else:
        works = _PLACES.get("space" if name == "go-to-attitude" else TASKS.subgroup(name), (2, 3))
    return {dimension: f"rans/{ids[dimension - 2]}-v0" for dimension in works}


def __getattr__(name: str) -> Any:
    if name in _LAZY:
        return getattr(importlib.import_module(_LAZY[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


__all__ = [*_LAZY, "TASKS", "gymnasium_ids"]
