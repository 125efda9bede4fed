"""Evaluation during training: deterministic episodes from fixed initial states."""

from __future__ import annotations

from collections.abc import Iterator
from statistics import fmean

import torch
from torch import Tensor

from rans.episode.scenario import SELECTION_SEED
from rans.episode.step import Guard
from rans.episode.verdict import FlightAccumulator, last_fifth
from rans.fast.engine import Engine
from rans.fast.learn.graph import graphed
from rans.model.fields import map_leaves
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from rans.policy.network import Network
from rans.randomization.conditions import Conditions
from rans.tasks import Task

EPISODES = 1024


class Selection:
    """Evaluates an agent from the same 1,024 initial states; a multi-task in each of its tasks.

    Its weights may change between evaluations. Task and conditions are those of training, without its curriculum
    and with evaluation starts. Success is judged by the true state. With
    ``plain`` nothing is compiled; with a ``guard`` this safety filter corrects the commands.
    """

    def __init__(
        self,
        network: Network,
        craft: Spacecraft,
        task: Task,
        timing: Timing,
        device: torch.device,
        conditions: Conditions | None = None,
        plain: bool = False,
        guard: Guard | None = None,
    ) -> None:
        self._network = network
        # Starts depend on the seed alone, so that runs and resumed runs are compared on the same episodes.
        self._engines = {
            name: Engine(
                craft,
                part.for_evaluation(),
                EPISODES,
                timing,
                seed=SELECTION_SEED,
                device=device,
                conditions=conditions,
                guard=guard,
                plain=plain,
            )
            for name, part in task.parts().items()
        }
        self._flight = graphed(self._fly, device, plain)

    def judge(self) -> dict[str, float]:
        """Figures of an evaluation by their names in the log.

        "success" is the share of episodes that are solved (`rans.episode.verdict`), for a multi-task that of its
        worst task; "duty" is the mean share of open thrusters; "error/..." are mean errors before each step of the
        last fifth. Episodes started after a failure enter the means. Errors of a multi-task are named
        "error/go-to-pose/position".
        """
        left: Iterator[float] = iter(self._flight().tolist())
        duties = []
        success_rates = []
        errors = {}
        for name, engine in self._engines.items():
            prefix = f"{name}/" if len(self._engines) > 1 else ""
            duties.append(next(left))
            success_rates.append(next(left))
            errors |= {f"error/{prefix}{quantity}": next(left) for quantity in engine.errors()}
        return {"success": min(success_rates), "duty": fmean(duties), **errors}

    @torch.no_grad()
    def _fly(self) -> Tensor:
        return torch.cat([self._flown(engine) for engine in self._engines.values()])

    def _flown(self, engine: Engine) -> Tensor:
        """Results of one episode per environment: duty, success share and mean errors, (2 + errors,).

        Nothing is read on the host before the end: a GPU computes it without waiting. Solved is what
        `rans.episode.verdict` says.
        """
        steps = engine.timing.episode_steps
        last = last_fifth(steps)
        mean = lambda field: field.to(engine.dtype).mean()  # noqa: E731
        observation = engine.reset(SELECTION_SEED)
        memory = self._network.initial_state(engine.num_envs)
        verdict = map_leaves(torch.as_tensor, FlightAccumulator.begin(engine, engine.episode))
        duty = mean(verdict.lost)
        total = duty
        for t in range(steps):
            late = t >= steps - last
            if late:
                total = total + torch.stack([mean(error) for error in engine.errors().values()])
            command, memory = self._network.deterministic_action(observation, memory)
            duty = duty + mean(command) / steps
            step = engine.step(engine.commands(command))
            observation = step.observation
            if memory is not None:
                memory = torch.where((step.terminated | step.truncated)[:, None], 0.0, memory)
            # Steps of an episode that follows a finished one do not change the verdict.
            done = None if verdict.won is None else step.terminated & step.reached
            if late:
                verdict = verdict.at(t + 1, late, step.reached, step.terminated, verdict.lost, done)
            else:
                verdict = verdict.without_instant(step.terminated, done)
        return torch.cat((duty[None], mean(verdict.solved)[None], total / last))
