"""RANS trains agents that control thruster-driven spacecraft, and verifies their performance.

    >>> agent = rans.load_agent("go-to-pose-2d")
    >>> rans.evaluate(agent, episodes=64)["solved"].value
    100.0

Importing the package registers the Gymnasium environments of `rans.tasks.gymnasium_ids`, and for each a variant
that Drake simulates, such as "rans/GoToPose2D-Drake-v0". `TASKS.register` adds those of a task of your own. Every
other name is loaded on first use.
"""

import rans.base.safe_path  # noqa: F401  # must come first, see its docstring

# isort: split
import importlib
import sys
from typing import TYPE_CHECKING, Any

import gymnasium

from rans.base import display, errors
from rans.base.abilities import PUBLIC
from rans.base.lazy import homes
from rans.tasks import TASKS, gymnasium_ids

if TYPE_CHECKING:
    from rans.api.agent import Agent as Agent, load_agent as load_agent
    from rans.api.drafting import init_spacecraft as init_spacecraft
    from rans.api.flying import fly as fly
    from rans.api.judging import compare as compare, evaluate as evaluate
    from rans.api.names import (
        load_conditions as load_conditions,
        load_spacecraft as load_spacecraft,
        load_task as load_task,
    )
    from rans.api.pages import export as export, report as report, view as view
    from rans.api.states import state as state
    from rans.api.training import train as train, tune as tune
    from rans.base.errors import (
        ConfigError as ConfigError,
        RansError as RansError,
        RansWarning as RansWarning,
    )
    from rans.base.executors import run_on as run_on
    from rans.base.registry import trust_files as trust_files
    from rans.control.lqr import LQR as LQR
    from rans.control.switching import Switching as Switching
    from rans.episode.scenario import scenarios as scenarios
    from rans.evaluation.fly.pilot import Pilot as Pilot
    from rans.fast.engine import Engine as Engine
    from rans.fast.envs.single import SpacecraftEnv as SpacecraftEnv
    from rans.fast.envs.vector import SpacecraftVectorEnv as SpacecraftVectorEnv
    from rans.fast.learn.config import PPOSettings as PPOSettings
    from rans.model.spacecraft import Spacecraft as Spacecraft, Thruster as Thruster
    from rans.model.timing import Timing as Timing
    from rans.randomization.conditions import (
        BodyConditions as BodyConditions,
        Conditions as Conditions,
        DisturbanceConditions as DisturbanceConditions,
        FaultConditions as FaultConditions,
        SensorConditions as SensorConditions,
        SensorsConditions as SensorsConditions,
        ThrusterConditions as ThrusterConditions,
    )
    from rans.tasks import (
        GoToAttitude as GoToAttitude,
        GoToPose as GoToPose,
        GoToPosePriced as GoToPosePriced,
        GoToPosition as GoToPosition,
        MultiTask as MultiTask,
        RestReward as RestReward,
        TrackTwist as TrackTwist,
        TrackVelocity as TrackVelocity,
        TrackVelocityHeading as TrackVelocityHeading,
    )

    __version__: str

_LAZY = homes(__file__)
"""Module of each public name, loaded on first use."""

__all__ = [*_LAZY, "TASKS", "__version__"]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from rans.base.files import package_version

        return package_version("rans")
    try:
        if name in _LAZY:
            return getattr(importlib.import_module(_LAZY[name]), name)
        if not name.startswith("_") and name in PUBLIC:  # notebooks ask for names such as __path__
            return PUBLIC[name]
    except errors.ConfigError as error:  # such as a package that is missing
        if sys._getframe(1).f_code.co_name == "_handle_fromlist":
            raise  # `from rans import NAME` would drop the sentence of an AttributeError
        raise AttributeError(str(error), name=name) from error
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*__all__, *PUBLIC})


def _as_html(value: Any) -> str:
    """HTML of a value for a notebook; the renderer is imported at the first call."""
    from rans.show.pages.notebook import html_of

    return html_of(value)


def _as_figure(flight: Any, episode: int) -> Any:
    """Figure of an episode of a flight; matplotlib is imported at the first call."""
    from rans.show.figures.figures import episode_figure

    return episode_figure(flight, episode)


display.html_renderer = _as_html
display.figure_maker = _as_figure


_REWARD_THRESHOLDS = {
    "rans/GoToXY-v0": 175.0,
    "rans/GoToXYZ-v0": 205.0,
    "rans/GoToPose2D-v0": 310.0,
    "rans/GoToPose3D-v0": 300.0,
    "rans/TrackXYVelocity-v0": 275.0,
    "rans/TrackXYZVelocity-v0": 265.0,
    "rans/TrackXYVelocityHeading-v0": 325.0,
    "rans/TrackXYZVelocityAttitude-v0": 310.0,
}
"""95 % of the mean return of the agent that comes with RANS, over 256 starts, rounded down to a multiple of 5.
Missions have none: `info["is_success"]` says whether an episode succeeded. For other tasks `info["at_goal"]` is of
the last state alone, while a task is solved by the whole last fifth of a flight."""


def _enrol(task_name: str) -> None:
    """Register the Gymnasium environments of a task, which is loaded when the first is made.

    Gymnasium has had no plug-in mechanism since 1.0.
    """
    for dimension, gymnasium_id in gymnasium_ids(task_name).items():
        kwargs = {"task_name": task_name, "dimension": dimension}
        registered = gymnasium.registry.get(gymnasium_id)
        if registered is not None and registered.kwargs == kwargs:
            continue  # a notebook cell was run again
        threshold = _REWARD_THRESHOLDS.get(gymnasium_id)
        gymnasium.register(
            gymnasium_id,
            "rans.fast.envs.single:SpacecraftEnv",
            reward_threshold=threshold,
            kwargs=kwargs,
            vector_entry_point="rans.fast.envs.vector:SpacecraftVectorEnv",
        )
        gymnasium.register(
            gymnasium_id.replace("-v", "-Drake-v"),
            "rans.reference.flight:DrakeEnv",
            reward_threshold=threshold,
            kwargs=kwargs,
        )


for _task_name in TASKS:
    _enrol(_task_name)
TASKS.announce = _enrol
