"""Very many flights of one policy, one scenario each, of which only statistics are stored."""

from __future__ import annotations

import os
import warnings
from collections.abc import Generator, Iterator, Sequence
from contextlib import closing

import numpy as np
import torch

from rans.base.errors import ConfigError, RansWarning, brief
from rans.base.processes import Workers, processors
from rans.base.progress import Progress, unseen
from rans.effectors.commands import of_outputs
from rans.episode.flight_statistics import FlightStatistics
from rans.episode.step import Episode, Outcome, Setup, World, step
from rans.episode.verdict import FlightAccumulator
from rans.fast.machine_code import Products, WholeFlights, machine_code
from rans.fast.stepping.step import Backend
from rans.fast.threads import one_thread
from rans.model.fields import Field, leaves
from rans.model.random import Draws, seed_words
from rans.model.trace import UNTRACEABLE
from rans.policy.network import Network

BATCH = {"cpu": 4096, "cuda": 2**20}
"""Number of flights stepped together, which fits the caches of a processor or fills a GPU."""
_LAUNCH = 2**26
"""Number of flights of one kernel launch, about one second."""
_MANY = 2**17
"""Number of flights from which several processes are used, which take seconds to start."""
_SHARE = 2 * BATCH["cpu"]
"""Number of flights that a process runs between two results, about one second; an interrupt loses them."""
LISTED = 100_000
"""Largest number of failed flights that are listed by number."""


