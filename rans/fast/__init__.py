"""Fast engine: thousands of spacecraft stepped together in torch, environments, and trainers on the same device.

Names are loaded on first use, so that the single environment does not need torch.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rans.fast.engine import Engine
    from rans.fast.envs.sb3 import SB3VecEnv
    from rans.fast.envs.single import SpacecraftEnv
    from rans.fast.envs.vector import SpacecraftVectorEnv
    from rans.fast.stepping.step import Step

__all__ = ["Engine", "SB3VecEnv", "SpacecraftEnv", "SpacecraftVectorEnv", "Step"]

_MODULES = {
    "Engine": "engine",
    "Step": "stepping.step",
    "SpacecraftEnv": "envs.single",
    "SB3VecEnv": "envs.sb3",
    "SpacecraftVectorEnv": "envs.vector",
}


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_MODULES[name]}"), name)
