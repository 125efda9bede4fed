"""The kernel as the step of an engine."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from rans.episode import Episode, World
from rans.fast.distributed import Processes
from rans.fast.kernels.cuda import Function
from rans.fast.kernels.program import Shape, trace
from rans.fast.kernels.source import THREADS, source
from rans.fast.step import Step

_C_TYPES: dict[torch.dtype, Any] = {
    torch.uint8: "unsigned char", torch.float32: "float", torch.float64: "double"}
MANY = 2**18
"""From so many spacecraft on, an even number, a thread steps two: with fewer, threads would be missed."""


class Kernel:
    """One kernel that steps N spacecraft, compiled for each type of action when it first meets it.

    It may be recorded in a CUDA graph once it is compiled: episodes and the two words of the seed lie in
    memory that never moves. Of several members, each counts the episodes of an equal part of the spacecraft.

    Raises:
        TypeError: the task's functions do more than arithmetic on fields, or a curriculum's numbers are of
            another dtype or device.
    """

    def __init__(self, world: World, episode: Episode, seed: tuple[Tensor, Tensor], processes: Processes,
                 dtype: torch.dtype, members: int = 1) -> None:
        self._program = trace(world, episode, dtype)
        self._inputs = [given.source for given in (*self._program.memory, *self._program.settings)]
        self._seed, self._members, self._thrusters = seed, members, len(world.craft.thrusters)
        self._real, self._device, self._count = dtype, self._inputs[0].device, len(self._inputs[0])
        self._together = 2 if self._count >= MANY and self._count % 2 == 0 else 1
        for given in self._program.settings:  # read as they lie in memory, so that nothing converts them
            if (given.source.dtype, given.source.device) != (self._real, self._device):
                raise TypeError(f"settings that move must be {self._real} on {self._device}, got "
                                f"{given.source.dtype} on {given.source.device}.")
        self._numbers = (self._count, self._count // members, processes.rank, processes.size,
                         self._blocks_ahead())
        self._functions: dict[torch.dtype, Function] = {}

    def source(self, action: torch.dtype) -> str:
        """The kernel's text for actions that are bytes or reals."""
        return source(self._program, self._thrusters, _C_TYPES[action], _C_TYPES[self._real],
                      self._together, self._members > 1)

    def function(self, action: torch.dtype) -> Function:
        """The compiled kernel for such actions.

        Raises:
            OSError: CUDA's runtime compiler or driver is missing.
            CudaError: they refuse.
        """
        if action not in self._functions:
            with torch.cuda.device(self._device):  # a compiled kernel belongs to one device
                capability = torch.cuda.get_device_capability()
                self._functions[action] = Function(self.source(action), "step", capability)
        return self._functions[action]

    def __call__(self, action: Tensor) -> Step:
        """Hold the thrusters for one control period, see `rans.fast.engine.Engine.step`."""
        action, count, shape = self._readable(action), self._count, self._program.shape
        reals = torch.empty((shape.reals, count), dtype=self._real, device=self._device)
        final = torch.empty((count, shape.final_width), dtype=self._real, device=self._device)
        flags = torch.empty((len(Shape.FLAGS), count), dtype=torch.bool, device=self._device)
        tensors = (action, *self._seed, reals, final, flags, *self._inputs)
        self._launch(action.dtype, [tensor.data_ptr() for tensor in tensors], self._numbers)
        terms = shape.width + shape.terms
        terminated, truncated, reached = flags
        return Step(observation=reals[:shape.width].T, reward=reals[terms], terminated=terminated,
                    truncated=truncated, final_observation=final[:, :shape.width], reached=reached,
                    terms=reals[shape.width:terms])

    def _blocks_ahead(self) -> int:
        """What so many blocks read, of actions in bytes, fills a twelfth of the second-level cache.

        More of it is thrown out before it is read, less comes too late (docs/speed.md).
        """
        if self._device.type != "cuda":
            return 0
        bytes_read = self._thrusters + sum(given.source.element_size() for given in self._program.memory)
        cache = torch.cuda.get_device_properties(self._device).L2_cache_size
        return cache // (12 * THREADS * self._together * bytes_read)

    def _launch(self, action: torch.dtype, pointers: list[int], numbers: tuple[int, ...]) -> None:
        with torch.cuda.device(self._device):
            stream = torch.cuda.current_stream().cuda_stream
            blocks = -(-numbers[0] // (THREADS * self._together))
            self.function(action).launch(blocks, THREADS, stream, pointers, numbers)

    def _readable(self, action: Tensor) -> Tensor:
        """Bytes or reals in rows that start at multiples of what is read at once."""
        if action.dtype == torch.bool:
            action = action.view(torch.uint8)
        if action.dtype not in _C_TYPES:
            action = action.to(self._real if action.is_floating_point() else torch.uint8)
        action = action.to(self._device).contiguous()
        return action if action.data_ptr() % 16 == 0 else action.clone()
