"""Preprocessing of observations as straight-line programs, instead of hundreds of torch's operations.

There are up to three programs, each a function of one row (`row_programs`). On a GPU each is a CUDA kernel; on a
CPU machine code runs them over NumPy arrays.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from functools import cached_property
from importlib.resources import files
from itertools import islice
from typing import Any, NamedTuple

import torch
from torch import Tensor

from rans.compile.cuda.launch import CudaError, Function
from rans.compile.cuda.opaque import opaque
from rans.compile.cuda.source import Lines, indented
from rans.compile.machine_code import machine_code
from rans.model.trace import UNTRACEABLE, Symbol
from rans.policy.architecture import Architecture
from rans.policy.preprocess import ColumnExecutor, TorchPreprocessor
from rans.policy.program import inputs
from rans.policy.scalars import symbols
from rans.policy.symmetry import Symmetries
from rans.policy.traced import policy_program

_THREADS = 128
"""Threads of a CUDA block: four warps, few enough that small batches still fill several multiprocessors."""
_REAL_TYPES = {torch.float32: "float", torch.float64: "double"}
"""Type in CUDA C++ of a tensor's numbers."""

RowProgram = Callable[[Sequence[Symbol]], tuple[list[Symbol], Symbol]]
"""Outputs (numbers and one integer) as symbols, from the columns of one row."""
_IN_BODY = 0
_VIEWED = 1
_NEXT_FILTER_MEMORY = 2
"""Indices into `row_programs`, by the method of `ColumnExecutor` that each computes."""


def compiled_preprocessor(
    architecture: Architecture, views: Symmetries | None, like: Tensor
) -> ColumnExecutor:
    """Fastest preprocessor for a network whose tensors have the device and dtype of ``like``.

    On a CPU without machine code, and there in double precision, which only serves comparisons, it is torch's. Its
    columns are (N, width); all executors see the same numbers to rounding.
    """
    plain = TorchPreprocessor(architecture, views)
    if like.is_cuda:
        return CudaPreprocessor(architecture, plain, like.device, like.dtype)
    code = machine_code() if like.is_cpu and like.dtype == torch.float32 else None
    return code.preprocessor(PolicyPrograms(architecture), plain) if code else plain


def row_programs(architecture: Architecture) -> list[tuple[RowProgram, int]]:
    """Programs of one row, each with the number of columns that it reads.

    They compute the body frame of an observation, the view of columns and filters, and, where there are filters,
    their next memory; in the order of `_IN_BODY`, `_VIEWED` and `_NEXT_FILTER_MEMORY`. The integer of a program is
    the side of the spacecraft that is viewed, else 0.
    """
    policy = policy_program(architecture)
    views = ["view"] if policy.has("view") else []

    # From the observation into the axes of the body.
    def in_body(columns: Sequence[Symbol]) -> tuple[list[Symbol], Symbol]:
        outputs, _ = symbols(policy, {"observation": columns}, ["body"])
        return outputs["body"], Symbol.constant(0)

    # Filters, and the symmetric view of the spacecraft.
    def viewed(columns: Sequence[Symbol]) -> tuple[list[Symbol], Symbol]:
        given = {
            "body": columns[: architecture.read_count],
            "filters": columns[architecture.read_count :],
        }
        outputs, _ = symbols(policy, given, ["seen", *views])
        return outputs["seen"], outputs["view"][0] if views else Symbol.constant(0)

    # Memory of the filters, after the command is known.
    def next_filter_memory(row: Sequence[Symbol]) -> tuple[list[Symbol], Symbol]:
        """The filters' next memory of a row of body columns, memory and command, in the order of `widths`.

        Columns come concatenated, so that both executors below must cut and join tensors in this order too.
        """
        widths = {
            "body": architecture.read_count,
            "filters": architecture.filtering,
            "command": architecture.thrusters,
        }
        rest = iter(row)
        given = {name: list(islice(rest, width)) for name, width in widths.items()}
        outputs, _ = symbols(policy, given, ["filters_after"])
        return outputs["filters_after"], Symbol.constant(0)

    width = architecture.read_count + architecture.filtering
    programs: list[Any] = [(in_body, architecture.layout.width), (viewed, width)]
    return (
        [*programs, (next_filter_memory, width + architecture.thrusters)]
        if architecture.filtering
        else programs
    )


class NetworkProgram(NamedTuple):
    """Log-odds of on/off thrusters as symbols, with dense layers between two programs of numbers."""

    observed: tuple[Symbol, ...]
    """Columns of an observation."""
    statistics: tuple[Symbol, ...]
    """Mean, scale and zoomed scale of every column."""
    features: tuple[Symbol, ...]
    """Inputs of the layers."""
    outputs: tuple[Symbol, ...]
    """Outputs of the layers, inputs of what follows."""
    log_odds: tuple[Symbol, ...]
    """In the order of the spacecraft's thrusters."""


