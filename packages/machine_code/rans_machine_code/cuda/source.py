"""The text of a step's kernel in CUDA C++, from its program.

A thread steps one spacecraft, or two neighbours, whose numbers it then reads and writes in pairs. Reads come first,
so that they all wait together. `rans_machine_code.cuda.step` launches it; tests compile the same text for a CPU and
compare with NumPy, so that an operand's order is not free.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from importlib.resources import files
from typing import Literal

from rans.compile.step_program import BufferWrite
from rans.extend import Dialect, StepProgram, Symbol, ordered

Real = Literal["float", "double"]
Action = Literal["unsigned char", "float", "double"]
"""What an action holds for each thruster: a byte, zero for shut, or a real."""

THREADS = 64
"""Of a block."""

CUDA = Dialect(
    "CUDA",
    "{0} {sign} {1}",
    "{name}",
    lacks=("clip", "cast", "identity", "round", "relu", "sigmoid", "elu"),
    texts={
        "neg": "-{0}",
        "where": "{0} ? {1} : {2}",
        "sin": "sine({0})",
        "cos": "cosine({0})",
        "exp": "exponential({0})",
        "log": "logarithm({0})",
        "log1p": "logarithm_of_one_plus({0})",
        "minimum": "min({0}, {1})",
        "maximum": "max({0}, {1})",
    },
    # Signed arithmetic may not wrap around in C.
    ints={sign: f"int(unsigned({{0}}) {sign} unsigned({{1}}))" for sign in "+-*"},
)
"""CUDA C++ with the functions of ``functions.cuh``."""

_BYTES = {"unsigned char": 1, "unsigned": 4, "float": 4, "double": 8}


def source(
    program: StepProgram,
    thrusters: int,
    action: Action,
    real: Real,
    together: int,
) -> str:
    """CUDA C++ of a kernel ``step``.

    Its arguments are the action, the seed's low and high word, the results' reals, final observations and
    flags, the memory, the settings; the number of spacecraft, the rank of this process, the number of
    processes, and how many blocks ahead memory is fetched.

    Rows of an action have so many thrusters and follow one another. A thread steps one spacecraft or several
    ``together``: their number, and every array's start, is a multiple of it.
    """
    arguments = (
        f"const {action}* action",
        "const int* low_at",
        "const int* high_at",
        "real* reals",
        "real* final",
        "bool* flags",
        *(
            f"{parameter.type}* {parameter.symbol.value}_at"
            for parameter in (*program.memory, *program.settings)
        ),
        "const int count",
        "const int rank",
        "const int processes",
        "const int ahead",
    )
    # The arguments' order is that of `rans_machine_code.cuda.step`.
    return "\n".join(
        (
            f"typedef {real} real;",
            files("rans_machine_code.cuda").joinpath("functions.cuh").read_text(),
            f'extern "C" __global__ void __launch_bounds__({THREADS}) step(',
            f"    {', '.join(arguments)}) {{",
            *indented(_Writer(program, together).body(thrusters, action)),
            "}\n",
        )
    )


class Lines:
    """Lines of a program, and which symbols have a name by then."""

    def __init__(self) -> None:
        self.names: dict[Symbol, str] = {}

    def values(self, roots: Iterable[Symbol]) -> Iterator[str]:
        """Lines that name the roots and their operands in order; changes `names`, so that each is computed once."""
        for symbol in ordered(roots, computed=self.names):
            if symbol.operation == "input":
                self.names[symbol] = symbol.value
            elif symbol.operation != "constant":
                expression = self.expression(symbol, [self.operand(arg) for arg in symbol.args])
                self.names[symbol] = name = f"x{len(self.names)}"
                yield f"const {symbol.kind} {name} = {expression};"

    def expression(self, symbol: Symbol, args: list[str]) -> str:
        """An operation on operands."""
        return CUDA.text(symbol.operation, symbol.operand_kind, *args)

    def operand(self, symbol: Symbol) -> str:
        """A symbol that has a name, or a number, in an expression."""
        if symbol.operation != "constant":
            return self.names[symbol]
        if symbol.kind == "real":
            return f"real({_literal(symbol.value)})"
        number = repr(symbol.value)
        return number.lower() if symbol.kind == "bool" else number


def _literal(value: float) -> str:
    """A number in CUDA C++, which has no header with names for those that are not finite."""
    if math.isnan(value):
        return "__int_as_float(0x7fffffff)"
    if math.isinf(value):
        return f"{'-' if value < 0 else ''}__int_as_float(0x7f800000)"
    return repr(value)


class _Writer(Lines):
    """Writes the text of a step's kernel; what is rare stands where an episode has ended (`StepProgram.rare`)."""

    def __init__(self, program: StepProgram, together: int) -> None:
        # What is rare is read and computed only where an episode ended: memory traffic is what a step costs.
        super().__init__()
        self._program = program
        self._together = together
        inputs = (*program.memory, *program.settings)
        self._places = {
            parameter.symbol: "[i]" if parameter.each else "[0]" for parameter in inputs
        }
        self._places |= {Symbol.input(word, "int"): "[0]" for word in ("low", "high")}
        self._rare = program.rare()
        often = (
            set(ordered([program.ended, *(store.value for store in program.always)])) - self._rare
        )
        # Sorted, so that the same program has the same text always.
        self._drawn = sorted(
            {arg for symbol in often for arg in symbol.args} & self._rare,
            key=lambda symbol: symbol.serial,
        )
        self._own = [s for s, place in self._places.items() if place == "[i]" and s in often]
        self._shared = [s for s, place in self._places.items() if place == "[0]" and s in often]

    def body(self, thrusters: int, action: Action) -> Iterator[str]:
        """Lines of the kernel of a step: fetch the episodes of a thread, step, reset those that end, and store.

        Arguments are named and ordered as `kernel_source` declares them and `rans_machine_code.cuda.step` passes
        them.
        """
        program = self._program
        together = self._together
        pieces, commands = _commands(thrusters, action, together)
        yield "const unsigned group = blockIdx.x * blockDim.x + threadIdx.x;"
        yield f"if (group >= count / {together}) return;"
        yield "const size_t rows = count;"
        yield "const int stride = count * processes;"
        yield from self._fetch(thrusters)
        yield from (
            f"const auto {s.value}_in = read<{together}>({s.value}_at, group);" for s in self._own
        )
        yield from pieces
        yield from (f"const {s.kind} {s.value} = {s.value}_at[0];" for s in self._shared)
        places = [(*self._place(store), _name(store)) for store in program.always]
        yield from (f"Several<{kind}, {together}> {name};" for kind, _, name in places)
        yield "#pragma unroll"
        yield f"for (int k = 0; k < {together}; ++k) {{"
        yield f"  const unsigned i = group * {together} + k;"
        yield "  const int first = i * processes + rank;"
        yield from (f"  const {s.kind} {s.value} = {s.value}_in.of[k];" for s in self._own)
        yield from indented((*commands, *self._step()))
        yield "}"
        yield from (f"write({place}, group, {name});" for _, place, name in places)

    def _fetch(self, thrusters: int) -> Iterator[str]:
        """What a later block reads, into the cache that all blocks share."""
        count = THREADS * self._together
        yield "if (threadIdx.x == 0 && blockIdx.x + ahead < gridDim.x - 1) {"
        yield f"  const size_t there = size_t(blockIdx.x + ahead) * {count};"
        yield from (f"  fetch({symbol.value}_at + there, {count});" for symbol in self._own)
        yield f"  fetch(action + there * {thrusters}, {count * thrusters});"
        yield "}"

    def _step(self) -> Iterator[str]:
        """Of one spacecraft: what needs no draw comes before the draws, which wait for the seed."""
        always = self._program.always
        drawn = set(self._drawn)
        yield from self.values([self._program.ended])
        ended = self.names[self._program.ended]
        yield from (
            f"const {s.kind} {s.value} = {ended} ? {s.value}_at{place} : 0;"
            for s, place in self._places.items()
            if s in self._rare
        )
        yield from self._final_observation()
        late = {store for store in always if not drawn.isdisjoint(self._unnamed([store.value]))}
        yield from self._results(store for store in always if store not in late)
        yield from self._draw()
        yield from self._results(store for store in always if store in late)

    def _final_observation(self) -> Iterator[str]:
        """One row where an episode ended, four numbers a write: 16 bytes of floats, the most there is.

        Names within the branch are forgotten after it.
        """
        finals = [store.value for store in self._program.at_end if store.array == "final"]
        yield from self.values(
            symbol for symbol in self._unnamed(finals) if symbol not in self._rare
        )
        names = dict(self.names)
        yield f"if ({self.names[self._program.ended]}) {{"
        yield from indented(self.values(finals))
        row = [*map(self.operand, finals), *["0"] * (self._program.shape.final_width - len(finals))]
        pieces = len(row) // 4
        yield from (
            f"  write<4>(final, size_t(i) * {pieces} + {p}, {{{', '.join(row[4 * p : 4 * p + 4])}}});"
            for p in range(pieces)
        )
        yield "}"
        self.names = names

    def _results(self, stores: Iterable[BufferWrite]) -> Iterator[str]:
        for store in stores:
            yield from self.values([store.value])
            yield f"{_name(store)}.of[k] = {self.operand(store.value)};"

    def _draw(self) -> Iterator[str]:
        """By all threads of a warp where one episode ends: one alone would hold the others up as long.

        Draws within the branch leave it by the variables drawn_N, which alone keep their names.
        """
        ended = self.names[self._program.ended]
        kept = [store for store in self._program.at_end if store.array == "memory"]
        roots = [*self._drawn, *(store.value for store in kept)]
        yield from self.values(
            symbol for symbol in self._unnamed(roots) if symbol not in self._rare
        )
        yield from (f"{symbol.kind} drawn_{n} = 0;" for n, symbol in enumerate(self._drawn))
        names = dict(self.names)
        yield f"if (__any_sync(__activemask(), {ended})) {{"
        yield from indented(self.values(roots))
        yield from (f"  drawn_{n} = {self.names[symbol]};" for n, symbol in enumerate(self._drawn))
        yield from (
            f"  if ({ended}) memory_{store.row}_at[i] = {self.operand(store.value)};"
            for store in kept
        )
        yield "}"
        self.names = names | {symbol: f"drawn_{n}" for n, symbol in enumerate(self._drawn)}

    def _place(self, store: BufferWrite) -> tuple[str, str]:
        """What is stored, and where."""
        if store.array == "memory":
            return self._program.memory[store.row].type, f"memory_{store.row}_at"
        return "bool" if store.array == "flags" else "real", f"{store.array} + {store.row} * rows"

    def _unnamed(self, roots: Iterable[Symbol]) -> list[Symbol]:
        return list(ordered(roots, computed=self.names))


