"""Whole flights in one kernel on a GPU."""

from __future__ import annotations

import warnings
from functools import cached_property
from typing import Literal

import numpy as np
import torch

from rans.compile.cuda.design import Design, DoesNotFit
from rans.compile.cuda.flight_source import flight_source
from rans.compile.cuda.launch import CudaError, Function
from rans.compile.flight_program import trace_flight
from rans.episode import World
from rans.errors import RansWarning
from rans.flight_statistics import QUANTITIES, FlightStatistics, Sums
from rans.model.random import seed_words
from rans.model.trace import UNTRACEABLE
from rans.policy.network import Network
from rans.verdict import Failure, last_fifth

_OLDEST = (8, 0)
"""Capability of a GPU that multiplies bfloat16."""

Products = Literal["bf16", "bf16x3", "bf16x6"]
_PARTS: dict[Products, int] = {"bf16": 1, "bf16x3": 2, "bf16x6": 3}


class FlightKernel:
    """A world's flights of one policy, on a CUDA device; compiled when it is first asked for.

    Args:
        world: in float32; its task's settings are numbers.
        network: of the agent.
        device: a CUDA device.
        shared: bytes of shared memory that a block may have there.
        products: of so many bfloat16 numbers each, as XLA names them: see `Design.parts`.
        most_warps: see `Design`.

    Raises:
        DoesNotFit: the network is of another kind.
        TypeError: the task does more than arithmetic on fields.
    """

    def __init__(
        self,
        world: World,
        network: Network,
        device: torch.device,
        shared: int,
        products: Products,
        most_warps: int | None = None,
    ) -> None:
        # Weights are copied to the device here; a network that is trained further needs a new kernel.
        self._world = world
        self._device = device
        self._products = products
        self.design = design = Design(network.architecture, _PARTS[products], shared, most_warps)
        self._policy = design.packed(network.tensors).to(device)
        program = trace_flight(world, network.architecture)
        self.source = flight_source(program, design, world.timing.episode_steps)
        """CUDA C++."""

    @classmethod
    def made(
        cls, world: World, network: Network, device: torch.device, products: Products
    ) -> FlightKernel | None:
        """A compiled kernel, or None with a warning where there can be none."""
        try:
            chip = torch.cuda.get_device_properties(device)
            if (chip.major, chip.minor) < _OLDEST:
                raise DoesNotFit(
                    f"a GPU of capability {chip.major}.{chip.minor}, where 8.0 is needed"
                )
            kernel = cls(world, network, device, chip.shared_memory_per_block_optin, products)  # pyrefly: ignore[missing-attribute]
            _ = kernel.function
        except DoesNotFit as error:
            warnings.warn(
                "these flights are stepped, which is slower: their kernel has no place for "
                f"{error}.",
                RansWarning,
                stacklevel=4,
            )
        # No compiler, or a task that does more than arithmetic on fields.
        except (OSError, CudaError, *UNTRACEABLE) as error:
            warnings.warn(
                f"these flights are stepped, which is slower: {error}", RansWarning, stacklevel=4
            )
        else:
            return kernel
        return None

    @cached_property
    def function(self) -> Function:
        """The compiled kernel; errors are those of `Function`."""
        with torch.cuda.device(self._device):  # a compiled kernel belongs to one device
            return Function(
                self.source, "flights", torch.cuda.get_device_capability(), self.design.used
            )

    def fly(self, first: int, count: int, seed: int, listed: int) -> FlightStatistics:
        """What becomes of scenarios ``first`` to ``first + count - 1``.

        Threads add their results in any order, so that sums differ in their last digits between runs; failures are
        sorted.
        """
        steps = self._world.timing.episode_steps
        device = self._device
        sums = torch.zeros(2 * len(QUANTITIES), dtype=torch.float64, device=device)
        counts = torch.zeros(len(Failure) + steps + 1, dtype=torch.int64, device=device)
        failed = torch.zeros(1, dtype=torch.int32, device=device)
        numbers = torch.zeros(listed, dtype=torch.int32, device=device)
        kinds = torch.zeros(listed, dtype=torch.uint8, device=device)
        tensors = (self._policy, sums, counts, counts[len(Failure) :], failed, numbers, kinds)
        low, high = seed_words(seed)
        self._launch([x.data_ptr() for x in tensors], (low, high, first, count, listed))
        met = min(int(failed), listed)
        order = torch.argsort(numbers[:met])
        totals = sums.view(-1, 2).cpu().numpy() * self._scales()
        ended = counts.cpu().numpy()
        failures = dict(zip(Failure, ended[: len(Failure)].tolist(), strict=True))
        return FlightStatistics(
            count,
            steps,
            ended[len(Failure) :],
            failures,
            numbers[:met][order].cpu().numpy().astype(np.int64),
            kinds[:met][order].cpu().numpy(),
            {
                name: Sums(float(total), float(squares), count)
                for name, (total, squares) in zip(QUANTITIES, totals, strict=True)
            },
            listed,
            frozenset({f"flight kernel, {self._products}"}),
        )

    def _launch(self, pointers: list[int], numbers: tuple[int, ...]) -> None:
        with torch.cuda.device(self._device):
            blocks = torch.cuda.get_device_properties(self._device).multi_processor_count
            stream = torch.cuda.current_stream().cuda_stream
            self.function.launch(blocks, 32 * self.design.warps, stream, pointers, numbers)

    def _scales(self) -> np.ndarray:
        """Of sums and sums of squares: open thrusters become a share."""
        slots = last_fifth(self._world.timing.episode_steps) * len(self._world.craft.thrusters)
        return np.array([[1.0, 1.0], [1.0, 1.0], [1.0 / slots, 1.0 / slots**2]])
