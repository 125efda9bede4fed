"""What a network sees of observations, as two straight-line programs instead of hundreds of operations.

On a GPU they are a kernel each; where functions are compiled they are part of what torch's compiler fuses,
and nobody asks for these. On a CPU NumPy runs them.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from importlib.resources import files
from itertools import islice
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor

from rans.compile.cuda.launch import CudaError, Function
from rans.compile.cuda.opaque import opaque
from rans.compile.cuda.source import Lines, indented
from rans.errors import is_installed
from rans.model.trace import UNTRACEABLE, Symbol
from rans.policy.architecture import Architecture
from rans.policy.preprocess import ColumnExecutor, TorchPreprocessor
from rans.policy.scalars import symbols
from rans.policy.symmetry import Symmetries
from rans.policy.traced import policy_program

if TYPE_CHECKING:
    from rans.compile.cpu.actor_critic import CpuActorCritic
    from rans.compile.cpu.program import CompiledProgram, Memory

_THREADS = 128
"""Of a block."""
RowProgram = Callable[[Sequence[Symbol]], tuple[list[Symbol], Symbol]]
"""Numbers and a whole number of the columns of one row."""
_REALS = {torch.float32: "float", torch.float64: "double"}


def compiled_preprocessor(
    architecture: Architecture, views: Symmetries | None, like: Tensor
) -> ColumnExecutor:
    """Preprocessor of a network with tensors like this one: programs where they are faster.

    On a CPU that is nowhere without llvmlite, and in double precision, which is for comparisons.
    """
    plain = TorchPreprocessor(architecture, views)
    if like.is_cuda:
        return CudaPreprocessor(architecture, plain, like.device, like.dtype)
    return (
        CpuPreprocessor(architecture, plain)
        if like.is_cpu and like.dtype == torch.float32 and is_installed("llvmlite")
        else plain
    )


def row_programs(architecture: Architecture) -> list[tuple[RowProgram, int]]:
    """What changes observations to the body frame, chooses a side, and filters; of how many columns each."""
    policy = policy_program(architecture)
    views = ["view"] if policy.has("view") else []

    def turned(columns: Sequence[Symbol]) -> tuple[list[Symbol], Symbol]:
        outputs, _ = symbols(policy, {"observation": columns}, ["body"])
        return outputs["body"], Symbol.constant(0)

    def seen(columns: Sequence[Symbol]) -> tuple[list[Symbol], Symbol]:
        known = {
            "body": columns[: architecture.column_count],
            "filters": columns[architecture.column_count :],
        }
        outputs, _ = symbols(policy, known, ["seen", *views])
        return outputs["seen"], outputs["view"][0] if views else Symbol.constant(0)

    def expected(row: Sequence[Symbol]) -> tuple[list[Symbol], Symbol]:
        parts = {
            "body": architecture.column_count,
            "filters": architecture.filtering,
            "command": architecture.thrusters,
        }
        rest = iter(row)
        known = {name: list(islice(rest, width)) for name, width in parts.items()}
        outputs, _ = symbols(policy, known, ["filters_after"])
        return outputs["filters_after"], Symbol.constant(0)

    width = architecture.column_count + architecture.filtering
    programs = [(turned, architecture.layout.width), (seen, width)]
    return (
        [*programs, (expected, width + architecture.thrusters)]
        if architecture.filters
        else programs
    )


class CpuPreprocessor(ColumnExecutor):
    """By NumPy, in single precision; not for two threads at once."""

    _MOST = 4096
    """Rows; more, as a whole rollout's, are left to torch, which divides them among a processor's lanes."""

    def __init__(self, architecture: Architecture, plain: TorchPreprocessor) -> None:
        self._architecture = architecture
        self._plain = plain
        self._answers: tuple[Tensor, CpuActorCritic | None] | None = None

    def __reduce__(self) -> tuple[type[CpuPreprocessor], tuple[Architecture, TorchPreprocessor]]:
        """A copy has memory of its own."""
        return CpuPreprocessor, (self._architecture, self._plain)

    def in_body(self, observation: Tensor) -> Tensor:
        """See `ColumnExecutor`."""
        return (
            self._rows(0, observation)[0]
            if self._works(observation)
            else self._plain.in_body(observation)
        )

    def viewed(self, rows: Tensor) -> tuple[Tensor, Tensor]:
        """See `ColumnExecutor`."""
        return self._rows(1, rows) if self._works(rows) else self._plain.viewed(rows)

    def expected(self, rows: Tensor) -> Tensor:
        """See `ColumnExecutor`."""
        return self._rows(2, rows)[0] if self._works(rows) else self._plain.expected(rows)

    def whole(
        self, observation: Tensor, tensors: Mapping[str, Tensor]
    ) -> tuple[Tensor, Tensor] | None:
        """See `ColumnExecutor`."""
        weight = tensors["value_net.weight"]
        if weight.dim() > 2 or torch.is_grad_enabled() or not _may(observation):
            return None
        if self._answers is None or self._answers[0] is not weight:
            self._answers = weight, self._answering(tensors)
        return self._answers[1] and self._answers[1](observation)

    def _answering(self, tensors: Mapping[str, Tensor]) -> CpuActorCritic | None:
        from rans.compile.cpu.actor_critic import CpuActorCritic  # LLVM, which a GPU does not need

        architecture = self._architecture
        with contextlib.suppress(*UNTRACEABLE):
            if not CpuActorCritic.capabilities.missing(architecture):
                return CpuActorCritic(architecture, tensors)
        return None

    def _works(self, rows: Tensor) -> bool:
        return _may(rows) and len(rows) <= self._MOST and self._programs is not None

    @cached_property
    def _programs(self) -> list[CompiledProgram] | None:
        from rans.compile.cpu.program import CompiledProgram  # LLVM, which a GPU does not need

        made = []
        with contextlib.suppress(*UNTRACEABLE):
            for program, width in row_programs(self._architecture):
                columns = [Symbol.input(f"column_{i}") for i in range(width)]
                outputs, which = program(columns)
                made.append(CompiledProgram(columns, [*outputs, which]))
            return made
        return None

    @cached_property
    def _memory(self) -> dict[tuple[int, int], Memory]:
        return {}

    def _rows(self, number: int, rows: Tensor) -> tuple[Tensor, Tensor]:
        assert self._programs is not None
        if (memory := self._memory.get((number, len(rows)))) is None:
            self._memory[number, len(rows)] = memory = self._programs[number].memory(len(rows))
        memory.give(rows.numpy().T)
        *outputs, which = memory.run(0)
        side = torch.from_numpy(np.broadcast_to(which, len(rows)).astype(np.int64))
        return torch.from_numpy(np.stack(outputs)).T, side


class CudaPreprocessor(ColumnExecutor):
    """By a kernel each on a CUDA device, compiled when they are first asked for.

    Torch's compiler takes minutes over filters: to it, these kernels are one operation.
    """

    def __init__(
        self,
        architecture: Architecture,
        plain: TorchPreprocessor,
        device: torch.device,
        dtype: torch.dtype,
    ) -> None:
        self._architecture = architecture
        self._plain = plain
        self._device = device
        self._real = _REALS[dtype]
        self._opaque = (
            opaque(self) if architecture.filters and self._functions is not None else None
        )

    def in_body(self, observation: Tensor) -> Tensor:
        """See `ColumnExecutor`."""
        return (
            self.rows(0, observation)[0]
            if self._works(observation)
            else self._plain.in_body(observation)
        )

    def viewed(self, rows: Tensor) -> tuple[Tensor, Tensor]:
        """See `ColumnExecutor`."""
        if self._opaque is not None:
            return self._opaque(1, rows)
        return self.rows(1, rows) if self._works(rows) else self._plain.viewed(rows)

    def expected(self, rows: Tensor) -> Tensor:
        """See `ColumnExecutor`."""
        return self._plain.expected(rows) if self._opaque is None else self._opaque(2, rows)[0]

    def _works(self, rows: Tensor) -> bool:
        return _may(rows) and self._functions is not None

    @cached_property
    def _functions(self) -> Sequence[Function] | None:
        """None without a compiler, or with a layout that does more than arithmetic on fields."""
        try:
            with torch.cuda.device(self._device):  # a compiled kernel belongs to one device
                capability = torch.cuda.get_device_capability()
                return [Function(text, "rows", capability) for text in self.sources()]
        except (OSError, CudaError, *UNTRACEABLE):
            return None

    def sources(self) -> list[str]:
        """CUDA C++ of the programs."""
        return [
            source(program, width, self._real)
            for program, width in row_programs(self._architecture)
        ]

    def room(self, number: int, rows: Tensor) -> tuple[Tensor, Tensor]:
        """For what the program of this number finds of rows."""
        architecture = self._architecture
        result = rows.new_empty(
            len(rows),
            (architecture.column_count, architecture.preprocessed_width, architecture.filtering)[
                number
            ],
        )
        return result, rows.new_empty(len(rows), dtype=torch.int64)

    def rows(self, number: int, rows: Tensor) -> tuple[Tensor, Tensor]:
        """What it finds: numbers, row by row, and a whole number of each."""
        outputs, which = self.room(number, rows)
        self._launch(
            number, [x.data_ptr() for x in (rows, outputs, which)], [len(rows), *rows.stride()]
        )
        return outputs, which

    def _launch(self, number: int, pointers: list[int], numbers: list[int]) -> None:
        assert self._functions is not None
        with torch.cuda.device(self._device):
            stream = torch.cuda.current_stream().cuda_stream
            self._functions[number].launch(
                -(-numbers[0] // _THREADS), _THREADS, stream, pointers, numbers
            )


def source(program: RowProgram, width: int, real: str) -> str:
    """CUDA C++ of a kernel ``rows``: numbers and a whole number of each row of so many columns.

    Its arguments are the rows, the numbers found, row by row, and the whole ones; how many rows there are,
    and how far it is in memory to the next row and to the next column.
    """
    columns = [Symbol.input(f"column_{i}") for i in range(width)]
    lines = Lines()
    outputs, which = program(columns)
    text = [
        "const unsigned i = blockIdx.x * blockDim.x + threadIdx.x;",
        "if (i >= count) return;",
        *(
            f"const real {s.value} = from[size_t(i) * row + size_t({k}) * column];"
            for k, s in enumerate(columns)
        ),
    ]
    text += lines.values([*outputs, which])
    text += [
        f"found[size_t(i) * {len(outputs)} + {k}] = {lines.operand(s)};"
        for k, s in enumerate(outputs)
    ]
    return "\n".join(
        (
            f"typedef {real} real;",
            files("rans.compile.cuda").joinpath("functions.cuh").read_text(),
            f'extern "C" __global__ void __launch_bounds__({_THREADS}) rows(',
            "    const real* from, real* found, long long* which,",
            "    const int count, const int row, const int column) {",
            *indented([*text, f"which[i] = {lines.operand(which)};"]),
            "}\n",
        )
    )


def _may(rows: Tensor) -> bool:
    """Whether nobody looks on: torch's compiler, which makes better kernels, or gradients."""
    return not (torch.compiler.is_compiling() or rows.requires_grad)
