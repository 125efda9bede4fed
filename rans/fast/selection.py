"""Whether the agent in training has solved its task: deterministic flights from fixed starts."""

from __future__ import annotations

import torch
from stable_baselines3.common.policies import ActorCriticPolicy

from rans.fast.engine import Engine
from rans.fast.policy import evaluate
from rans.scenario import SELECTION_SEED
from rans.spacecraft import Spacecraft
from rans.tasks import Task
from rans.timing import Timing

EPISODES = 1024


class Selection:
    """Flies the agent from the same 1,024 starts whenever asked.

    Args:
        craft: the spacecraft.
        task: as in training; its evaluation starts are used.
        timing: as in training.
        device: torch device.
    """

    def __init__(self, craft: Spacecraft, task: Task, timing: Timing, device: str) -> None:
        self._engine = Engine(craft, task.for_evaluation(), EPISODES, timing, seed=SELECTION_SEED, device=device)

    @torch.no_grad()
    def judge(self, policy: ActorCriticPolicy) -> tuple[float, dict[str, float]]:
        """Share of episodes that keep within all tolerances at every step of the last fifth.

        Returns:
            The share, and the mean errors over the last fifth by name.
        """
        engine, steps = self._engine, self._engine.timing.episode_steps
        observation = engine.reset(SELECTION_SEED)
        kept = torch.ones(EPISODES, dtype=torch.bool, device=engine.device)
        ended = ~kept
        total: dict[str, torch.Tensor] = {}
        for t in range(steps):
            errors = engine.errors()
            step = engine.step(evaluate(policy, observation).mode())
            observation = step.observation
            # The state at the end of the last step is reset away: its errors are left out of the mean.
            if t > steps - steps // 5:
                total = {name: total.get(name, 0.0) + error.mean() for name, error in errors.items()}
            if t >= steps - steps // 5:
                kept &= step.reached & ~ended
            ended |= step.terminated
        means = {name: float(value) / (steps // 5 - 1) for name, value in total.items()}
        return float(kept.to(torch.float32).mean()), means
