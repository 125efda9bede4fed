"""The text of a flight's kernel in CUDA C++, from its program and the design of its network.

A thread flies one scenario after the other, a warp 32 at a time: what each sees goes through the network together.
What it prints must equal the engine's own flights: tests run the text on a CPU and compare.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from importlib.resources import files

from rans.extend import ACTIVATIONS, Symbol, inputs
from rans.policy.memory import averaged
from rans_machine_code.cuda.design import FEW_INPUTS, Design
from rans_machine_code.cuda.source import Lines, indented
from rans_machine_code.policies import FlightProgram, Lookup

_TOGETHER = 16
"""Inputs of the network that a thread writes at once: a multiple of what one piece of memory holds, eight."""
_ARGUMENTS = (
    "const uint4* policy",
    "double* sums",
    "unsigned long long* failures",
    "unsigned long long* settled_at",
    "int* failed",
    "int* numbers",
    "unsigned char* kinds",
    "const int low",
    "const int high",
    "const int first",
    "const int count",
    "const int room",
)


def flight_source(program: FlightProgram, design: Design, steps: int) -> str:
    """CUDA C++ of a kernel ``flights``, of episodes of so many steps.

    Its arguments are the policy (`Design.packed`); the totals' sums and sums of squares, by turns, counts of
    failures by kind and of settled flights by instant, to which it adds; how many failed flights are listed
    already, and their numbers and kinds; the seed's words, the first scenario's number, how many there are,
    and how many failed ones may be listed.
    """
    texts = (
        files("rans_machine_code.cuda").joinpath(name).read_text()
        for name in ("functions.cuh", "warp.cuh", "policy.cuh")
    )
    return "\n".join(
        (
            "typedef float real;",
            *texts,
            *activation_source(design.given.activation),
            *_tables(program),
            f'extern "C" __global__ void __launch_bounds__({32 * design.warps}, 1) flights(',
            f"    {', '.join(_ARGUMENTS)}) {{",
            *indented(_Writer(program, design, steps).body()),
            "}\n",
        )
    )


def activation_source(name: str) -> Iterator[str]:
    """The struct of an activation that policy.cuh does not have, from its formula."""
    activation = ACTIVATIONS[name]
    if activation.slope is not None:
        return
    lines = Lines()
    x = Symbol.input("x")
    value = activation.formula(x)
    yield f"struct {name.capitalize()} {{"
    yield "  static __device__ inline float of(float x) {"
    yield from (f"    {line}" for line in lines.values([value]))
    yield f"    return {lines.operand(value)};"
    yield "  }"
    yield "  static __device__ inline float quick(float x) { return of(x); }"
    yield "};"


def _tables(program: FlightProgram) -> Iterator[str]:
    """Where the numbers of lookups are, by the side of the spacecraft."""
    policy = program.policy
    of_row = () if policy.row is None else policy.row.lookups
    for lookup in (*policy.lookups, *of_row):
        yield f"__device__ const unsigned char {lookup.name}[][{lookup.table.shape[1]}] = {{"
        yield from (f"  {{{', '.join(map(str, row))}}}," for row in lookup.table.tolist())
        yield "};"


class _Writer(Lines):
    """Writes the kernel's text; ``names`` are the C++ expressions of symbols that are known at its line."""

    def __init__(self, program: FlightProgram, design: Design, steps: int) -> None:
        super().__init__()
        self._program = program
        self._design = design
        self._architecture = design.given
        self._steps = steps
        for name in ("mean", "scale", "zoom"):
            for i, symbol in enumerate(inputs(name, design.given.column_count)):
                self.names[symbol] = f"{name}[{i}]"

    def expression(self, symbol: Symbol, args: list[str]) -> str:
        """See `Lines`; a hyperbolic tangent is as exact as the products."""
        if symbol.operation == "tanh":
            return f"activated<{self._design.parts}, Tanh>({args[0]})"
        return super().expression(symbol, args)

    def body(self) -> Iterator[str]:
        """Every warp flies its share, and adds it to the results."""
        warps = self._design.warps
        yield from self._memory()
        yield f"for (unsigned group = blockIdx.x * {warps} + warp; group < (unsigned(count) + 31) / 32;"
        yield f"     group += gridDim.x * {warps}) {{"
        yield from indented(self._flight())
        yield "}"

    def _memory(self) -> Iterator[str]:
        """The policy, and where each warp puts what its network is given and answers.

        Names that `policy.cuh` and the lines below use; addresses are those of `Design.places`, in pieces of 16
        bytes. Single numbers are read one by one, rows of the head in pieces of 8 bytes and of layers in 16, as
        `policy.cuh` takes its pointers. A warp's part is zeroed once, since columns that pad its inputs are never
        written.
        """
        design = self._design
        threads = 32 * self._design.warps
        yield "extern __shared__ uint4 shared[];"
        yield f"for (int i = threadIdx.x; i < {design.kept // 16}; i += {threads}) shared[i] = policy[i];"
        yield f"for (int i = threadIdx.x; i < {(design.warps * design.per_warp) // 16}; i += {threads})"
        yield f"  shared[{design.kept // 16} + i] = uint4{{0, 0, 0, 0}};"
        yield "__syncthreads();"
        yield "const int warp = threadIdx.x / 32;"
        for name, place in design.places.items():
            if name not in ("small", "end"):
                kind = (
                    "float"
                    if place < design.places["small"]
                    else "uint2"
                    if name == "head"
                    else "uint4"
                )
                base = "shared" if place < design.kept else "policy"
                yield f"const {kind}* {name} = reinterpret_cast<const {kind}*>({base} + {place // 16});"
        own = f"shared + {design.kept // 16} + warp * {design.per_warp // 16}"
        yield (
            f"const Inputs<{design.parts}> inputs = {{reinterpret_cast<unsigned short*>({own}), "
            f"{design.stride}}};"
        )
        yield f"float* const outputs = reinterpret_cast<float*>({own} + {design.inputs_bytes // 16});"

    def _flight(self) -> Iterator[str]:
        """Lines of the kernel: start of a flight, then a loop over its control periods.

        Names that the loop's body gives to values are forgotten after it.
        """
        program = self._program
        recalled = self._architecture.rows
        yield "const unsigned index = group * 32 + lane();"
        yield "const int number = first + int(index);"
        yield from self.values(carried.initial for carried in program.carried)
        yield from (
            f"{carried.symbol.kind} {carried.symbol.value} = {self.operand(carried.initial)};"
            for carried in program.carried
        )
        if recalled:
            yield f"real memory[{recalled}] = {{}};"
        known = dict(self.names)
        yield "#pragma unroll 1"
        yield f"for (int step = 0; step < {self._steps}; ++step) {{"
        yield from indented(self._step())
        yield "}"
        self.names = known
        yield from self._verdict()

    def _step(self) -> Iterator[str]:
        """Lines of one control period: observe, act, step, and fold the outcome.

        All next values are computed before the first is stored, since each may depend on the others' old ones.
        """
        program = self._program
        yield from self.values([program.policy.view])
        yield from self._shown()
        yield "__syncwarp();"
        yield from self._network()
        yield "__syncwarp();"
        yield from self._commands()
        yield from self._remember()
        moved = [carried for carried in program.carried if carried.next is not carried.symbol]
        yield from self.values(carried.next for carried in moved)
        for carried in moved:
            yield f"const {carried.symbol.kind} next_{carried.symbol.value} = {self.operand(carried.next)};"
        yield from (f"{carried.symbol.value} = next_{carried.symbol.value};" for carried in moved)
        yield from self.values([program.going])
        yield f"if (!__any_sync(~0u, {self.operand(program.going)})) break;"

    def _shown(self) -> Iterator[str]:
        """The first layer's inputs, so many at once as lie in one piece of memory; then the history's rows.

        Names that are valid only within the loop over rows are forgotten after it.
        """
        architecture = self._architecture
        (stage,) = self._program.policy.stages
        alone = stage.inputs[: architecture.inputs - architecture.rows]
        for first in range(0, len(alone), _TOGETHER):
            yield from self._show(alone[first : first + _TOGETHER], str(first))
        if (row := self._program.policy.row) is None:
            return
        yield f"for (int row = 0; row < {architecture.recalled}; ++row) {{"
        yield f"  const int at = row * {architecture.row};"
        known = dict(self.names)
        self.names |= {symbol: f"memory[at + {i}]" for i, symbol in enumerate(row.inputs)}
        yield from indented(self._looked_up(row.lookups, row.inputs, "memory[at + {}]"))
        yield from indented(self._show(row.features, f"{len(alone)} + at"))
        yield "}"
        self.names = known

    def _show(self, values: Sequence[Symbol], place: str) -> Iterator[str]:
        """Some inputs of the first layer, from this column on."""
        yield from self.values(values)
        yield "{"
        yield f"  const real shown[] = {{{', '.join(map(self.operand, values))}}};"
        yield f"  inputs.show({place}, shown);"
        yield "}"

    def _looked_up(
        self, lookups: Iterable[Lookup], sources: Sequence[Symbol], text: str
    ) -> Iterator[str]:
        """Numbers from where they are among sources, which lie in memory as the text says of a place.

        What lies in another order on each side of the craft is read by its index (`Lookup`).
        """
        view = self.operand(self._program.policy.view)
        for lookup in lookups:
            first = next(i for i, source in enumerate(sources) if source is lookup.source[0])
            for i, symbol in enumerate(lookup.symbols):
                place = f"{first} + {lookup.name}[{view}][{i}]"
                yield f"const real {symbol.value} = {text.format(place)};"

    def _network(self) -> Iterator[str]:
        """Lines of the network on tensor cores, for one or two tiles of 16 flights at a time.

        The words are those of `policy.cuh`, whose templates take the sizes as they are in `Design`.
        """
        design = self._design
        activation = self._architecture.activation.capitalize()
        parts = design.parts
        tiles = design.tiles
        widths = design.widths
        yield "#pragma unroll" if tiles == 2 else "#pragma unroll 1"
        yield f"for (int row = 0; row < 32; row += {16 * tiles}) {{"
        yield f"  const Inputs<{parts}> given = {{inputs.from + row * {design.stride}, {design.stride}}};"
        name = "given"
        if widths[0] <= FEW_INPUTS:  # else they are fetched again for every 16 units
            name = "few"
            yield f"  Rows<{parts}, {tiles}, {widths[0]}> few;"
            yield "  #pragma unroll"
            yield f"  for (int i = 0; i < {tiles * widths[0] // 16}; ++i) {{"
            yield f"    unsigned rows[{parts}][4];"
            yield f"    given.get(rows, i % {tiles}, i / {tiles});"
            yield f"    few.set(rows, i % {tiles}, i / {tiles});"
            yield "  }"
        for i, units in enumerate(widths[1:-1]):
            yield f"  Rows<{parts}, {tiles}, {units}> rows_{i};"
            yield (
                f"  layer<{activation}, {parts}, {tiles}, {widths[i]}, {units}>({name}, layer_{i}, "
                f"bias_{i}, rows_{i});"
            )
            name = f"rows_{i}"
        last = len(widths) - 2
        yield (
            f"  answer<{activation}, {parts}, {tiles}, {widths[-2]}, {widths[-1]}, {design.outputs // 8}>("
            f"{name}, layer_{last}, bias_{last}, head, constant, outputs + row * {design.stride_out}, "
            f"{design.stride_out});"
        )
        yield "}"

    def _commands(self) -> Iterator[str]:
        """Lines that read the network's outputs and compute each command; names the outputs for what follows."""
        policy = self._program.policy
        (stage,) = policy.stages
        place = f"outputs[lane() * {self._design.stride_out} + {{}}]"
        self.names |= {symbol: place.format(i) for i, symbol in enumerate(stage.outputs)}
        yield from self._looked_up(policy.lookups, stage.outputs, place)
        yield from self.values(policy.commands)
        yield from (
            f"const real command_{i} = {self.operand(command)};"
            for i, command in enumerate(policy.commands)
        )

    def _remember(self) -> Iterator[str]:
        """The history's averages and last rows, in the place of what they were.

        Averages use the newest row before the history moves by one row.
        """
        architecture = self._architecture
        width = architecture.row
        if not architecture.recalled:
            return
        yield from self.values(self._program.policy.newest)
        yield f"const real newest[] = {{{', '.join(map(self.operand, self._program.policy.newest))}}};"
        old, new = (Symbol.input(name) for name in ("average", "latest"))
        for row, kept in enumerate(architecture.averages):
            lines = Lines()
            average = averaged(old, new, kept)
            yield f"for (int i = 0; i < {width}; ++i) {{"
            yield f"  const real average = memory[{row * width} + i], latest = newest[i];"
            yield from indented(lines.values([average]))
            yield f"  memory[{row * width} + i] = {lines.operand(average)};"
            yield "}"
        if architecture.history:
            start = len(architecture.averages) * width
            end = architecture.rows - width
            yield f"for (int i = {start}; i < {end}; ++i) memory[i] = memory[i + {width}];"
            yield f"for (int i = 0; i < {width}; ++i) memory[{end} + i] = newest[i];"

    def _verdict(self) -> Iterator[str]:
        """Added to the results: by the first thread of a warp what all of it has.

        `FlightKernel.fly` reads the arrays in this order: sums and squares by turns, failures from the first kind
        on.
        """
        program = self._program
        yield from self.values((program.failure, program.settled, *program.totals))
        yield "const bool counts = index < unsigned(count);"
        for i, symbol in enumerate(program.totals):
            value = self.operand(symbol)
            yield f"const real total_{i} = total(counts ? {value} : 0.0f);"
            yield f"const real squares_{i} = total(counts ? {value} * {value} : 0.0f);"
        yield "if (lane() == 0) {"
        for i in range(len(program.totals)):
            yield f"  atomicAdd(sums + {2 * i}, double(total_{i}));"
            yield f"  atomicAdd(sums + {2 * i + 1}, double(squares_{i}));"
        yield "}"
        failure = self.operand(program.failure)
        yield (
            f"if (counts && !{failure}) "
            f"atomicAdd(settled_at + int({self.operand(program.settled)}), 1ull);"
        )
        yield f"if (counts && {failure}) {{"
        yield f"  atomicAdd(failures + {failure} - 1, 1ull);"
        yield "  const int place = atomicAdd(failed, 1);"
        yield f"  if (place < room) numbers[place] = number, kinds[place] = {failure};"
        yield "}"
