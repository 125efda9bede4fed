"""Training episodes that begin at states of failed flights of the agent.

Training explores with random actions and in its own episodes. Failures of the deterministic action alone, such as a
limit cycle of two steps at rest, or late in a flight, are rare there. Therefore very many evaluation flights are
run from time to time, and states along the failed ones become starts in a share of the environments.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from rans.episode import Setup
from rans.fast.engine import Engine
from rans.fast.flights import Flights
from rans.fast.learn.config import TrainConfig
from rans.fast.learn.learner import Learner
from rans.fast.stepping.step import begin_as, varying
from rans.policy.network import Network
from rans.scenario import FAILURES_SEED

_FOLLOWED = 1024
"""Largest number of failed flights of a search that are repeated for their states: the first ones."""
_KEPT = 2**18
"""Largest number of stored starts of a member: the newest ones."""


class FailedStarts:
    """Starts at states of failed flights for K members that train together; none if ``failures.share`` is 0.

    Every process of a training computes the same starts.
    """

    def __init__(self, configs: Sequence[TrainConfig], engine: Engine, learner: Learner) -> None:
        self._configs = configs
        self._engine = engine
        self._learner = learner
        self._settings = first = configs[0].failures
        self._searches = 0
        self._starts = [list[Tensor]() for _ in configs]
        self._generator = torch.Generator().manual_seed(configs[0].seed)
        self.log: list[dict[str, float]] = [{} for _ in configs]
        """Share of failed flights of each member in the last search, for the log."""
        # This number of rollouts is at least as long as an episode.
        self._rollouts = -(-engine.timing.episode_steps // learner.n_steps)
        self._each = engine.num_envs // len(configs)
        self._shared = int(first.share * self._each)

    def begin(self, steps: int) -> None:
        """Search for failures if due, and begin episodes; called before the rollout at ``steps`` environment steps.

        The environments take turns, such that their last such episode is over.
        """
        if not self._shared:
            return
        if steps >= self._next_search() and self._searches < self._settings.searches:
            self._search()
        turn = steps // (self._configs[0].ppo.n_envs * self._learner.n_steps) % self._rollouts
        for number, starts in enumerate(self._starts):
            rows = torch.arange(turn, self._shared, self._rollouts) + number * self._each
            if starts and len(rows):
                self._put(rows, starts)

    def _put(self, rows: Tensor, starts: Sequence[Tensor]) -> None:
        engine = self._engine
        memory = self._learner.rollout.memory
        world = engine.processes
        chosen = world.mine(
            torch.randint(len(starts[0]), (len(rows) * world.size,), generator=self._generator)
        ).to(engine.device)
        rows = rows.to(engine.device)
        begin_as(engine.episode, engine.timing, rows, [column[chosen] for column in starts])
        if memory is not None:
            memory[rows] = 0.0

    def _next_search(self) -> float:
        """Environment steps after which the next search is due."""
        begin = self._settings.begin
        fraction = begin + (1.0 - begin) * self._searches / self._settings.searches
        return fraction * self._configs[0].total_timesteps

    def _search(self) -> None:
        """Fly every member, and store the states of failed flights."""
        network = self._learner.network
        first = self._searches * self._settings.flights
        count = self._settings.flights
        for number, config in enumerate(self._configs):
            setup = Setup(
                self._engine.craft,
                config.settings.for_evaluation(),
                config.timing,
                config.conditions.or_none,
            )
            alone = Network(network.architecture, network.member(number))
            flights = Flights(
                alone, setup, self._engine.device, listed=_FOLLOWED, plain=config.plain
            )
            statistics = flights.fly(first, count, FAILURES_SEED)
            self.log[number] = {"failures/share": statistics.unsolved / count}
            if len(statistics.numbers):
                new = self._followed(flights, statistics.numbers)
                old = self._starts[number]
                self._starts[number] = (
                    [torch.cat(pair)[:_KEPT] for pair in zip(new, old, strict=True)] if old else new
                )
        self._searches += 1

    def _followed(self, flights: Flights, numbers: np.ndarray) -> list[Tensor]:
        """Episodes for `begin_as`, at every step of these flights before their end."""
        engine = self._engine
        arrived = list[list[Tensor]]()
        going = torch.ones(len(numbers), dtype=torch.bool, device=engine.device)
        with np.errstate(all="ignore"):
            for episode, outcome in flights.steps(
                flights.draws(FAILURES_SEED, numbers.astype(np.int32))
            ):
                arrived.append([column[going] for column in varying(episode, engine.episode)])
                going &= ~torch.as_tensor(outcome.terminated)
        return [torch.cat(column) for column in zip(*arrived, strict=True)]

    def state(self) -> dict[str, Any]:
        """State, for `load`."""
        return {
            "searches": self._searches,
            "starts": self._starts,
            "generator": self._generator.get_state(),
            "found": self.log,
        }

    def load(self, saved: dict[str, Any]) -> None:
        """Continue from the result of `state`."""
        self._searches = saved["searches" if "searches" in saved else "looks"]
        self._starts = saved["starts"]
        self.log = saved["found"]
        self._generator.set_state(saved["generator"].cpu())
