"""RANS trains agents that control thruster-driven spacecraft, and verifies their performance.

    >>> agent = rans.load_agent("go-to-pose-2d")
    >>> rans.evaluate(agent, episodes=64)["solved"].value
    100.0

Importing the package registers the Gymnasium environments of `rans.tasks.gymnasium_ids`, and for each a variant
that Drake simulates, such as "rans/GoToPose2D-Drake-v0". `TASKS.register` adds those of a task of your own. Every
other name is loaded on first use.
"""

import rans.safe_path  # noqa: F401  # must come first, see its docstring

# isort: split
import importlib
import importlib.util
from typing import TYPE_CHECKING, Any

import gymnasium

from rans import display
from rans.abilities import PUBLIC, sentence_of_absent
from rans.tasks import TASKS, gymnasium_ids

if TYPE_CHECKING:
    from rans.api.agent import Agent, load_agent
    from rans.api.drafting import (
        init_spacecraft,
        join_at_contact,
        join_spacecraft,
        part,
    )
    from rans.api.flying import fly
    from rans.api.judging import benchmark, compare, evaluate, validate
    from rans.api.limits import certify, optimal_trajectory, state
    from rans.api.names import load_conditions, load_spacecraft, load_task
    from rans.api.pages import export, report, view
    from rans.api.training import sweep, train, tune
    from rans.errors import (
        ConfigError,
        RansError,
        RansWarning,
    )
    from rans.evaluation.fly.pilot import Pilot
    from rans.executors import run_on
    from rans.fast.engine import Engine
    from rans.fast.envs.sb3 import SB3VecEnv
    from rans.fast.envs.single import SpacecraftEnv
    from rans.fast.envs.vector import SpacecraftVectorEnv
    from rans.fast.learn.config import (
        PPOSettings,
    )
    from rans.fast.learn.front import PPO
    from rans.model.spacecraft import Spacecraft, Thruster
    from rans.model.timing import Timing
    from rans.optimal.control.lqr import LQR
    from rans.optimal.control.mpc import MPC
    from rans.optimal.control.switching import Switching
    from rans.randomization.conditions import (
        BodyConditions,
        Conditions,
        DisturbanceConditions,
        FaultConditions,
        SensorConditions,
        SensorsConditions,
        ThrusterConditions,
    )
    from rans.registry import trust_files
    from rans.tasks import (
        GoToAttitude,
        GoToPose,
        GoToPosePriced,
        GoToPosition,
        MultiTask,
        RestReward,
        TrackTwist,
        TrackVelocity,
        TrackVelocityHeading,
    )

    __version__: str

_LAZY = {
    "train": "rans.api.training",
    "sweep": "rans.api.training",
    "tune": "rans.api.training",
    "load_agent": "rans.api.agent",
    "Agent": "rans.api.agent",
    "evaluate": "rans.api.judging",
    "compare": "rans.api.judging",
    "init_spacecraft": "rans.api.drafting",
    "join_spacecraft": "rans.api.drafting",
    "join_at_contact": "rans.api.drafting",
    "part": "rans.api.drafting",
    "validate": "rans.api.judging",
    "benchmark": "rans.api.judging",
    "view": "rans.api.pages",
    "report": "rans.api.pages",
    "export": "rans.api.pages",
    "optimal_trajectory": "rans.api.limits",
    "certify": "rans.api.limits",
    "state": "rans.api.limits",
    "Spacecraft": "rans.model.spacecraft",
    "Thruster": "rans.model.spacecraft",
    "load_spacecraft": "rans.api.names",
    "GoToAttitude": "rans.tasks",
    "GoToPose": "rans.tasks",
    "GoToPosePriced": "rans.tasks",
    "GoToPosition": "rans.tasks",
    "TrackVelocity": "rans.tasks",
    "TrackTwist": "rans.tasks",
    "TrackVelocityHeading": "rans.tasks",
    "MultiTask": "rans.tasks",
    "RestReward": "rans.tasks",
    "load_task": "rans.api.names",
    "Conditions": "rans.randomization.conditions",
    "BodyConditions": "rans.randomization.conditions",
    "ThrusterConditions": "rans.randomization.conditions",
    "FaultConditions": "rans.randomization.conditions",
    "DisturbanceConditions": "rans.randomization.conditions",
    "SensorConditions": "rans.randomization.conditions",
    "SensorsConditions": "rans.randomization.conditions",
    "load_conditions": "rans.api.names",
    "LQR": "rans.optimal.control.lqr",
    "Switching": "rans.optimal.control.switching",
    "MPC": "rans.optimal.control.mpc",
    "Pilot": "rans.evaluation.fly.pilot",
    "Timing": "rans.model.timing",
    "fly": "rans.api.flying",
    "trust_files": "rans.registry",
    "run_on": "rans.executors",
    "Engine": "rans.fast.engine",
    "PPO": "rans.fast.learn.front",
    "PPOSettings": "rans.fast.learn.config",
    "SB3VecEnv": "rans.fast.envs.sb3",
    "SpacecraftEnv": "rans.fast.envs.single",
    "SpacecraftVectorEnv": "rans.fast.envs.vector",
    "ConfigError": "rans.errors",
    "RansError": "rans.errors",
    "RansWarning": "rans.errors",
}
"""Module of each public name, loaded on first use."""

__all__ = [
    "train",
    "sweep",
    "tune",
    "load_agent",
    "Agent",
    "evaluate",
    "compare",
    "init_spacecraft",
    "join_spacecraft",
    "join_at_contact",
    "part",
    "validate",
    "benchmark",
    "view",
    "report",
    "export",
    "optimal_trajectory",
    "certify",
    "state",
    "Spacecraft",
    "Thruster",
    "load_spacecraft",
    "TASKS",
    "GoToAttitude",
    "GoToPose",
    "GoToPosePriced",
    "GoToPosition",
    "TrackVelocity",
    "TrackTwist",
    "TrackVelocityHeading",
    "MultiTask",
    "RestReward",
    "load_task",
    "Conditions",
    "BodyConditions",
    "ThrusterConditions",
    "FaultConditions",
    "DisturbanceConditions",
    "SensorConditions",
    "SensorsConditions",
    "load_conditions",
    "LQR",
    "Switching",
    "MPC",
    "Pilot",
    "Timing",
    "fly",
    "trust_files",
    "run_on",
    "Engine",
    "PPO",
    "PPOSettings",
    "SB3VecEnv",
    "SpacecraftEnv",
    "SpacecraftVectorEnv",
    "ConfigError",
    "RansError",
    "RansWarning",
    "__version__",
]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from rans.files import package_version

        return package_version("rans")
    if name in _LAZY:
        return getattr(importlib.import_module(_LAZY[name]), name)
    if not name.startswith("_") and importlib.util.find_spec(f"{__name__}.{name}"):
        return importlib.import_module(f"{__name__}.{name}")  # rans.scenario.scenarios(...)
    if name.startswith("_"):  # Python and notebooks ask for names such as __path__
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    if name in PUBLIC:
        return PUBLIC[name]
    raise AttributeError(
        sentence_of_absent(name, f"rans.{name}") or f"module {__name__!r} has no attribute {name!r}"
    )


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
Missions have none: `info["is_success"]` says whether an episode succeeded."""


def _enrol(task_name: str) -> None:
    """Register the Gymnasium environments of a task, which is loaded when the first is made.

    Gymnasium has had no plug-in mechanism since 1.0. Making one refuses a dimension that the task does not have.
    """
    for dimension, gymnasium_id in zip((2, 3), gymnasium_ids(task_name), strict=True):
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
