"""Very many whole flights of one policy, one scenario each, of which only the verdicts are kept."""

from __future__ import annotations

import os
from collections.abc import Generator, Iterator, Sequence
from contextlib import closing

import numpy as np
import torch

from rans.compile.cpu.flights import CpuFlights
from rans.compile.cpu.layers import CpuLayers
from rans.compile.cuda.flight import FlightKernel, Products
from rans.compile.flight_program import trace_flight
from rans.effectors.commands import of_outputs
from rans.episode import Episode, Outcome, Setup, World, step
from rans.errors import ConfigError, brief
from rans.fast.stepping.step import Backend
from rans.fast.threads import one_thread
from rans.flight_statistics import FlightStatistics
from rans.model.fields import Field, leaves
from rans.model.random import Draws, seed_words
from rans.model.trace import UNTRACEABLE
from rans.policy.network import Network
from rans.policy.traced import parameters
from rans.processes import Workers, processors
from rans.progress import Progress, unseen
from rans.verdict import FlightAccumulator

BATCH = {"cpu": 4096, "cuda": 2**20}
"""Flights stepped together: what a processor's caches hold, and what keeps a GPU busy."""
_LAUNCH = 2**26
"""Flights of one launch of the kernel, about a second's."""
_MANY = 2**17
"""So many are divided among processes, which take seconds to start."""
_SHARE = 2 * BATCH["cpu"]
"""Flights that a process flies before it tells, about a second's: an interrupt loses those it is at."""
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
        plain: whether torch steps them as the equations are written (docs/plain.md).

    Raises:
        ConfigError: there is no such device here.
    """

    def __init__(
        self,
        network: Network,
        setup: Setup,
        device: str | torch.device = "cpu",
        listed: int = LISTED,
        products: Products = "bf16x3",
        generated: bool = True,
        plain: bool = False,
    ) -> None:
        self._setup = setup
        self.backend = backend = Backend.of(device, torch.float32, None, plain)
        """Library of the fields that are stepped."""
        self.device = backend.device
        self.listed = listed
        self.world = World(setup, backend.nodes)
        self._network = Network(
            network.architecture,
            {name: x.to(self.device, torch.float32) for name, x in network.tensors.items()},
        )
        self._whole = self._made(products) if generated and not plain else None

    def _made(self, products: Products) -> FlightKernel | CpuFlights | None:
        """What flies whole episodes, where that can be made; with a warning on a GPU where it cannot."""
        if getattr(self._setup.guard, "by_values", False):
            return None
        if self.device.type == "cuda":
            return FlightKernel.made(self.world, self._network, self.device, products)
        architecture = self._network.architecture
        try:
            lacking = CpuLayers.capabilities.missing(architecture)
            tables = parameters(self._network)
            program = None if lacking else trace_flight(self.world, architecture, tables)
            with one_thread():
                return program and CpuFlights(self.world, program, tables)
        except UNTRACEABLE:  # a task that does more than arithmetic on fields
            return None

    def fly(
        self, first: int, count: int, seed: int, progress: Progress = unseen
    ) -> FlightStatistics:
        """Statistics of scenarios ``first`` to ``first + count - 1``; progress reports flights.

        Raises:
            ConfigError: see `parts`.
        """
        result = FlightStatistics.none(self.world.timing.episode_steps, self.listed)
        with closing(self.parts(first, count, seed)) as parts:
            for part in parts:
                result += part
                progress(part.flights)
        return result

    def parts(self, first: int, count: int, seed: int) -> Generator[FlightStatistics]:
        """Statistics of consecutive scenarios part by part, in the order of their numbers, as they are flown.

        Raises:
            ConfigError: the seed has more than 64 bits, or a scenario's number more than 31.
            RansError: a process that flew died.
        """
        if count < 1 or first < 0 or first + count > 2**31:
            raise ConfigError(
                f"scenarios have numbers from 0 to {2**31 - 1}: there are none from "
                f"{brief(first)} to {brief(first + count - 1)}."
            )
        if self.device.type == "cpu" and count >= _MANY:
            yield from self._divided(_parts(first, count, _SHARE), seed)
            return
        size = _LAUNCH if isinstance(self._whole, FlightKernel) else BATCH[self.device.type]
        for begin, share in _parts(first, count, size):
            with one_thread():
                part = self._part(begin, share, seed)
            yield part

    def _part(self, first: int, count: int, seed: int) -> FlightStatistics:
        if self._whole is not None:
            return self._whole.fly(first, count, seed, self.listed)
        return self._stepped(seed, np.arange(first, first + count, dtype=np.int32))

    def _divided(self, parts: Sequence[tuple[int, int]], seed: int) -> Iterator[FlightStatistics]:
        """Fly by one process a processor: threads would wait for Python's lock."""
        jobs = [(*part, seed) for part in parts]
        state = self._network, self._setup, "cpu", self.listed
        yield from Workers(Flights, state, _processors(), "flew").ordered(Flights.fly, jobs)

    def _stepped(self, seed: int, numbers: np.ndarray) -> FlightStatistics:
        """Statistics of one batch that is flown step by step."""
        verdict = self.judged(self.draws(seed, numbers), effort=True)
        values = (verdict.failure(), verdict.settles, verdict.settled, *leaves(verdict.effort))
        arrays = [torch.as_tensor(x).cpu().numpy() for x in values]
        return FlightStatistics.of(
            self.world,
            numbers,
            arrays[:3],
            arrays[3:],
            self.listed,
            f"stepping, {self.device.type}",
        )

    def draws(self, seed: int, numbers: np.ndarray) -> Draws:
        """Random numbers of a seed's scenarios with these numbers, (N,) int32, on the device."""
        first = self.backend.put(numbers, torch.int32)
        return Draws(*seed_words(seed), first, 0, self.backend.fields)

    def judged(self, draws: Draws, effort: bool = False, worst: bool = False) -> FlightAccumulator:
        """Verdict on N flights, stepped, of fields (N,) of the device.

        Args:
            draws: random numbers of the flights, see `draws`.
            effort: see `rans.verdict.FlightAccumulator.begin`.
            worst: see `rans.verdict.FlightAccumulator.begin`.
        """
        world = self.world
        verdict = None
        # A state that is no longer finite flies on and may overflow: nothing of it is counted.
        with np.errstate(all="ignore"):
            for episode, outcome in self.steps(draws):
                if verdict is None:
                    verdict = FlightAccumulator.begin(world, episode, effort, worst)
                verdict = verdict.after(world, outcome)
        assert verdict is not None, "an episode has at least one step"
        return verdict

    @torch.no_grad()
    def steps(self, draws: Draws) -> Iterator[tuple[Episode, Outcome]]:
        """Every step of N flights: the episodes acted in and the outcome, of fields (N,) of the device.

        All are flown for the full time, those that are over too. See `draws`.
        """
        world = self.world
        backend = self.backend
        network = self._network
        clock = draws.first * 0
        count = len(clock)
        now = world.begin(*world.scenario(clock, draws), clock, draws)
        memory = network.initial_state(count)
        for _ in range(world.timing.episode_steps):
            seen = self._seen(world.observe(now, draws), count)
            command, memory = network.deterministic_action(seen, memory)
            columns = command.T.contiguous()
            outputs = tuple(columns.numpy() if backend.on_numpy else columns)
            outcome = step(world, now, tuple(of_outputs(world.craft, outputs)), draws)
            yield now, outcome
            now = outcome.episode

    def _seen(self, columns: tuple[Field, ...], count: int) -> torch.Tensor:
        """Observations (N, width); columns that are the same for all are numbers or of one element."""
        rows = torch.empty((len(columns), count), dtype=torch.float32, device=self.device)
        into = rows.numpy() if self.backend.on_numpy else rows
        for row, column in enumerate(columns):
            into[row] = column
        return rows.T


def _processors() -> int:
    """This process's share of the machine's, beside others that torchrun started here."""
    return max(1, processors() // int(os.environ.get("LOCAL_WORLD_SIZE", "1")))


def _parts(first: int, count: int, size: int) -> list[tuple[int, int]]:
    """First number and count of every part of at most so many scenarios."""
    return [
        (begin, min(size, first + count - begin)) for begin in range(first, first + count, size)
    ]
