"""Base class of learning algorithms, which `rans.fast.learn.learners` has by name."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from rans.base.errors import ConfigError, brief
from rans.fast.learn.learners import LEARNERS

if TYPE_CHECKING:
    from rans.fast.learn.config import TrainConfig
    from rans.fast.learn.learner import Making
    from rans.model.spacecraft import Spacecraft


@dataclass(frozen=True)
class NoSettings:
    """Settings of an algorithm that has none beside `rans.PPOSettings`."""


class Algorithm(ABC):
    """Learning algorithm: its settings, and how its learner is created.

    A class derived from it is registered by an entry point of the group ``rans.learners``, or by
    ``LEARNERS.register(NAME)`` in one process. ``rans train --set algorithm=NAME`` then uses it (docs/learners.md).
    It must have `making`, and may have the others; the learner that is made has the members of
    `rans.fast.learn.learner.Learner`.
    """

    settings: ClassVar[type] = NoSettings
    """Frozen dataclass of the algorithm's settings, all with defaults; their values are `TrainConfig.learner`."""
    plain_network: ClassVar[bool] = False
    """Whether the network is computed by single operations of torch, whatever the engine does."""

    @classmethod
    def best(cls, config: TrainConfig, craft: Spacecraft) -> TrainConfig | None:
        """Config of this algorithm for ``rans train --quality best``; None: others train this agent better."""
        return None

    @classmethod
    def contestants(cls, config: TrainConfig, folder: Path) -> list[str]:
        """Names under which what a run has beside its network flies the task; by default there is nothing."""
        return []

    @classmethod
    def started(cls, config: TrainConfig) -> TrainConfig:
        """Config with hyper-parameters known to work for this algorithm; by default unchanged."""
        return config

    @classmethod
    @abstractmethod
    def making(cls, config: TrainConfig, craft: Spacecraft, own: Any) -> Making[Any]:
        """Constructor of the learner of a training.

        Args:
            config: config of the training.
            craft: spacecraft.
            own: the algorithm's settings, an object of `settings`.

        Raises:
            ConfigError: the algorithm cannot train this agent.
        """


def checked_algorithm(loaded: Any) -> type[Algorithm]:
    """The class, checked to be derived from `Algorithm`."""
    if not (isinstance(loaded, type) and issubclass(loaded, Algorithm)):
        raise ConfigError(
            "a learner must be a class derived from rans.fast.learn.algorithms.Algorithm, got "
            f"{brief(loaded)}."
        )
    return loaded


def with_algorithm(config: TrainConfig, algorithm: str) -> TrainConfig:
    """Config with another algorithm, its own settings and hyper-parameters known to work for it.

    Raises:
        ConfigError: there is no such algorithm.
    """
    if algorithm == config.algorithm:
        return config
    return LEARNERS[algorithm].started(replace(config, algorithm=algorithm, learner={}))