class PolicyPrograms:
    """Programs of a policy, traced when they are asked for; None where it takes more than arithmetic.

    Args:
        architecture: of the policy.
    """

    def __init__(self, architecture: Architecture) -> None:
        self.architecture = architecture

    def rows(self) -> list[tuple[list[Symbol], list[Symbol]]] | None:
        """Inputs and outputs of every one of `row_programs`, of which the last is the side."""
        traced = []
        with contextlib.suppress(*UNTRACEABLE):
            for program, width in row_programs(self.architecture):
                columns = inputs("column", width)
                outputs, side = program(columns)
                traced.append((columns, [*outputs, side]))
            return traced
        return None

    def network(self) -> NetworkProgram | None:
        """The whole actor, of one stage of layers."""
        architecture = self.architecture
        observed = inputs("observed", architecture.layout.width)
        with contextlib.suppress(*UNTRACEABLE):
            values, (stage,) = symbols(
                policy_program(architecture), {"observation": observed}, ["placed_0"]
            )
            statistics = [
                symbol
                for name in ("mean", "scale", "zoom")
                for symbol in inputs(name, architecture.column_count)
            ]
            parts = (observed, statistics, stage.inputs, stage.outputs, values["placed_0"])
            return NetworkProgram(*map(tuple, parts))
        return None


class CudaPreprocessor(ColumnExecutor):
    """Preprocessor on a CUDA device: a kernel for each program, compiled at its first use.

    Torch's compiler takes seconds over views of a spacecraft and minutes over filters. So it treats each kernel as
    one operation, which it does not compile (docs/decisions/kernels.md).

    Args:
        architecture: of the network.
        plain: preprocessor for gradients, and for what cannot be compiled.
        device: a CUDA device.
        dtype: float32 or float64.
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
        self._real_type = _REAL_TYPES[dtype]
        self._opaque = None if self._functions is None else opaque(self)

    def in_body(self, observation: Tensor) -> Tensor:
        """See `ColumnExecutor`."""
        result = self._run(_IN_BODY, observation)
        return self._plain.in_body(observation) if result is None else result[0]

    def viewed(self, rows: Tensor) -> tuple[Tensor, Tensor]:
        """See `ColumnExecutor`."""
        result = self._run(_VIEWED, rows)
        return self._plain.viewed(rows) if result is None else result

    def next_filter_memory(self, rows: Tensor) -> Tensor:
        """See `ColumnExecutor`."""
        result = self._run(_NEXT_FILTER_MEMORY, rows)
        return self._plain.next_filter_memory(rows) if result is None else result[0]

    def _run(self, number: int, rows: Tensor) -> tuple[Tensor, Tensor] | None:
        """Outputs and integers as `rows` has them; None if torch's operations must compute them.

        An operation of torch's imports its compiler at the first call, so that only compiled functions have it.
        """
        if self._opaque is None or rows.requires_grad:
            return None
        return (
            self._opaque(number, rows) if torch.compiler.is_compiling() else self.rows(number, rows)
        )

    @cached_property
    def _functions(self) -> Sequence[Function] | None:
        """Compiled kernels; None without a compiler, or for a layout that does more than arithmetic on fields."""
        try:
            with torch.cuda.device(self._device):  # a compiled kernel belongs to one device
                capability = torch.cuda.get_device_capability()
                return [Function(text, "rows", capability) for text in self.sources()]
        except (OSError, CudaError, *UNTRACEABLE):
            return None

    def sources(self) -> list[str]:
        """CUDA C++ of each program."""
        return [
            source(program, width, self._real_type)
            for program, width in row_programs(self._architecture)
        ]

    def room(self, number: int, rows: Tensor) -> tuple[Tensor, Tensor]:
        """Uninitialised tensors for the outputs (N, k) and integers (N,) of a program, by its index."""
        architecture = self._architecture
        widths = architecture.read_count, architecture.preprocessed_width, architecture.filtering
        outputs = rows.new_empty(len(rows), widths[number])
        return outputs, rows.new_empty(len(rows), dtype=torch.int64)

    def rows(self, number: int, rows: Tensor) -> tuple[Tensor, Tensor]:
        """Outputs (N, k) and integers (N,) of a program, by its index, of rows (N, width) of any strides."""
        outputs, sides = self.room(number, rows)
        self._launch(
            number, [x.data_ptr() for x in (rows, outputs, sides)], [len(rows), *rows.stride()]
        )
        return outputs, sides

    def _launch(self, number: int, pointers: list[int], numbers: list[int]) -> None:
        assert self._functions is not None
        with torch.cuda.device(self._device):
            stream = torch.cuda.current_stream().cuda_stream
            blocks = -(-numbers[0] // _THREADS)
            self._functions[number].launch(blocks, _THREADS, stream, pointers, numbers)


def source(program: RowProgram, width: int, real: str) -> str:
    """CUDA C++ of a kernel ``rows``, which runs a program for each of N rows.

    The kernel's arguments are pointers to the rows, to the outputs (N, k) and to the integers (N,); then N, and the
    strides of the rows by row and by column, in numbers.

    Args:
        program: of one row.
        width: columns of a row.
        real: type of its numbers, "float" or "double".
    """
    # Read one row into registers, and compute.
    columns = inputs("column", width)
    lines = Lines()
    outputs, side = program(columns)
    text = [
        "const unsigned i = blockIdx.x * blockDim.x + threadIdx.x;",
        "if (i >= count) return;",
        *(
            f"const real {s.value} = from[size_t(i) * row + size_t({k}) * column];"
            for k, s in enumerate(columns)
        ),
    ]
    text += lines.values([*outputs, side])
    # Write its outputs.
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
            *indented([*text, f"which[i] = {lines.operand(side)};"]),
            "}\n",
        )
    )
