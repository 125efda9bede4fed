"""Registered learning algorithms and tables of their settings, without the types of a training's config."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from rans.errors import ConfigError, brief
from rans.registry import Registry
from rans.structure import structure


def _checked(loaded: Any) -> type[Any]:
    """The class, checked to have what `rans.fast.learn.algorithms.Algorithm` has.

    It is not checked to be derived from it: its type knows the config, which reads this registry.
    """
    if not (
        isinstance(loaded, type)
        and isinstance(getattr(loaded, "settings", None), type)
        and all(callable(getattr(loaded, name, None)) for name in ("best", "started", "making"))
    ):
        raise ConfigError(
            "a learner must be a class derived from rans.fast.learn.algorithms.Algorithm, got "
            f"{brief(loaded)}."
        )
    return loaded


LEARNERS = Registry(
    "learner",
    "rans.learners",
    {"ppo": "rans.fast.learn.algorithms:PPOAlgorithm"},
    _checked,
)
"""Class of every learning algorithm by its name in ``rans train --set algorithm=NAME``."""


def own_settings(algorithm: str, table: Mapping[str, Any]) -> Any:
    """Settings of an algorithm from a table of them, with defaults for those that it lacks.

    Raises:
        ConfigError: there is no such algorithm, or it has no such setting.
    """
    return structure(dict(table), LEARNERS[algorithm].settings, "learner")


def complete(algorithm: str, table: Mapping[str, Any]) -> dict[str, Any]:
    """Table of all settings of an algorithm; see `own_settings`."""
    return asdict(own_settings(algorithm, table))
