"""The generated kernel as the step of an engine.

Results equal those of NumPy to rounding, row by row (`tests/cuda/test_step.py`).
"""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from rans.extend import Draws, Step, StepProgram
from rans_machine_code.cuda.launch import Function
from rans_machine_code.cuda.observation import Observation
from rans_machine_code.cuda.source import THREADS, source

_C_TYPES: dict[torch.dtype, Any] = {
    torch.uint8: "unsigned char",
    torch.float32: "float",
    torch.float64: "double",
}
MANY = 2**18
"""Number of spacecraft from which a thread steps two, if it is even: with fewer there are too few threads."""
LONG = 950
"""Number of operations from which a step is not bound by memory: two spacecraft in a thread would only need more
registers and instruction cache (docs/decisions/engine.md)."""


class Kernel:
    """One kernel that steps N spacecraft, compiled for each type of action at its first call.

    A CUDA graph may record it once it is compiled: episodes and the two words of the seed have constant addresses.

    Args:
        program: of one step of these episodes.
        draws: random numbers of the episodes.

    Raises:
        TypeError: the settings of a curriculum are on another device or of another dtype.
    """

    def __init__(self, program: StepProgram, draws: Draws) -> None:
        self._program = program
        self._observation = Observation(program)
        self._inputs = [
            parameter.source for parameter in (*self._program.memory, *self._program.settings)
        ]
        self._seed = (draws.low, draws.high)
        self._thrusters = len(program.commands)
        self._real, self._device = draws.dtype, self._inputs[0].device
        self._count = len(self._inputs[0])
        is_vectorized = self._count >= MANY and self._count % 2 == 0
        self._together = 2 if is_vectorized and self._program.operations < LONG else 1
        for parameter in self._program.settings:  # They are read without conversion.
            if (parameter.source.dtype, parameter.source.device) != (self._real, self._device):
                raise TypeError(
                    f"settings that move must be {self._real} on {self._device}, got "
                    f"{parameter.source.dtype} on {parameter.source.device}."
                )
        # A process's first episode has the number of its rank among the processes, which share all episodes.
        self._numbers = (
            self._count,
            int(draws.first[0]),
            draws.stride // self._count,
            self._blocks_ahead(),
        )
        self._functions: dict[torch.dtype | None, Function] = {}

    @classmethod
    def made(cls, program: StepProgram, draws: Draws) -> Kernel:
        """A kernel that is compiled for reals; raises the errors of `Function` too."""
        kernel = cls(program, draws)
        kernel.function(kernel._real)
        return kernel

    def source(self, action: torch.dtype | None) -> str:
        """CUDA C++ of the kernel for actions of bytes or reals; None: of the kernel of observations."""
        if action is None:
            return self._observation.source(_C_TYPES[self._real])
        return source(
            self._program,
            self._thrusters,
            _C_TYPES[action],
            _C_TYPES[self._real],
            self._together,
        )

    def function(self, action: torch.dtype | None) -> Function:
        """Compiled kernel of `source`; raises the errors of `Function`."""
        if action not in self._functions:
            with torch.cuda.device(self._device):  # a compiled kernel belongs to one device
                capability = torch.cuda.get_device_capability()
                name = "step" if action else "observe"
                self._functions[action] = Function(self.source(action), name, capability)
        return self._functions[action]

    def __call__(self, action: Tensor) -> Step:
        """Hold the thrusters for one control period, see `Engine.step`; changes the episodes' memory in place.

        Pointers and numbers come in the order of the arguments in `rans_machine_code.cuda.source`, unchecked.
        """
        action = self._readable(action)
        count = self._count
        shape = self._program.shape
        reals = torch.empty((shape.reals, count), dtype=self._real, device=self._device)
        final = torch.empty((count, shape.final_width), dtype=self._real, device=self._device)
        flags = torch.empty((len(shape.FLAGS), count), dtype=torch.bool, device=self._device)
        tensors = (action, *self._seed, reals, final, flags, *self._inputs)
        self._launch(
            action.dtype, [tensor.data_ptr() for tensor in tensors], self._numbers, self._together
        )
        terms = shape.width + shape.terms
        terminated, truncated, reached = flags
        return Step(
            observation=reals[: shape.width].T,
            reward=reals[terms],
            terminated=terminated,
            truncated=truncated,
            final_observation=final[:, : shape.width],
            reached=reached,
            terms=reals[shape.width : terms],
        )

    def observe(self) -> Tensor:
        """The current observation, (N, width), see `rans.fast.engine.Engine.observe`."""
        parameter = self._observation
        result = torch.empty(
            (len(parameter.columns), self._count), dtype=self._real, device=self._device
        )
        tensors = (*self._seed, result, *(each.source for each in parameter.inputs))
        self._launch(None, [tensor.data_ptr() for tensor in tensors], self._numbers[:-1], 1)
        return result.T

    def _blocks_ahead(self) -> int:
        """Number of blocks whose reads, with actions in bytes, fill a twelfth of the second-level cache.

        With more, data is evicted before it is read; with fewer, it comes too late (docs/speed.md).
        """
        if self._device.type != "cuda":
            return 0
        bytes_read = self._thrusters + sum(
            parameter.source.element_size() for parameter in self._program.memory
        )
        cache = torch.cuda.get_device_properties(self._device).L2_cache_size
        return cache // (12 * THREADS * self._together * bytes_read)

    def _launch(
        self,
        action: torch.dtype | None,
        pointers: list[int],
        numbers: tuple[int, ...],
        together: int,
    ) -> None:
        """Launch the kernel on torch's current stream; addresses and numbers are in the order of the text."""
        with torch.cuda.device(self._device):
            blocks = -(-numbers[0] // (THREADS * together))
            self.function(action).launch(blocks, THREADS, pointers, numbers)

    def _readable(self, action: Tensor) -> Tensor:
        """Action as bytes or reals, in rows that are aligned for the reads of the kernel."""
        if action.dtype == torch.bool:
            action = action.view(torch.uint8)
        if action.dtype not in _C_TYPES:
            action = action.to(self._real if action.is_floating_point() else torch.uint8)
        action = action.to(self._device).contiguous()
        return action if action.data_ptr() % 16 == 0 else action.clone()
