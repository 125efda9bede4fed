"""Whether the agent in training has solved its task: deterministic flights from fixed starts."""

from __future__ import annotations

import torch
from stable_baselines3.common.policies import ActorCriticPolicy
from torch import Tensor

from rans.fast.engine import Engine
from rans.fast.graph import fused, graphed
from rans.fast.policy import evaluate
from rans.scenario import SELECTION_SEED
from rans.spacecraft import Spacecraft
from rans.tasks import Task
from rans.timing import Timing

EPISODES = 1024


class Selection:
    """Flies the agent from the same 1,024 starts whenever asked.

    Args:
        policy: the agent; its weights may change between flights.
        craft: the spacecraft.
        task: as in training; its evaluation starts are used.
        timing: as in training.
        device: torch device of the policy.
    """

    def __init__(self, policy: ActorCriticPolicy, craft: Spacecraft, task: Task, timing: Timing,
                 device: str) -> None:
        self._policy = policy
        self._engine = Engine(craft, task.for_evaluation(), EPISODES, timing, seed=SELECTION_SEED,
                              device=device)
        self._act = fused(likeliest_action, self._engine.device)
        self._flight = graphed(self._fly, self._engine.device)

    def judge(self) -> tuple[float, dict[str, float]]:
        """Share of episodes that keep within all tolerances at every step of the last fifth.

        Returns:
            The share, and the mean errors by name of the states acted in over the last fifth. An episode
            that fails counts as not kept, and the one that follows it enters the means.
        """
        share, *errors = self._flight().tolist()
        return share, dict(zip(self._engine.errors(), errors, strict=True))

    @torch.no_grad()
    def _fly(self) -> Tensor:
        engine, steps = self._engine, self._engine.timing.episode_steps
        last_fifth = range(steps - max(1, steps // 5), steps)
        observation = engine.reset(SELECTION_SEED)
        ended = torch.zeros(EPISODES, dtype=torch.bool, device=engine.device)
        kept, total = ~ended, torch.zeros(len(engine.errors()), device=engine.device)
        for t in range(steps):
            if t in last_fifth:
                total += torch.stack([error.mean() for error in engine.errors().values()])
            step = engine.step(self._act(self._policy, observation))
            observation = step.observation
            if t in last_fifth:
                kept &= step.reached & ~ended
            ended |= step.terminated
        return torch.cat((kept.to(total.dtype).mean()[None], total / len(last_fifth)))


def likeliest_action(policy: ActorCriticPolicy, observation: Tensor) -> Tensor:
    """The deterministic agent's action (N, thrusters)."""
    return evaluate(policy, observation).mode()
