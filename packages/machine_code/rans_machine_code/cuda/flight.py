"""Whole flights in one kernel on a GPU."""

from __future__ import annotations

from functools import cached_property

import torch

from rans.extend import Failure, FlightStatistics, Network, World, seed_words
from rans_machine_code.cuda.design import Design, DoesNotFit
from rans_machine_code.cuda.flight_source import flight_source
from rans_machine_code.cuda.launch import Function
from rans_machine_code.policies import trace_flight

_OLDEST = (8, 0)
"""Capability of a GPU that multiplies bfloat16."""

_PARTS = {"bf16": 1, "bf16x3": 2, "bf16x6": 3}
"""`Design.parts` by the names of XLA."""


class FlightKernel:
    """A world's flights of one policy, on a CUDA device; compiled when it is first asked for.

    Args:
        world: in float32; its task's settings are numbers.
        network: of the agent.
        device: a CUDA device.
        shared: bytes of shared memory that a block may have there.
        products: key of `_PARTS`.
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
        products: str,
        most_warps: int | None = None,
    ) -> None:
        # Weights are copied to the device here; a network that is trained further needs a new kernel.
        self._world = world
        self._device = device
        self._products = products
        self.design = design = Design(network.architecture, _PARTS[products], shared, most_warps)
        self._program = trace_flight(world, network, lookups=True)
        self._policy = design.packed(self._program.tables).to(device)
        self.source = flight_source(self._program, design, world.timing.episode_steps)
        """CUDA C++."""

    @classmethod
    def made(
        cls, world: World, network: Network, device: torch.device, products: str
    ) -> FlightKernel:
        """A compiled kernel; raises the errors of `Function` too."""
        chip = torch.cuda.get_device_properties(device)
        if (chip.major, chip.minor) < _OLDEST:
            raise DoesNotFit(f"a GPU of capability {chip.major}.{chip.minor}, where 8.0 is needed")
        kernel = cls(world, network, device, chip.shared_memory_per_block_optin, products)  # pyrefly: ignore[missing-attribute]
        _ = kernel.function
        return kernel

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
        sums = torch.zeros(len(self._program.totals), 2, dtype=torch.float64, device=device)
        counts = torch.zeros(len(Failure) + steps + 1, dtype=torch.int64, device=device)
        failed = torch.zeros(1, dtype=torch.int32, device=device)
        numbers = torch.zeros(listed, dtype=torch.int32, device=device)
        kinds = torch.zeros(listed, dtype=torch.uint8, device=device)
        tensors = (self._policy, sums, counts, counts[len(Failure) :], failed, numbers, kinds)
        low, high = seed_words(seed)
        self._launch([x.data_ptr() for x in tensors], (low, high, first, count, listed))
        met = min(int(failed), listed)
        order = torch.argsort(numbers[:met])
        return FlightStatistics.summed(
            self._world,
            count,
            counts.cpu().numpy(),
            numbers[:met][order].cpu().numpy(),
            kinds[:met][order].cpu().numpy(),
            sums.cpu().numpy(),
            listed,
            f"flight kernel, {self._products}",
        )

    def _launch(self, pointers: list[int], numbers: tuple[int, ...]) -> None:
        with torch.cuda.device(self._device):
            blocks = torch.cuda.get_device_properties(self._device).multi_processor_count
            self.function.launch(blocks, 32 * self.design.warps, pointers, numbers)
