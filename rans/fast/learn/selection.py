"""Whether the agent in training has solved its task: deterministic flights from fixed starts."""

from __future__ import annotations

from collections.abc import Callable

import torch
from stable_baselines3.common.policies import ActorCriticPolicy
from torch import Tensor

from rans.fast.engine import Engine
from rans.fast.learn.graph import fused, graphed
from rans.fast.policy import evaluate
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from rans.scenario import SELECTION_SEED
from rans.tasks import Task

EPISODES = 1024


class Selection:
    """Flies the agent from the same 1,024 starts whenever asked; in a multi-task, of each of its parts.

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
        self._engines = {
            name: Engine(craft, part.for_evaluation(), EPISODES, timing, seed=SELECTION_SEED, device=device)
            for name, part in task.parts().items()}
        self._act = fused(likeliest_action, torch.device(device))
        self._flight = graphed(self._fly, torch.device(device))

    def judge(self) -> tuple[float, dict[str, float]]:
        """Share of episodes that keep within all tolerances at every step of the last fifth.

        Returns:
            The share, of a multi-task that of the worst part, and the mean errors by name of the states
            acted in over the last fifth. An episode that fails counts as not kept, and the one that
            follows it enters the means. A multi-task's errors are named "go-to-pose/position".
        """
        values, shares, errors = iter(self._flight().tolist()), [], {}
        for name, engine in self._engines.items():
            prefix = f"{name}/" if len(self._engines) > 1 else ""
            shares.append(next(values))
            errors |= {prefix + quantity: next(values) for quantity in engine.errors()}
        return min(shares), errors

    def _fly(self) -> Tensor:
        act = lambda observation: self._act(self._policy, observation)  # noqa: E731
        return torch.cat([judged_flight(engine, act)[0, 1:] for engine in self._engines.values()])


@torch.no_grad()
def judged_flight(engine: Engine, act: Callable[[Tensor], Tensor], members: int = 1) -> Tensor:
    """Fly one episode everywhere, from the starts of `SELECTION_SEED`.

    Args:
        engine: its environments belong to the members in equal, contiguous parts.
        act: the action (N, thrusters) of an observation.
        members: K.

    Returns:
        (K, 2 + errors): mean share of open thrusters, share and mean errors of `Selection.judge`.
    """
    steps = engine.timing.episode_steps
    last_fifth = range(steps - max(1, steps // 5), steps)
    mean = lambda field: field.to(engine.dtype).reshape(members, -1).mean(dim=1)  # noqa: E731
    observation = engine.reset(SELECTION_SEED)
    ended = torch.zeros(engine.num_envs, dtype=torch.bool, device=engine.device)
    kept, duty, total = ~ended, mean(ended), mean(ended)[:, None]
    for t in range(steps):
        if t in last_fifth:
            total = total + torch.stack([mean(error) for error in engine.errors().values()], dim=1)
        action = act(observation)
        duty = duty + mean(action) / steps
        step = engine.step(action)
        observation = step.observation
        if t in last_fifth:
            kept &= step.reached & ~ended
        ended |= step.terminated
    return torch.cat((duty[:, None], mean(kept)[:, None], total / len(last_fifth)), dim=1)


def likeliest_action(policy: ActorCriticPolicy, observation: Tensor) -> Tensor:
    """The deterministic agent's action (N, thrusters)."""
    return evaluate(policy, observation).mode()
