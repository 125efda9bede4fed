"""Learning algorithms by name: PPO, and those that installed packages offer (entry points ``rans.learners``)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rans.base.registry import Registry
from rans.base.structure import structure

LEARNERS: Registry[Any] = Registry(
    "learner",
    "rans.learners",
    {"ppo": "rans.fast.learn.ppo:PPOAlgorithm"},
    "rans.fast.learn.algorithms:checked_algorithm",
)
"""Class of every learning algorithm by its name in ``rans train --set algorithm=NAME``."""


def own_settings(algorithm: str, table: Mapping[str, Any]) -> Any:
    """Settings of an algorithm from a table of them, with defaults for those that it lacks.

    Raises:
        ConfigError: there is no such algorithm, or it has no such setting.
    """
    return structure(dict(table), LEARNERS[algorithm].settings, "learner")
