"""What a learner is to those who train with it: the trainer, sweeps, the search for failures, files."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import torch
from torch import Tensor

from rans.fast.engine import Engine
from rans.fast.learn.adam import Adam
from rans.fast.learn.config import PPOSettings
from rans.fast.learn.rollout import Rollout
from rans.policy.network import Network


class Learner(Protocol):
    """Changes a network's weights, K members' at once, from what its engine's environments give.

    Each iteration flies every environment for ``n_steps`` control periods. How it learns from them, and in
    how many steps down which gradient, is its own; everything else of a training is the trainer's
    (`rans.fast.learn.trainer.Trainer`): curriculum, selection, checkpoints, the run folder, the log.
    """

    engine: Engine
    network: Network
    """The agents; changed in place."""
    rollout: Rollout
    """The last iteration's steps, and what the network remembers now of every environment."""
    adam: Adam
    """Optimizer of the agents' weights; saved with an agent."""
    n_steps: int
    """Control periods of an iteration."""

    @property
    def statistics(self) -> tuple[str, ...]:
        """Names of what an iteration reports, in the log after "train/"."""
        ...

    @property
    def description(self) -> str:
        """How gradients are computed, in words; empty: as usual."""
        ...

    def slow_down(self, remaining: float) -> None:
        """Lower the step sizes where less than a settled share of all steps remains, a number of 1 to 0."""
        ...

    def learn(self) -> Tensor:
        """One iteration: fly, and learn from it.

        Returns:
            A row a member, (K, columns): `statistics`; the step size from now on; how many episodes were cut
            off by time, ended in all, and were cut off within the task's tolerances; mean reward of a step by
            term.
        """
        ...

    def state(self) -> dict[str, Any]:
        """Everything needed to go on, but for the engine's episodes; all processes must ask."""
        ...

    def load(self, saved: dict[str, Any]) -> None:
        """Go on from what `state` gave."""
        ...


class Making(Protocol):
    """Makes a learner of weights that have learnt nothing."""

    def __call__(
        self,
        engine: Engine,
        network: Network,
        settings: Sequence[PPOSettings],
        generators: Sequence[torch.Generator],
    ) -> Learner:
        """Settings and generators, of actions on a CPU, are one a member."""
        ...