def indented(lines: Iterable[str]) -> Iterator[str]:
    """Lines of a block."""
    return (f"  {line}" for line in lines)


def _name(store: BufferWrite) -> str:
    return f"{store.array}_{store.row}_out"


def _commands(thrusters: int, action: Action, together: int) -> tuple[list[str], list[str]]:
    """Lines that read those of a thread's spacecraft, up to 16 bytes at once, and lines that name one's.

    On/off actions come as bytes, four to a word. `tests/cuda/test_step.py` tries other numbers of
    thrusters.
    """
    words = action == "unsigned char" and thrusters % 4 == 0
    element = "unsigned" if words else action
    columns = thrusters // 4 if words else thrusters
    members = math.gcd(columns * together, 16 // _BYTES[element])
    pieces = columns * together // members
    reads = [f"Several<{element}, {members}> pieces[{pieces}];"]
    reads += [
        f"pieces[{p}] = read<{members}>(reinterpret_cast<const {element}*>(action), "
        f"size_t(group) * {pieces} + {p});"
        for p in range(pieces)
    ]
    commands = []
    parameter = " ? 1 : 0" if action == "unsigned char" else ""
    for thruster in range(thrusters):
        at = f"(k * {columns} + {thruster // 4 if words else thruster})"
        byte = f" & {0xFF << 8 * (thruster % 4)}u" if words else ""
        commands.append(
            f"const real command_{thruster} = pieces[{at} / {members}].of[{at} % {members}]"
            f"{byte}{parameter};"
        )
    return reads, commands
