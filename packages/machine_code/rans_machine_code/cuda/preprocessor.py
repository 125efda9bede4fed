"""Preprocessing of observations on a GPU: a CUDA kernel for each program of one row."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property, partial
from importlib.resources import files

import torch
from torch import Tensor

from rans.extend import Architecture, TorchPreprocessor
from rans_machine_code.cuda.launch import Function
from rans_machine_code.cuda.source import Lines, indented
from rans_machine_code.policies import RowProgram, RowsPreprocessor

_THREADS = 128
"""Threads of a CUDA block: four warps, few enough that small batches still fill several multiprocessors."""
_REAL_TYPES = {torch.float32: "float", torch.float64: "double"}
"""Type in CUDA C++ of a tensor's numbers."""


class CudaPreprocessor(RowsPreprocessor):
    """Preprocessor on a CUDA device: a kernel for each program, which NVIDIA's runtime compiler makes.

    Args:
        architecture: of the network.
        plain: preprocessor for gradients, and for what cannot be compiled.
        like: a tensor on the device, of the dtype of the network's.
    """

    def __init__(self, architecture: Architecture, plain: TorchPreprocessor, like: Tensor) -> None:
        super().__init__(architecture, plain)
        self._device = like.device
        self._real_type = _REAL_TYPES[like.dtype]

    def _run(self, number: int, rows: Tensor) -> tuple[Tensor, Tensor] | None:
        """See `RowsPreprocessor`."""
        if self._functions is None or rows.requires_grad:
            return None
        architecture = self._architecture
        widths = architecture.read_count, architecture.preprocessed_width, architecture.filtering
        outputs = rows.new_empty(len(rows), widths[number])
        sides = rows.new_empty(len(rows), dtype=torch.int64)
        self._launch(
            number, [x.data_ptr() for x in (rows, outputs, sides)], [len(rows), *rows.stride()]
        )
        return outputs, sides

    @cached_property
    def _functions(self) -> Sequence[Function] | None:
        """Compiled kernels; None without a compiler, or for a layout that does more than arithmetic on fields."""
        try:
            with torch.cuda.device(self._device):  # a compiled kernel belongs to one device
                capability = torch.cuda.get_device_capability()
                sources = self.sources()
                return [Function(text, "rows", capability) for text in sources] if sources else None
        except OSError:
            return None

    def sources(self) -> list[str] | None:
        """CUDA C++ of each program; None for a layout that does more than arithmetic on fields."""
        return self._made(partial(source, real=self._real_type))

    def _launch(self, number: int, pointers: list[int], numbers: list[int]) -> None:
        assert self._functions is not None
        with torch.cuda.device(self._device):
            blocks = -(-numbers[0] // _THREADS)
            self._functions[number].launch(blocks, _THREADS, pointers, numbers)


def source(program: RowProgram, real: str) -> str:
    """CUDA C++ of a kernel ``rows``, which runs a program for each of N rows.

    The kernel's arguments are pointers to the rows, to the outputs (N, k) and to the integers (N,); then N, and the
    strides of the rows by row and by column, in numbers.

    Args:
        program: of one row.
        real: type of its numbers, "float" or "double".
    """
    # Read one row into registers, and compute.
    *outputs, side = program.outputs
    lines = Lines()
    text = [
        "const unsigned i = blockIdx.x * blockDim.x + threadIdx.x;",
        "if (i >= count) return;",
        *(
            f"const real {s.value} = from[size_t(i) * row + size_t({k}) * column];"
            for k, s in enumerate(program.columns)
        ),
    ]
    text += lines.values(program.outputs)
    # Write its outputs.
    text += [
        f"found[size_t(i) * {len(outputs)} + {k}] = {lines.operand(s)};"
        for k, s in enumerate(outputs)
    ]
    return "\n".join(
        (
            f"typedef {real} real;",
            files("rans_machine_code.cuda").joinpath("functions.cuh").read_text(),
            f'extern "C" __global__ void __launch_bounds__({_THREADS}) rows(',
            "    const real* from, real* found, long long* which,",
            "    const int count, const int row, const int column) {",
            *indented([*text, f"which[i] = {lines.operand(side)};"]),
            "}\n",
        )
    )
