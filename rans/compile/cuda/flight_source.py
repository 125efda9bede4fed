"""The text of a flight's kernel in CUDA C++, from its program and the design of its network.

A thread flies one scenario after the other, a warp 32 at a time: what each sees goes through the network
together.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from importlib.resources import files

from rans.compile.cuda.design import FEW_INPUTS, Design
from rans.compile.cuda.source import Lines, indented
from rans.compile.flight_program import FlightProgram
from rans.model.trace import Symbol
from rans.policy.activations import ACTIVATIONS, WITH_SLOPE

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
        files("rans.compile.cuda").joinpath(name).read_text()
        for name in ("functions.cuh", "warp.cuh", "policy.cuh")
    )
    return "\n".join(
        (
            "typedef float real;",
            *texts,
            *activation_source(design.given.activation),
            *_views(design),
            f'extern "C" __global__ void __launch_bounds__({32 * design.warps}, 1) flights(',
            f"    {', '.join(_ARGUMENTS)}) {{",
            *indented(_Writer(program, design, steps).body()),
            "}\n",
        )
    )


def activation_source(name: str) -> Iterator[str]:
    """The struct of an activation that policy.cuh does not have, from its formula."""
    if name in WITH_SLOPE:
        return
    lines = Lines()
    x = Symbol.input("x")
    value = ACTIVATIONS[name].formula(x)
    yield f"struct {name.capitalize()} {{"
    yield "  static __device__ inline float of(float x) {"
    yield from (f"    {line}" for line in lines.values([value]))
    yield f"    return {lines.operand(value)};"
    yield "  }"
    yield "  static __device__ inline float quick(float x) { return of(x); }"
    yield "};"


def _views(design: Design) -> Iterator[str]:
    """Where each thruster is in each view of the craft."""
    if design.given.symmetries is not None:
        rows = (", ".join(map(str, row)) for row in design.given.symmetries.place.tolist())
        yield f"__device__ const unsigned char places[][{design.given.thrusters}] = {{"
        yield from (f"  {{{row}}}," for row in rows)
        yield "};"


class _Writer(Lines):
    def __init__(self, program: FlightProgram, design: Design, steps: int) -> None:
        super().__init__()
        self._program = program
        self._design = design
        self._given = design.given
        self._steps = steps

    def body(self) -> Iterator[str]:
        """Every warp flies its share, and adds it to the results."""
        warps = self._design.warps
        yield from self._memory()
        yield f"for (unsigned group = blockIdx.x * {warps} + warp; group < (unsigned(count) + 31) / 32;"
        yield f"     group += gridDim.x * {warps}) {{"
        yield from indented(self._flight())
        yield "}"

    def _memory(self) -> Iterator[str]:
        """The policy, and where each warp puts what its network is given and answers."""
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
        program = self._program
        recalled = self._given.rows
        yield "const unsigned index = group * 32 + lane();"
        yield "const int number = first + int(index);"
        yield from self.values(carried.begin for carried in program.carried)
        yield from (
            f"{carried.symbol.kind} {carried.symbol.value} = {self.operand(carried.begin)};"
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
        program = self._program
        yield from self.values((*program.columns, *program.seen, program.view))
        yield from self._shown()
        yield "__syncwarp();"
        yield from self._network()
        yield "__syncwarp();"
        yield from self._commands()
        yield from self._remember()
        moved = [carried for carried in program.carried if carried.after is not carried.symbol]
        yield from self.values(carried.after for carried in moved)
        for carried in moved:
            yield f"const {carried.symbol.kind} next_{carried.symbol.value} = {self.operand(carried.after)};"
        yield from (f"{carried.symbol.value} = next_{carried.symbol.value};" for carried in moved)
        yield from self.values([program.going])
        yield f"if (!__any_sync(~0u, {self.operand(program.going)})) break;"

    def _shown(self) -> Iterator[str]:
        """The first layer's inputs: columns as they are seen, zoomed, filters' too, and the memory's rows.

        What filters tell besides is not normalised.
        """
        given = self._given
        seen = list(self._program.seen)
        place = 0
        for told in given.told:
            yield "{"
            yield from indented(
                self._look(seen[: given.seen], seen[given.seen : given.seen + told], place)
            )
            yield "}"
            del seen[: given.seen + told]
            place += given.seen * (2 if given.zoom else 1) + told
        if given.recalled:
            yield from self._recalled()

    def _look(self, columns: Sequence[Symbol], told: Sequence[Symbol], place: int) -> Iterator[str]:
        given = self._given
        width = self._given.seen
        size = width * (2 if given.zoom else 1)
        clip = f"{given.clip}f"
        yield from self._row("seen", columns)
        yield f"real shown[{size + len(told)}];"
        yield f"normalise(seen, mean, scale, {clip}, shown);"
        if given.zoom:
            yield f"for (int i = 0; i < {width}; ++i)"
            yield f"  shown[{width} + i] = activated<{self._design.parts}, Tanh>(seen[i] * zoom[i]);"
        yield from (
            f"shown[{size + i}] = max(-{clip}, min({clip}, {self.operand(symbol)}));"
            for i, symbol in enumerate(told)
        )
        yield f"inputs.show({place}, shown);"

    def _recalled(self) -> Iterator[str]:
        """Averages and moments from the side seen now; thrusters are where they look like in it."""
        given = self._given
        program = self._program
        first = given.inputs - given.rows
        width = given.answered
        yield f"for (int row = 0; row < {given.recalled}; ++row) {{"
        yield f"  const int at = row * {given.row};"
        known = dict(self.names)
        for i in range(width):
            self.names[Symbol.input(f"then_{i}")] = f"then_{i}"
            yield f"  const real then_{i} = memory[at + {i}];"
        if width:
            yield from indented(self.values(program.then))
            yield from indented(self._row("before", program.then))
            yield f"  real recalled[{width}];"
            yield f"  normalise(before, mean, scale, {given.clip}f, recalled);"
            yield "  " + f"inputs.show({first} + at, recalled);"
        yield f"  real told[{given.thrusters}];"
        yield "  #pragma unroll"
        yield f"  for (int i = 0; i < {given.thrusters}; ++i) told[i] = memory[at + {width} + i];"
        if given.symmetries is None:
            yield "  " + f"inputs.show({first} + at + {width}, told);"
        else:
            view = self.operand(program.view)
            at = f"{first} + at + {width} + places[{{}}][i]"
            yield f"  for (int i = 0; i < {given.thrusters}; ++i) {{"
            yield "    const real one[1] = {told[i]};"
            yield "    " + f"inputs.show({at.format(view)}, one);"
            yield "  }"
        yield "}"
        self.names = known

    def _row(self, name: str, values: Iterable[Symbol]) -> Iterator[str]:
        yield f"const real {name}[] = {{{', '.join(map(self.operand, values))}}};"

    def _network(self) -> Iterator[str]:
        """On tensor cores, for one or two tiles of 16 flights at a time."""
        design = self._design
        activation = self._given.activation.capitalize()
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
        """The likeliest ones, of thrusters as the craft has them."""
        given = self._given
        program = self._program
        for i in range(given.thrusters):
            unit = (
                f"places[{self.operand(program.view)}][{i}]"
                if given.symmetries is not None
                else str(i)
            )
            for k in range(given.last.outputs):
                place = f"lane() * {self._design.stride_out} + {k * given.thrusters} + {unit}"
                yield f"const real output_{k}_{i} = outputs[{place}];"
            outputs = [Symbol.input(f"output_{k}_{i}") for k in range(given.last.outputs)]
            command = given.last.command(*outputs)
            yield from self.values([command])
            yield f"const real command_{i} = {self.operand(command)};"

    def _remember(self) -> Iterator[str]:
        """As `rans.policy.network.Network.next_state`."""
        given = self._given
        width = given.row
        averages = len(given.averages)
        if not given.recalled:
            return
        if given.answered:
            yield from self._row("newest", self._program.columns)
        told = ", ".join(f"command_{i}" for i in range(given.thrusters))
        yield f"const real told[] = {{{told}}};"
        parts = [
            part
            for part in ((given.answered, "newest", 0), (given.thrusters, "told", given.answered))
            if part[0]
        ]
        for row, kept in enumerate(given.averages):
            for count, source, start in parts:
                at = f"memory[{row * width + start} + i]"
                new = f"{source}[i]"
                yield f"for (int i = 0; i < {count}; ++i) {at} = {new} + {kept}f * ({at} - {new});"
        if given.history:
            start = averages * width
            end = (given.recalled - 1) * width
            yield f"for (int i = {start}; i < {end}; ++i) memory[i] = memory[i + {width}];"
            for count, source, start in parts:
                yield f"for (int i = 0; i < {count}; ++i) memory[{end + start} + i] = {source}[i];"

    def _verdict(self) -> Iterator[str]:
        """Added to the results: by the first thread of a warp what all of it has."""
        program = self._program
        yield from self.values((program.failure, program.settles, program.settled, *program.totals))
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
        yield (
            f"if (counts && {self.operand(program.settles)}) "
            f"atomicAdd(settled_at + int({self.operand(program.settled)}), 1ull);"
        )
        failure = self.operand(program.failure)
        yield f"if (counts && {failure}) {{"
        yield f"  atomicAdd(failures + {failure} - 1, 1ull);"
        yield "  const int place = atomicAdd(failed, 1);"
        yield f"  if (place < room) numbers[place] = number, kinds[place] = {failure};"
        yield "}"
