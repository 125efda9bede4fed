"""RANS trains agents that fly thruster-driven spacecraft, and proves what they are worth.

Importing it registers the Gymnasium environments of `rans.tasks.gymnasium_ids`, each also as moved by
Drake: "rans/GoToPose2D-Drake-v0". What needs torch or Drake is loaded when first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import gymnasium

from rans import fast
from rans.errors import ConfigError, NonFiniteState, RansError, SolverFailed
from rans.model.conditions import Conditions
from rans.model.conditions_file import load_conditions
from rans.model.spacecraft import Spacecraft, Thruster
from rans.model.spacecraft_file import load_spacecraft, spacecraft_names
from rans.model.timing import Timing
from rans.scenario import Scenario
from rans.tasks import TASKS, GoToPose, gymnasium_ids

if TYPE_CHECKING:
    from rans.fast import PPO, Engine, SB3VecEnv, SpacecraftEnv, SpacecraftVectorEnv

    __version__: str

__all__ = [
    "Spacecraft", "Thruster", "load_spacecraft", "spacecraft_names",
    "Conditions", "load_conditions", "GoToPose", "Scenario", "Timing",
    "Engine", "PPO", "SB3VecEnv", "SpacecraftEnv", "SpacecraftVectorEnv",
    "ConfigError", "NonFiniteState", "RansError", "SolverFailed",
    "__version__",
]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version("rans")
    if name in __all__:
        return getattr(fast, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


def _register() -> None:
    """Gymnasium has no plug-in mechanism (since 1.0): its registry must be told on import."""
    for task_name in TASKS:
        for dimension, gymnasium_id in zip((2, 3), gymnasium_ids(task_name), strict=True):
            kwargs = {"task_name": task_name, "dimension": dimension}
            gymnasium.register(gymnasium_id, "rans.fast.envs.single:SpacecraftEnv", kwargs=kwargs,
                               vector_entry_point="rans.fast.envs.vector:SpacecraftVectorEnv")
            gymnasium.register(gymnasium_id.replace("-v", "-Drake-v"), "rans.reference.flight:DrakeEnv",
                               kwargs=kwargs)


_register()
