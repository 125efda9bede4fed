"""What every spacecraft observes now as one kernel: torch takes a thousand under conditions."""

from __future__ import annotations

from collections.abc import Iterator
from importlib.resources import files

from rans.extend import StepProgram, ordered
from rans_machine_code.cuda.source import THREADS, Lines, Real, indented


class Observation:
    """The columns of an observation, and what they are made of: numbers of episodes, and the task's settings."""

    def __init__(self, program: StepProgram) -> None:
        self.columns = program.observed()
        needed = set(ordered(self.columns))
        self.inputs = [
            parameter
            for parameter in (*program.memory, *program.settings)
            if parameter.symbol in needed
        ]

    def source(self, real: Real) -> str:
        """CUDA C++ of a kernel ``observe``.

        Its arguments are the seed's low and high word, the columns, the inputs; the number of spacecraft, the
        rank of this process and the number of processes.
        """
        arguments = (
            "const int* low_at",
            "const int* high_at",
            "real* columns",
            *(f"const {parameter.type}* {parameter.symbol.value}_at" for parameter in self.inputs),
            "const int count",
            "const int rank",
            "const int processes",
        )
        return "\n".join(
            (
                f"typedef {real} real;",
                files("rans_machine_code.cuda").joinpath("functions.cuh").read_text(),
                f'extern "C" __global__ void __launch_bounds__({THREADS}) observe(',
                f"    {', '.join(arguments)}) {{",
                *indented(self._body()),
                "}\n",
            )
        )

    def _body(self) -> Iterator[str]:
        """Lines of the kernel that computes the observation of every episode.

        An episode's number follows from process and place as in the step's kernel, so that noise is the
        same.
        """
        lines = Lines()
        yield "const unsigned i = blockIdx.x * blockDim.x + threadIdx.x;"
        yield "if (i >= count) return;"
        yield "const int first = int(i) * processes + rank, stride = count * processes;"
        yield from (f"const int {word} = {word}_at[0];" for word in ("low", "high"))
        yield from (
            f"const {parameter.symbol.kind} {parameter.symbol.value} = {parameter.symbol.value}_at"
            f"{'[i]' if parameter.each else '[0]'};"
            for parameter in self.inputs
        )
        yield from lines.values(self.columns)
        yield from (
            f"columns[size_t({row}) * count + i] = {lines.operand(column)};"
            for row, column in enumerate(self.columns)
        )
