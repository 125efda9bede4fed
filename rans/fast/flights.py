"""Very many flights of one policy, one scenario each, of which nothing is kept but what became of them."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import contextmanager

import numpy as np
import torch

from rans.episode import World, step
from rans.errors import ConfigError, brief
from rans.fast.cpu_flights import CpuFlights
from rans.fast.engine import FLOAT32_NODES, check_device
from rans.fast.kernels.flight import FlightKernel, Products
from rans.fast.learn.network import Network
from rans.fast.learn.selection import likeliest
from rans.fast.step import Place, field_dtype
from rans.fast.verdicts import Tally, Verdicts, together
from rans.model.conditions import Conditions
from rans.model.fields import Field
from rans.model.random import Draws, seed_words
from rans.model.trace import UNTRACEABLE
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from rans.tasks.base import Task

Given = tuple[Spacecraft, Task, Timing, Conditions | None]
"""What flies, what for, how long and under which conditions: a `rans.evaluation.fly.protocols.Setup`."""

BATCH = {"cpu": 8192, "cuda": 2**20}
"""Flights stepped together: what a processor's caches hold, and what keeps a GPU busy."""
_LAUNCH = 2**26
"""Flights of one launch of the kernel, about a second's."""
LISTED = 100_000
"""Failed flights that are listed by number."""


class Flights:
    """Flies one policy's likeliest commands through the scenarios of a seed, in float32.

    Args:
        network: of one member.
        setup: what flies, with the starts to fly from (`rans.evaluation.fly.agent.LoadedRun.judged`).
        device: torch device that everything is computed on.
        listed: failed flights whose numbers are kept.
        products: of the network on a GPU, by their names in XLA: of bfloat16, which changes one command in a
            thousand, or of two or three of them for each number (docs/decisions/016-flight-kernel.md).
        generated: whether flights are generated programs, where they can be; else torch or NumPy steps them.

    Raises:
        ConfigError: there is no such device here.
    """

    def __init__(self, network: Network, setup: Given, device: str | torch.device = "cpu",
                 listed: int = LISTED, products: Products = "bf16x3", generated: bool = True) -> None:
        check_device(device)
        craft, task, timing, conditions = setup
        self.device, self.listed = torch.device(device), listed
        self.world = World(craft, task, timing, FLOAT32_NODES, conditions)
        self._network = Network(network.architecture, {
            name: x.to(self.device, torch.float32) for name, x in network.tensors.items()})
        self._place = Place(self.device, field_dtype(self.device))
        self._whole = self._made(products) if generated else None

    def _made(self, products: Products) -> FlightKernel | CpuFlights | None:
        """What flies whole episodes, where that can be made; with a warning on a GPU where it cannot."""
        if self.device.type == "cuda":
            return FlightKernel.made(self.world, self._network, self.device, products)
        try:
            with _one_thread_each():
                return CpuFlights(self.world, self._network)
        except UNTRACEABLE:  # a network with a memory, or a task that does more than arithmetic on fields
            return None

    def fly(self, first: int, count: int, seed: int,
            progress: Callable[[int], object] = lambda _: None) -> Verdicts:
        """What becomes of scenarios ``first`` to ``first + count - 1``; progress is told how many are over.

        Raises:
            ConfigError: the seed has more than 64 bits, or a scenario's number more than 31.
        """
        if count < 1 or first < 0 or first + count > 2**31:
            raise ConfigError(f"scenarios have numbers from 0 to {2**31 - 1}: there are none from "
                              f"{brief(first)} to {brief(first + count - 1)}.")
        size = _LAUNCH if isinstance(self._whole, FlightKernel) else BATCH[self.device.type]
        parts = [(begin, min(size, first + count - begin), seed) for begin in range(first, first + count, size)]
        workers = (os.cpu_count() or 1) if self._place.on_numpy else 1
        none = Verdicts.none(self.world.timing.episode_steps, self.listed)
        with _one_thread_each(), ThreadPoolExecutor(workers) as pool:
            futures = [pool.submit(self._part, *part) for part in parts]
            for future in as_completed(futures):
                progress(future.result().flights)
            return together((future.result() for future in futures), none)

    def _part(self, first: int, count: int, seed: int) -> Verdicts:
        if self._whole is not None:
            return self._whole.fly(first, count, seed, self.listed)
        return self._stepped(seed_words(seed), np.arange(first, first + count, dtype=np.int32))

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
        outcome, totals = (
            [np.broadcast_to(np.asarray(torch.as_tensor(x).cpu()), len(numbers)) for x in values] for values in (
                (tally.failure(), tally.going & tally.inside, tally.settled),
                (tally.gained, tally.impulse, tally.opened)))
        return Verdicts.of(world, numbers, outcome, totals, self.listed, f"stepping, {self.device.type}")

    def _seen(self, columns: tuple[Field, ...], count: int) -> torch.Tensor:
        """Observations (N, width); columns that are the same for all are numbers or of one element."""
        rows = torch.empty((len(columns), count), dtype=torch.float32, device=self.device)
        into = rows.numpy() if self._place.on_numpy else rows
        for row, column in enumerate(columns):
            into[row] = column
        return rows.T


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """Within it torch starts no threads beside those that call it."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)


def fly_many(network: Network, setup: Given, first: int, count: int, seed: int,
             device: str | torch.device = "cpu") -> Verdicts:
    """What becomes of scenarios ``first`` to ``first + count - 1`` of a seed, see `Flights`.

    Raises:
        ConfigError: see `Flights` and `Flights.fly`.
    """
    return Flights(network, setup, device).fly(first, count, seed)
