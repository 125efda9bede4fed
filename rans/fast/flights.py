"""Very many flights of one policy, one scenario each, of which nothing is kept but what became of them."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, as_completed

import numpy as np
import torch

from rans.episode import World, step
from rans.errors import ConfigError, brief
from rans.fast.engine import FLOAT32_NODES, check_device
from rans.fast.learn.network import Network
from rans.fast.learn.selection import likeliest
from rans.fast.step import Place, field_dtype
from rans.fast.verdicts import Tally, Verdicts, together
from rans.model.conditions import Conditions
from rans.model.fields import Field
from rans.model.random import Draws, seed_words
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from rans.tasks.base import Task

Given = tuple[Spacecraft, Task, Timing, Conditions | None]
"""What flies, what for, how long and under which conditions: a `rans.evaluation.fly.protocols.Setup`."""

BATCH = {"cpu": 4096, "cuda": 2**20}
"""Flights stepped together: what a processor's caches hold, and what keeps a GPU busy."""
LISTED = 100_000
"""Failed flights that are listed by number."""


class Flights:
    """Flies one policy's likeliest commands through the scenarios of a seed, in float32.

    Args:
        network: of one member.
        setup: what flies, with the starts to fly from (`rans.evaluation.fly.agent.LoadedRun.judged`).
        device: torch device that everything is computed on.
        listed: failed flights whose numbers are kept.

    Raises:
        ConfigError: there is no such device here.
    """

    def __init__(self, network: Network, setup: Given, device: str | torch.device = "cpu",
                 listed: int = LISTED) -> None:
        check_device(device)
        craft, task, timing, conditions = setup
        self.device, self.listed = torch.device(device), listed
        self.world = World(craft, task, timing, FLOAT32_NODES, conditions)
        self._network = Network(network.architecture, {
            name: x.to(self.device, torch.float32) for name, x in network.tensors.items()})
        self._place = Place(self.device, field_dtype(self.device))

    def fly(self, first: int, count: int, seed: int,
            progress: Callable[[int], object] = lambda _: None) -> Verdicts:
        """What becomes of scenarios ``first`` to ``first + count - 1``; progress is told how many are over.

        Raises:
            ConfigError: the seed has more than 64 bits, or a scenario's number more than 31.
        """
        if count < 1 or first < 0 or first + count > 2**31:
            raise ConfigError(f"scenarios have numbers from 0 to {2**31 - 1}: there are none from "
                              f"{brief(first)} to {brief(first + count - 1)}.")
        words, size = seed_words(seed), BATCH[self.device.type]
        batches = [np.arange(begin, min(begin + size, first + count), dtype=np.int32)
                   for begin in range(first, first + count, size)]
        workers = (os.cpu_count() or 1) if self._place.on_numpy else 1
        threads, whole = torch.get_num_threads(), Verdicts.none(self.world.timing.episode_steps, self.listed)
        torch.set_num_threads(1)  # each of the workers' threads
        try:
            with ThreadPoolExecutor(workers) as pool:
                futures = [pool.submit(self._stepped, words, numbers) for numbers in batches]
                for future in as_completed(futures):
                    progress(future.result().flights)
                return together((future.result() for future in futures), whole)
        finally:
            torch.set_num_threads(threads)

    @torch.no_grad()
    def _stepped(self, words: tuple[int, int], numbers: np.ndarray) -> Verdicts:
        """One batch, step by step."""
        world, place, network = self.world, self._place, self._network
        draws = Draws(*words, place.put(numbers, torch.int32), 0, place.fields)
        clock = place.put(np.zeros_like(numbers), torch.int32)
        # What is no longer finite flies on in vain: nothing of it is counted.
        with np.errstate(all="ignore"):
            now = world.begin(*world.scenario(clock, draws), clock, draws)
            tally, memory = Tally.of(world, now), network.blank(len(numbers))
            for _ in range(world.timing.episode_steps):
                seen = self._seen(world.observe(now, draws), len(numbers))
                command, memory = likeliest(network, seen, memory)
                columns = command.T.contiguous()
                outcome = step(world, now, tuple(columns.numpy() if place.on_numpy else columns), draws)
                tally, now = tally.after(world, outcome), outcome.episode
        return Verdicts.of(world, tally, numbers, self.listed, f"stepping on {self.device.type}")

    def _seen(self, columns: tuple[Field, ...], count: int) -> torch.Tensor:
        """Observations (N, width); columns that are the same for all are numbers or of one element."""
        rows = torch.empty((len(columns), count), dtype=torch.float32, device=self.device)
        into = rows.numpy() if self._place.on_numpy else rows
        for row, column in enumerate(columns):
            into[row] = column
        return rows.T


def fly_many(network: Network, setup: Given, first: int, count: int, seed: int,
             device: str | torch.device = "cpu") -> Verdicts:
    """What becomes of scenarios ``first`` to ``first + count - 1`` of a seed, see `Flights`.

    Raises:
        ConfigError: see `Flights` and `Flights.fly`.
    """
    return Flights(network, setup, device).fly(first, count, seed)
