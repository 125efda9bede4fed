"""What a network sees of observations, in a kernel each instead of hundreds of operations in space.

Where functions are compiled they are part of what torch's compiler fuses, and nobody asks for these.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import cached_property
from importlib.resources import files

import torch
from torch import Tensor

from rans.fast.kernels.flight_program import side, viewed
from rans.fast.kernels.launch import CudaError, Function
from rans.fast.kernels.source import Lines, indented
from rans.fast.learn.architecture import Architecture
from rans.model.trace import UNTRACEABLE, Symbol

_THREADS = 128
"""Of a block."""
_REALS = {torch.float32: "float", torch.float64: "double"}


class Look:
    """Two kernels of a network on a CUDA device, compiled when they are first asked for."""

    def __init__(self, given: Architecture, device: torch.device, dtype: torch.dtype) -> None:
        self._given, self._device, self._real = given, device, _REALS[dtype]

    def works(self, observation: Tensor) -> bool:
        """Whether there are kernels for it: not while torch's compiler looks on, nor for gradients."""
        other = torch.compiler.is_compiling() or observation.requires_grad
        return not other and self._functions is not None

    @cached_property
    def _functions(self) -> Sequence[Function] | None:
        """None without a compiler, or with a layout that does more than arithmetic on fields."""
        try:
            with torch.cuda.device(self._device):  # a compiled kernel belongs to one device
                capability = torch.cuda.get_device_capability()
                return [Function(text, "rows", capability) for text in self.sources()]
        except (OSError, CudaError, *UNTRACEABLE):
            return None

    def sources(self) -> tuple[str, str]:
        """CUDA C++ of what changes observations to the body frame, and of what chooses a side."""
        given, layout = self._given, self._given.layout

        def seen(columns: Sequence[Symbol]) -> tuple[Iterable[Symbol], Symbol]:
            way = layout.body.ahead(columns)
            if given.symmetries is None or way is None:
                return columns, Symbol.constant(0)
            which, turn, hand = side(given.symmetries, way)
            return viewed(layout.body, columns, turn, hand), which

        def turned(columns: Sequence[Symbol]) -> tuple[Iterable[Symbol], Symbol]:
            return layout.in_body(columns), Symbol.constant(0)

        return source(turned, layout.width, self._real), source(seen, layout.body.width, self._real)

    def in_body(self, observation: Tensor) -> Tensor:
        """The columns (N, k) of observations (N, width) in the body frame, as `Network.in_body`."""
        return self._rows(0, observation)[0]

    def seen(self, columns: Tensor) -> tuple[Tensor, Tensor]:
        """Columns (N, k) from the side that has the goal ahead, and which side that is, (N,) int64."""
        return self._rows(1, columns)

    def _rows(self, number: int, rows: Tensor) -> tuple[Tensor, Tensor]:
        assert self._functions is not None
        found = rows.new_empty(len(rows), self._given.layout.body.width)
        which = torch.empty(len(rows), dtype=torch.int64, device=rows.device)
        self._launch(number, [x.data_ptr() for x in (rows, found, which)], [len(rows), *rows.stride()])
        return found, which

    def _launch(self, number: int, pointers: list[int], numbers: list[int]) -> None:
        assert self._functions is not None
        with torch.cuda.device(self._device):
            stream = torch.cuda.current_stream().cuda_stream
            self._functions[number].launch(-(-numbers[0] // _THREADS), _THREADS, stream, pointers, numbers)


def source(function: Callable[[Sequence[Symbol]], tuple[Iterable[Symbol], Symbol]], width: int,
           real: str) -> str:
    """CUDA C++ of a kernel ``rows``: numbers and a whole number of each row of so many columns.

    Its arguments are the rows, the numbers found, row by row, and the whole ones; how many rows there are,
    and how far it is in memory to the next row and to the next column.
    """
    given, lines = [Symbol.input(f"column_{i}") for i in range(width)], Lines()
    numbers, which = function(given)
    found, text = list(map(Symbol.constant, numbers)), [
        "const unsigned i = blockIdx.x * blockDim.x + threadIdx.x;",
        "if (i >= count) return;",
        *(f"const real {s.value} = from[size_t(i) * row + size_t({k}) * column];"
          for k, s in enumerate(given))]
    text += lines.values([*found, which])
    text += [f"found[size_t(i) * {len(found)} + {k}] = {lines.operand(s)};" for k, s in enumerate(found)]
    return "\n".join((
        f"typedef {real} real;", files("rans.fast.kernels").joinpath("functions.cuh").read_text(),
        f'extern "C" __global__ void __launch_bounds__({_THREADS}) rows(',
        "    const real* from, real* found, long long* which,",
        "    const int count, const int row, const int column) {",
        *indented([*text, f"which[i] = {lines.operand(which)};"]), "}\n"))