class Flights:
    """Flights of a policy's deterministic actions through the scenarios of a seed, in float32.

    Args:
        network: a network.
        setup: spacecraft, task with its starts, timing and conditions
            (`rans.evaluation.fly.agent.LoadedRun.judged`).
        device: torch device of the computation.
        listed: largest number of failed flights whose numbers are stored.
        products: precision of the network's matrix products on a GPU, by the names of XLA: of one bfloat16 number,
            which changes one command in a thousand, or of two or three (docs/decisions/engine.md).
        generated: whether flights are generated programs where possible; else torch or NumPy steps them.
        plain: whether torch steps them by single operations (docs/plain.md).

    Raises:
        ConfigError: there is no such device.
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
        """Library of the fields."""
        self.device = backend.device
        self.listed = listed
        self.world = World(setup, backend.nodes)
        self._network = Network(
            network.architecture,
            {name: x.to(self.device, torch.float32) for name, x in network.tensors.items()},
        )
        self._whole = self._made(products) if generated and not plain else None

    def _made(self, products: Products) -> WholeFlights | None:
        """Generated program of whole flights; None if there is none, with a warning on a GPU that has machine code.

        Its flights equal those of `_stepped` to rounding, so that a flight near a bound may count otherwise in one
        of them.
        """
        code = machine_code(self.device.type)
        if code is None or getattr(self._setup.guard, "by_values", False):
            return None
        try:
            return code.flights(self.world, self._network, self.device, products)
        except (OSError, *UNTRACEABLE) as error:
            if self.device.type == "cuda":
                warnings.warn(
                    f"these flights are stepped, which is slower: {error}",
                    RansWarning,
                    stacklevel=3,
                )
            return None

    def fly(
        self, first: int, count: int, seed: int, progress: Progress = unseen
    ) -> FlightStatistics:
        """Statistics of scenarios ``first`` to ``first + count - 1``; the unit of progress is a flight.

        Raises:
            ConfigError: the seed has more than 64 bits, or a scenario number more than 31.
        """
        result = FlightStatistics.none(self.world.timing.episode_steps, self.listed)
        with closing(self.parts(first, count, seed)) as parts:
            for part in parts:
                result += part
                progress(part.flights)
        return result

    def parts(self, first: int, count: int, seed: int) -> Generator[FlightStatistics]:
        """Yield statistics of consecutive scenarios in parts, in the order of their numbers.

        Raises:
            ConfigError: the seed has more than 64 bits, or a scenario number more than 31.
            RansError: a worker process died.
        """
        if count < 1 or first < 0 or first + count > 2**31:
            raise ConfigError(
                f"scenarios have numbers from 0 to {2**31 - 1}: there are none from "
                f"{brief(first)} to {brief(first + count - 1)}."
            )
        if self.device.type == "cpu" and count >= _MANY:
            yield from self._divided(_parts(first, count, _SHARE), seed)
            return
        is_launched = self._whole is not None and self.device.type == "cuda"
        size = _LAUNCH if is_launched else BATCH[self.device.type]
        for begin, part_size in _parts(first, count, size):
            with one_thread():
                part = self._part(begin, part_size, seed)
            yield part

    def _part(self, first: int, count: int, seed: int) -> FlightStatistics:
        if self._whole is not None:
            return self._whole.fly(first, count, seed, self.listed)
        return self._stepped(seed, np.arange(first, first + count, dtype=np.int32))

    def _divided(self, parts: Sequence[tuple[int, int]], seed: int) -> Iterator[FlightStatistics]:
        """Fly with one process per processor, as threads would wait for Python's global lock."""
        jobs = [(*part, seed) for part in parts]
        state = self._network, self._setup, "cpu", self.listed
        yield from Workers(Flights, state, _processors(), "flew").ordered(Flights.fly, jobs)

    def _stepped(self, seed: int, numbers: np.ndarray) -> FlightStatistics:
        """Statistics of the batch with these numbers (N,), flown step by step where no kernel can."""
        world = self.world
        verdict = None
        # A state that is not finite continues and may overflow; it is not counted.
        with np.errstate(all="ignore"):
            for episode, outcome in self.steps(self.draws(seed, numbers)):
                if verdict is None:
                    verdict = FlightAccumulator.begin(world, episode, effort=True)
                verdict = verdict.after(world, outcome)
        assert verdict is not None, "an episode has at least one step"
        values = (verdict.failure(), verdict.settled, *leaves(verdict.effort))
        arrays = [torch.as_tensor(x).cpu().numpy() for x in values]
        return FlightStatistics.of(
            world,
            numbers,
            arrays[:2],
            arrays[2:],
            self.listed,
            f"stepping, {self.device.type}",
        )

    def draws(self, seed: int, numbers: np.ndarray) -> Draws:
        """Random numbers of the scenarios with these numbers (N,) int32 of a seed, on the device."""
        first = self.backend.put(numbers, torch.int32)
        return Draws(*seed_words(seed), first, 0, self.backend.fields)

    @torch.no_grad()
    def steps(self, draws: Draws) -> Iterator[tuple[Episode, Outcome]]:
        """Yield episodes and outcome of every step of N flights, with fields (N,) on the device.

        All flights continue for the full time, even after their end.

        Args:
            draws: random numbers of the flights (`draws`).
        """
        world = self.world
        backend = self.backend
        network = self._network
        clock = draws.first * 0
        count = len(clock)
        now = world.begin(*world.scenario(clock, draws), clock, draws)
        memory = network.initial_state(count)
        for _ in range(world.timing.episode_steps):
            observation = self._observation(world.observe(now, draws), count)
            command, memory = network.deterministic_action(observation, memory)
            columns = command.T.contiguous()
            outputs = tuple(columns.numpy() if backend.on_numpy else columns)
            outcome = step(world, now, tuple(of_outputs(world.craft, outputs)), draws)
            yield now, outcome
            now = outcome.episode

    def _observation(self, columns: tuple[Field, ...], count: int) -> torch.Tensor:
        """Observations (N, width) from columns, which may be numbers or have one element if all are equal."""
        rows = torch.empty((len(columns), count), dtype=torch.float32, device=self.device)
        into = rows.numpy() if self.backend.on_numpy else rows
        for row, column in enumerate(columns):
            into[row] = column
        return rows.T


def _processors() -> int | None:
    """Number of processors of this process among those of torchrun on this machine; None: all, without torchrun."""
    beside = int(os.environ.get("LOCAL_WORLD_SIZE", "1"))
    return None if beside == 1 else max(1, processors() // beside)


def _parts(first: int, count: int, size: int) -> list[tuple[int, int]]:
    """First number and count of every part of at most ``size`` scenarios."""
    return [
        (begin, min(size, first + count - begin)) for begin in range(first, first + count, size)
    ]
