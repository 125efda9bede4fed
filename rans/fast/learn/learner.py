"""Protocol of learners, which trainer and agent files use."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol, TypeVar

import torch
from torch import Tensor

from rans.fast.engine import Engine
from rans.fast.learn.adam import Adam
from rans.fast.learn.config import PPOSettings
from rans.fast.learn.rollout import Rollout
from rans.policy.network import Network


class Learner(Protocol):
    """Learning algorithm that updates a network from the environments of an engine.

    Each iteration flies every environment for ``n_steps`` control periods and updates the weights. Everything else
    (curriculum, selection, checkpoints, run folder, log) is part of `rans.fast.learn.trainer.Trainer`.
    """

    engine: Engine
    network: Network
    """Network of the agent, changed in place."""
    rollout: Rollout
    """Steps of the last iteration, and the present memory of the network for every environment."""
    adam: Adam
    """Optimizer of the agent's weights; saved with it."""
    n_steps: int
    """Control periods of an iteration."""

    @property
    def statistics(self) -> tuple[str, ...]:
        """Names of the statistics of an iteration, in the log after "train/"."""
        ...

    @property
    def description(self) -> str:
        """Description of the gradient computation for the log; empty for autograd."""
        ...

    def slow_down(self, remaining: float) -> None:
        """Reduce the step sizes at the end of training, where ``remaining`` is the share of steps left, 1 to 0."""
        ...

    def learn(self) -> Tensor:
        """Run one iteration: fly, and update the weights.

        Returns:
            A row (columns,): `statistics`; the new step size; numbers of failed episodes, of all
            ended ones, and of those truncated within the task's tolerances; steps of all ended ones; mean reward
            of a step by term.
        """
        ...

    def state(self) -> dict[str, Any]:
        """State of the learner without the episodes of the engine; all processes must call it."""
        ...

    def load(self, saved: dict[str, Any]) -> None:
        """Continue from the result of `state`."""
        ...


Made = TypeVar("Made", bound=Learner)
Making = Callable[[Engine, Network, PPOSettings, torch.Generator, bool], Made]
"""Creates a learner of a network with initial weights; the generator is of actions on a CPU, and true as last
argument forbids compilation."""
