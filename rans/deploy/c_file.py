"""An agent's program as one header and one source of C99, without allocation and without a dependency."""

from __future__ import annotations

import json
import math
import platform
import re
import shutil
import subprocess
import tempfile
from collections import Counter
from collections.abc import Mapping, Sequence, Set
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from rans.deploy.program import Ports
from rans.errors import ConfigError
from rans.files import read_text, write_text
from rans.model.operations import ROWS, C, is_truth, of_row
from rans.policy.program import Program, Step

Shape = tuple[int, ...]
FLAGS = (
    *("-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror"),
    *("-Wfloat-equal", "-Wshadow", "-Wdouble-promotion", "-Wcast-align", "-Wlogical-op"),
    "-Wno-unknown-warning-option",  # clang lacks -Wlogical-op
)
"""The files compile without a warning with these; those of the second line are PX4's, of firmware for flight."""
C_FILES = ("agent.h", "agent.c", "agent_check.c")

_VIEWS = {"Split", "Reshape"}
"""Operations whose results may be parts of their first operand's memory."""


class _Packed(NamedTuple):
    """A table of few distinct numbers: the numbers of each block of rows once, and which of them every entry is.

    Networks that obey the symmetries of a square or a cube have few: every block of their rows has the same numbers
    in another order, and all blocks may have the same order.
    """

    rows: int
    """Number of rows in a block."""
    values: np.ndarray
    """(blocks, P) distinct numbers, in the order in which they come first."""
    indices: np.ndarray
    """(rows, columns) of every block, or of all rows where blocks differ."""

    @classmethod
    def of(cls, table: np.ndarray) -> _Packed | None:
        """The smallest way to store a float32 table (rows, columns); None: as it is."""
        count = len(table)
        best = None
        least = 4 * table.size // 2
        for rows in (n for n in range(1, count + 1) if count % n == 0):
            packed = cls._in_blocks(table, rows)
            if packed is not None and packed.bytes < least:
                best, least = packed, packed.bytes
        return best

    @classmethod
    def _in_blocks(cls, table: np.ndarray, rows: int) -> _Packed | None:
        """The table in blocks of so many rows; None: they have more numbers than a byte can count."""
        blocks = []
        # Numbers that differ in a bit are two.
        for block in table.view(np.int32).reshape(len(table) // rows, -1):
            _, first, inverse = np.unique(block, return_index=True, return_inverse=True)
            if len(first) > 256:
                return None
            order = np.argsort(first)
            rank = np.empty(len(order), dtype=np.uint8)
            rank[order] = np.arange(len(order))
            blocks.append((block[first[order]].view(np.float32), rank[inverse.ravel()]))
        longest = max(len(values) for values, _ in blocks)
        values = np.array([np.pad(own, (0, longest - len(own))) for own, _ in blocks])
        indices = np.array([index for _, index in blocks])
        if (indices == indices[0]).all():
            indices = indices[:1]
        return cls(rows, values, indices.reshape(-1, table.shape[1]))

    @property
    def bytes(self) -> int:
        """Size of what is stored."""
        return self.values.nbytes + len(self.stored)

    @property
    def is_bits(self) -> bool:
        """Whether an entry is one bit."""
        return self.values.shape[1] <= 2

    @property
    def stored(self) -> np.ndarray:
        """Bytes of the index; eight entries in a byte, the lowest first, where there are two numbers."""
        flat = self.indices.ravel()
        return np.packbits(flat, bitorder="little") if self.is_bits else flat

    def entry(self, name: str, row: str, column: str, width: int) -> str:
        """Entry of a row and a column, in C."""
        blocks, longest = self.values.shape
        own = row if blocks == 1 or len(self.indices) > self.rows else f"{row} % {self.rows}"
        at = f"{own} * {width} + {column}" if width > 1 else own
        which = f"{name}_index[{at}]"
        if self.is_bits:
            which = f"(({name}_index[({at}) / 8] >> (({at}) % 8)) & 1)"
        start = "" if blocks == 1 else f"{row} / {self.rows} * {longest} + "
        return f"{name}[{start}{which}]"


class _Value(NamedTuple):
    """A value of one spacecraft as C has it: a number, a literal or an array."""

    text: str
    shape: Shape
    kind: str = "float"
    """"float" or "int"."""
    packed: _Packed | None = None
    """How a table is stored whose entries repeat."""

    def entry(self, row: str, column: str) -> str:
        """Its entry, as a table of rows."""
        width = math.prod(self.shape[1:])
        if self.packed is not None:
            return self.packed.entry(self.text, row, column, width)
        if width == 1:
            return f"{self.text}[{row}]"
        # Rows of known number are counted here.
        start = str(int(row) * width) if row.isdigit() else f"{row} * {width}"
        return f"{self.text}[{start} + {column}]"

    @property
    def size(self) -> int:
        return math.prod(self.shape)

    @property
    def is_array(self) -> bool:
        return self.size > 1

    def at(self, index: str, shape: Shape) -> str:
        """Its entry for the flat index of a value of a shape that it is broadcast to."""
        if not self.is_array:
            return self.text
        own = (1,) * (len(shape) - len(self.shape)) + self.shape
        if own == shape or math.prod(own) == math.prod(shape):
            return f"{self.text}[{index}]"
        # One term an axis along which it is not repeated.
        terms = []
        inner = 1
        stride = 1
        for axis in range(len(shape) - 1, -1, -1):
            if own[axis] > 1:
                position = index if inner == 1 else f"({index} / {inner})"
                position = f"{position} % {shape[axis]}"
                terms.append(position if stride == 1 else f"{position} * {stride}")
                stride *= own[axis]
            inner *= shape[axis]
        return f"{self.text}[{' + '.join(reversed(terms))}]"


def write_c(
    folder: Path,
    program: Program,
    ports: Ports,
    title: str,
    contract: str = "",
    pairs: Mapping[str, Any] | None = None,
) -> None:
    """Write agent.h and agent.c, and agent_check.c with golden pairs, where there are some.

    Raises:
        ConfigError: the program has an operation that is not known in C, or the disk refuses.
    """
    # What the frame of the source is filled with: sizes, comments from the contract, tables and
    # steps.
    about = json.loads(contract) if contract else {}
    columns = about.get("observation", [])
    commands = about.get("command", {}).get("ranges", [])
    printer = _Printer(program, ports)
    body = printer.lines()
    patience = 0
    if about:
        patience = int(about["readings"]["oldest"] / about["control_period"] + 1e-6)
    names = {
        "TITLE": _words(title),
        "WIDTH": ports.observation,
        "COMMANDS": ports.command,
        "MEMORY": ports.memory,
        "KEPT": max(ports.memory, 1),
        "PATIENCE": patience,
        "PERIOD": f"{about.get('control_period', 0.0):g}",
        "COLUMNS": "\n".join(
            f" * {at:3d}  {_words(column['name'])}, {_words(column['unit'])}, frame {_words(column['frame'])}: "
            f"{_words(column['meaning'])}"
            for at, column in enumerate(columns)
        )
        or " * (see contract.json)",
        "ORDER": "\n".join(
            f" * {at:3d}  {_words(command['name'])}, {_words(command['kind'])}, "
            f"{command['low']:g} to {command['high']:g}"
            for at, command in enumerate(commands)
        )
        or " * (see contract.json)",
        "RANGES": _ranges(columns, ports.observation),
        "TABLES": "\n".join(printer.tables()),
        "STEPS": "\n".join("    " + line for line in body),
        "FORGET": _FORGET if ports.memory else "    (void)agent;",
        "CHECKBEFORE": _CHECK_BEFORE if ports.memory else "",
        "CHECKAFTER": _CHECK_AFTER if ports.memory else "",
        "KEEP": _KEEP if ports.memory else "",
        "FORGOTTEN": " | RANS_FORGOTTEN" if ports.memory else "",
        "REMEMBERED": "agent->memory" if ports.memory else "NULL",
        "AFTER": "after" if ports.memory else "NULL",
        "SCRATCH": f"    float after[{ports.memory}];\n" if ports.memory else "",
        "UNUSED": "" if ports.memory else "    (void)memory;\n    (void)after;\n",
    }
    write_text(folder / "agent.h", _filled(_HEADER, names | {"STACK": _STACK_UNKNOWN}))
    write_text(folder / "agent.c", _filled(_SOURCE, names))
    # The stack is measured by compiling what was written; the header then states it.
    if stack := _measured_stack(folder):
        stack_note = _filled(_STACK, {"BYTES": stack, "MACHINE": platform.machine()})
        write_text(folder / "agent.h", _filled(_HEADER, names | {"STACK": stack_note}))
    if pairs is not None:
        write_text(folder / "agent_check.c", _check_text(pairs))


def compiled_check(folder: Path) -> str:
    """Sentence on what agent_check.c finds, compiled by the machine's compiler, and on the size of the agent.

    It is compiled twice: as C99 asks, and as for finite numbers alone, as much firmware is.

    Raises:
        ConfigError: the compiler refuses the files, some golden pairs come out wrong, or numbers that are not
            finite are flown.
    """
    compiler = _compiler()
    if compiler is None:
        command = f"cc -O2 {' '.join(FLAGS)} agent.c agent_check.c -lm"
        return f"There is no C compiler here: check it on yours by {command}."
    results = []
    size = 0
    with tempfile.TemporaryDirectory() as build_folder:
        for optimization in (("-O2", "-ffast-math"), ("-O2",)):
            # The agent alone, whose object code has its size, and with the program that checks it.
            compiled = [compiler, *optimization, *FLAGS]
            part = Path(build_folder) / "agent.o"
            built = Path(build_folder) / "check"
            for arguments in (
                [*compiled, "-c", str(folder / "agent.c"), "-o", str(part)],
                [*compiled, str(folder / "agent_check.c"), str(part), "-o", str(built), "-lm"],
            ):
                done = subprocess.run(arguments, capture_output=True, text=True, check=False)
                if done.returncode:
                    raise ConfigError(
                        f"{compiler} refuses agent.c: {(done.stderr.splitlines() or [''])[0]}."
                    )
            size = _loaded_size(part)
            run = subprocess.run([str(built)], capture_output=True, text=True, check=False)
            if run.returncode:
                flags = " ".join(optimization)
                raise ConfigError(f"agent.c is wrong: {run.stdout.strip()} (built by {flags})")
            results.append(run.stdout.strip())
    stack = stack_of(folder)
    needs = f" It needs {stack:,} bytes of stack." if stack else ""
    return f"agent.c is {size / 1000:.0f} kB of code and tables here; {results[-1]}{needs}"


def _loaded_size(part: Path) -> int:
    """Bytes of code and tables in an object file, by the program size; else of the file, which has names too."""
    tool = shutil.which("size")
    if tool is None:
        return part.stat().st_size
    done = subprocess.run([tool, str(part)], capture_output=True, text=True, check=False)
    # A line of titles and one of numbers, of which dec is the sum; macOS has other parts than binutils.
    titles, numbers = (line.split() for line in [*done.stdout.splitlines(), "", ""][:2])
    sums = dict(zip(titles, numbers, strict=False))
    return int(sums["dec"]) if done.returncode == 0 and "dec" in sums else part.stat().st_size


def stack_of(folder: Path) -> int | None:
    """Bytes of stack that agent.h in a folder states; None: there is none, or no compiler measured it."""
    file = folder / "agent.h"
    line = re.search(r"^#define RANS_STACK (\d+)", read_text(file), re.M) if file.exists() else None
    return int(line[1]) if line else None


def _compiler() -> str | None:
    return shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")


def _measured_stack(folder: Path) -> int | None:
    """Bytes of stack of `rans_agent_act` with what it calls, by the compiler; None if none here can say."""
    compiler = _compiler()
    if compiler is None:
        return None
    with tempfile.TemporaryDirectory() as build_folder:
        part = Path(build_folder) / "agent.o"
        arguments = [compiler, "-O2", "-std=c99", "-fstack-usage", "-c", str(folder / "agent.c")]
        subprocess.run([*arguments, "-o", str(part)], capture_output=True, check=False)
        usage = part.with_suffix(".su")
        if not usage.exists():
            return None
        # A line a function: FILE:LINE:COLUMN:NAME, bytes and kind, with tabs between.
        rows = [line.split("\t") for line in read_text(usage).splitlines()]
    frames = {row[0].rpartition(":")[2]: int(row[1]) for row in rows}
    own = frames.pop("rans_agent_act")
    return own + max(frames.values())  # nothing that it calls calls another function of the file


def _filled(text: str, names: Mapping[str, Any]) -> str:
    return re.sub(r"@([A-Z]+)@", lambda match: str(names[match[1]]), text)


def _words(text: str) -> str:
    """A stranger's words, fit for a comment: without what ends or begins one, continues a line or is invisible."""
    clean = re.sub(r"\*/|/\*|\\|\?\?/", "_", text)
    return "".join(character if character.isprintable() else "_" for character in clean)[:200]


def _number(value: float) -> str:
    """A literal of single precision."""
    if not math.isfinite(value):
        return "NAN" if math.isnan(value) else "INFINITY" if value > 0 else "-INFINITY"
    text = f"{np.float32(value):.9g}"
    return f"{text if re.search(r'[.e]', text) else text + '.0'}F"


def _rows(numbers: Sequence[str]) -> str:
    """Entries of an array, eight a line."""
    lines = [", ".join(numbers[at : at + 8]) for at in range(0, len(numbers), 8)]
    return ",\n    ".join(lines)


def _ranges(columns: Sequence[Mapping[str, Any]], width: int) -> str:
    """Tables of valid and of refused ranges."""
    texts = []
    for name, slack in (("valid", 1e-5), ("refused", 0.0)):
        for end, side in (("low", 0), ("high", 1)):
            bound = [-3.4e38, 3.4e38][side]
            numbers = [column[name][side] + (2 * side - 1) * slack for column in columns] or [
                bound
            ] * width
            texts.append(
                f"static const float {name}_{end}[RANS_OBSERVATION] = {{\n    "
                f"{_rows([_number(x) for x in numbers])}}};"
            )
    return "\n".join(texts)


class _Loop:
    """Operations on single numbers of arrays of a size, which one loop computes."""

    def __init__(self) -> None:
        self.size = 0
        self.lines: dict[str, tuple[str, str]] = {}
        """By the name of a value: its entry in the loop, and the expression."""
        self.uses = Counter[str]()
        """Number of times that the loop uses a value."""


class _Scratch:
    """Places of arrays of floats in a single one, which others take when an array is not used any more."""

    def __init__(self) -> None:
        self.size = 0
        self._taken: dict[str, tuple[int, int]] = {}

    def taken(self, name: str, size: int) -> int:
        """First index of a new array: the lowest where it has room."""
        start = 0
        for first, end in sorted(self._taken.values()):
            if start + size <= first:
                break
            start = max(start, end)
        self._taken[name] = start, start + size
        self.size = max(self.size, start + size)
        return start

    def free(self, names: Set[str]) -> None:
        """Give back the places of arrays."""
        for name in names & self._taken.keys():
            del self._taken[name]


def _last_uses(program: Program, delayed: frozenset[str]) -> dict[str, int]:
    """Number of the last step that uses each variable, also as a part or in another shape.

    Values of ``delayed`` names are computed where they are used, from their first operand.
    """
    own: dict[str, str] = {}
    last = {}
    for number, step in enumerate(program.steps):
        used = [own.get(name, name) for name in step.inputs]
        last |= dict.fromkeys(used, number)
        is_view = step.operation in _VIEWS or step.outputs[0] in delayed
        own |= {name: used[0] if is_view else name for name in step.outputs}
    # What the function returns.
    last |= {own.get(name, name): len(program.steps) for name in ("command", "memory_out")}
    return {_variable(name): number for name, number in last.items()}


class _Printer:
    """The steps of a program as lines of one C function."""

    def __init__(self, program: Program, ports: Ports) -> None:
        self._program = program
        self._known: dict[str, _Value] = {
            "observation": _Value("observation", (1, ports.observation)),
            "memory": _Value("memory", (1, ports.memory)),
        }
        self._used: dict[str, None] = {}
        self._tables: dict[tuple[Any, ...], _Value] = {}
        self._ports = ports
        self._lines: list[str] = []
        self._scores = _scores(program)
        self._packable = _packable(program, {offset for _, offset in self._scores.whole.values()})
        self._constants = dict(program.constants)
        self._halves = {
            product.inputs[1]: self._split_table(product.inputs[1])
            for product, _ in self._scores.whole.values()
        }
        self._loop = _Loop()
        self._scratch = _Scratch()
        self._uses = Counter(
            [name for step in program.steps for name in step.inputs] + ["command", "memory_out"]
        )

    def lines(self) -> list[str]:
        """Everything from the observation and the memory to the command and the memory after."""
        last = _last_uses(self._program, self._scores.parts)
        for number, step in enumerate(self._program.steps):
            self._print(step)
            # A loop that is not printed yet still reads its operands.
            if not self._loop.lines:
                self._scratch.free({text for text, end in last.items() if end <= number})
        self._end_loop()
        self._copy("command", "command", self._ports.command)
        if self._ports.memory:
            self._copy("memory_out", "after", self._ports.memory)
        if self._scratch.size:
            self._lines.insert(0, f"float scratch[{self._scratch.size}];")
        return self._lines

    def tables(self) -> list[str]:
        """Constant arrays that the lines use."""
        texts = []
        for name in self._used:
            value = self._constants[name]
            flat = value.ravel()
            if value.dtype.kind == "i":
                kind, numbers = "int", [str(int(x)) for x in flat]
            else:
                packed = self._known[name].packed
                if packed is not None:
                    stored = packed.stored
                    texts.append(
                        f"static const uint8_t {_table(name)}_index[{len(stored)}] = {{\n    "
                        f"{_rows([str(x) for x in stored])}}};"
                    )
                    flat = packed.values.ravel()
                kind, numbers = "float", [_number(float(x)) for x in flat]
            texts.append(
                f"static const {kind} {_table(name)}[{len(numbers)}] = {{\n    {_rows(numbers)}}};"
            )
        return texts

    def _copy(self, name: str, target: str, size: int) -> None:
        value = self._value(name)
        text = value.at("i", (size,)) if value.is_array else value.text
        self._lines.append(f"for (int i = 0; i < {size}; ++i) {{ {target}[i] = {text}; }}")

    def _value(self, name: str) -> _Value:
        if name not in self._known:
            constant = self._constants[name]
            kind = "int" if constant.dtype.kind == "i" else "float"
            key = constant.dtype.str, constant.shape, constant.tobytes(), name in self._packable
            if constant.size == 1:
                item = constant.item()
                text = str(int(item)) if kind == "int" else _number(float(item))
                text = f"({text})" if text.startswith("-") else text
            else:
                # Of equal tables the first one is there.
                if key in self._tables:
                    self._known[name] = self._tables[key]
                    return self._known[name]
                text = _table(name)
                self._used[name] = None
            packed = None
            if name in self._packable:
                packed = _Packed.of(constant.reshape(len(constant), -1))
            self._known[name] = _Value(text, constant.shape, kind, packed)
            if constant.size > 1:
                self._tables[key] = self._known[name]
        return self._known[name]

    def _result(self, name: str, shape: Shape, kind: str = "float") -> _Value:
        value = _Value(_variable(name), shape, kind)
        self._known[name] = value
        if value.is_array:
            self._declare(value)
        return value

    def _declare(self, value: _Value) -> None:
        """Room for an array: floats share what other arrays have used before."""
        if value.kind == "int":
            self._lines.append(f"int {value.text}[{value.size}];")
            return
        start = self._scratch.taken(value.text, value.size)
        self._lines.append(f"float *const {value.text} = scratch + {start};")

    def _set(self, value: _Value, text: str) -> None:
        """Every entry of an array, or the number."""
        if value.is_array:
            self._lines.append(
                f"for (int i = 0; i < {value.size}; ++i) {{ {value.text}[i] = {text}; }}"
            )
        else:
            self._lines.append(f"const {value.kind} {value.text} = {text};")

    def _elementwise(self, step: Step) -> None:
        """An operation on single numbers; those on arrays of a size that follow each other have one loop."""
        name = step.outputs[0]
        values = [self._value(operand) for operand in step.inputs]
        shape = np.broadcast_shapes(*(array.shape for array in values))
        kind = "int" if is_truth(step.operation) else "float"
        loop = self._loop
        others = any(
            operand in loop.lines and array.shape != shape
            for operand, array in zip(step.inputs, values, strict=True)
        )
        size = math.prod(shape)
        if others or (size > 1 and loop.lines and size != loop.size):
            self._end_loop()
            loop = self._loop
        texts = [
            loop.lines[operand][0] if operand in loop.lines else array.at("i", shape)
            for operand, array in zip(step.inputs, values, strict=True)
        ]
        text = C.text(*of_row(step.operation), *texts)
        if size == 1:
            self._set(self._result(name, shape, kind), text)
            return
        value = _Value(_variable(name), shape, kind)
        self._known[name] = value
        loop.lines[name] = (f"{value.text}_i", text)
        loop.size = size
        loop.uses.update(step.inputs)

    def _end_loop(self) -> None:
        """Print the loop; only what later steps use is stored in arrays."""
        loop, self._loop = self._loop, _Loop()
        if not loop.lines:
            return
        stored = [name for name in loop.lines if self._uses[name] > loop.uses[name]]
        for name in stored:
            self._declare(self._known[name])
        self._lines.append(f"for (int i = 0; i < {loop.size}; ++i) {{")
        for name, (local, text) in loop.lines.items():
            value = self._known[name]
            if loop.uses[name]:
                self._lines.append(f"    const {value.kind} {local} = {text};")
                text = local
            if name in stored:
                self._lines.append(f"    {value.text}[i] = {text};")
        self._lines.append("}")

    def _print(self, step: Step) -> None:
        if step.operation in ROWS and step.outputs[0] not in self._scores.parts:
            self._elementwise(step)
            return
        self._end_loop()
        name = step.outputs[0]
        shapes: Any = self._program.constants.get(step.inputs[-1])
        match step.operation:
            case "Split":
                self._split(step, [int(x) for x in shapes])
            case "Reshape":
                value = self._value(step.inputs[0])
                inner = tuple(int(x) for x in shapes[1:])
                outer = value.size // math.prod(inner)
                self._known[name] = _Value(value.text, (outer, *inner), value.kind)
            case "Concat":
                self._concat(name, [self._value(operand) for operand in step.inputs])
            case "Gemm":
                self._gemm(name, *(self._value(operand) for operand in step.inputs))
            case "Transpose":
                (value,) = (self._value(operand) for operand in step.inputs)
                first, rows, columns = value.shape
                result = self._result(name, (first, columns, rows), value.kind)
                self._set(result, f"{value.text}[i % {rows} * {columns} + i / {rows}]")
            case "ReduceMax" | "ReduceSum":
                self._reduced(step)
            case "MatMul" | "Add" if name in self._scores.parts:
                pass  # the search below computes them one by one
            case "MatMul" if len(self._value(step.inputs[1]).shape) > 2:
                self._products(name, *(self._value(operand) for operand in step.inputs))
            case "MatMul":
                result = self._result(name, (1, self._value(step.inputs[1]).shape[1]))
                self._set(result, self._product(step))
            case "ArgMax":
                self._argmax(step)
            case "Gather":
                table, which = (self._value(operand) for operand in step.inputs)
                width = math.prod(table.shape[1:])
                result = self._result(name, (1, *table.shape[1:]), table.kind)
                self._set(result, table.entry(which.text, "i" if width > 1 else "0"))
            case "GatherElements":
                value, index = (self._value(operand) for operand in step.inputs)
                width = index.shape[-1]
                result = self._result(name, index.shape, value.kind)
                row = (
                    f"i / {width} * {value.shape[-1]} + " if math.prod(index.shape[:-1]) > 1 else ""
                )
                self._set(result, f"{value.text}[{row}{index.text}[i]]")
            case operation:
                raise ConfigError(
                    f"the agent has the operation {operation!r}, which the export as C does not know: export as "
                    "onnx or numpy."
                )

    def _split_table(self, name: str) -> list[str]:
        """Names of tables of its first rows and of the others, if they are smaller than it; else its own.

        Prices of effectors are one of two numbers, and slopes before them are not.
        """
        table = self._constants[name]
        if name not in self._packable:
            return [name]

        def size(part: np.ndarray) -> int:
            packed = _Packed.of(part)
            return part.nbytes if packed is None else packed.bytes

        sizes = {row: size(table[:row]) + size(table[row:]) for row in range(1, len(table))}
        row = min(sizes, key=lambda row: sizes[row])
        if sizes[row] >= size(table):
            return [name]
        halves = [f"{name}_first", f"{name}_others"]
        self._constants |= dict(zip(halves, (table[:row], table[row:]), strict=True))
        self._packable |= {*halves}
        return halves

    def _product(self, step: Step) -> str:
        """Entry i of a row times a table."""
        row, table = step.inputs
        a = self._value(row)
        tables = [self._value(name) for name in self._halves.get(table, [table])]
        entries = [b.entry(str(k), "i") for b in tables for k in range(b.shape[0])]
        return " + ".join(
            f"{a.text}[{k}] * {entry}" if a.is_array else f"{a.text} * {entry}"
            for k, entry in enumerate(entries)
        )

    def _split(self, step: Step, widths: Sequence[int]) -> None:
        value = self._value(step.inputs[0])
        rows = math.prod(value.shape[:-1])
        start = 0
        for name, width in zip(step.outputs, widths, strict=True):
            shape = (*value.shape[:-1], width)
            if rows == 1 and width == 1:
                self._known[name] = _Value(f"{value.text}[{start}]", shape, value.kind)
            elif rows == 1:
                self._known[name] = _Value(f"({value.text} + {start})", shape, value.kind)
            else:
                result = self._result(name, shape, value.kind)
                self._set(
                    result, f"{value.text}[i / {width} * {value.shape[-1]} + {start} + i % {width}]"
                )
            start += width

    def _concat(self, name: str, parts: Sequence[_Value]) -> None:
        width = sum(part.shape[-1] for part in parts)
        outer = parts[0].shape[:-1]
        rows = math.prod(outer)
        result = self._result(name, (*outer, width), parts[0].kind)
        if not result.is_array:
            self._set(result, parts[0].text)
            return
        start = 0
        for part in parts:
            own = part.shape[-1]
            count = rows * own
            position = f"i / {own} * {width} + {start} + i % {own}" if rows > 1 else f"{start} + i"
            if count == 1:
                self._lines.append(f"{result.text}[{start}] = {part.text};")
            else:
                self._lines.append(
                    f"for (int i = 0; i < {count}; ++i) {{ {result.text}[{position}] = {part.text}[i]; }}"
                )
            start += own

    def _gemm(self, name: str, x: _Value, weight: _Value, bias: _Value) -> None:
        outputs, inputs = weight.shape
        if x.shape[0] > 1:
            self._rows_through(name, x, weight, bias)
            return
        result = self._result(name, (1, outputs))
        left = f"{x.text}[k]" if x.is_array else x.text
        target = f"{result.text}[i]"
        # Weights and bias of a single number are literals.
        row = weight.entry("i", "k") if weight.is_array else weight.text
        begin = f"{bias.text}[i]" if bias.is_array else bias.text
        if not result.is_array:
            sums = " + ".join(
                f"{x.text}[{k}] * {weight.entry('0', str(k))}"
                if x.is_array
                else f"{x.text} * {weight.text}"
                for k in range(inputs)
            )
            self._set(result, f"{begin} + {sums}")
            return
        self._lines += [
            f"for (int i = 0; i < {outputs}; ++i) {{",
            f"    float sum = {begin};",
            f"    for (int k = 0; k < {inputs}; ++k) {{ sum += {row} * {left}; }}",
            f"    {target} = sum;",
            "}",
        ]

    def _rows_through(self, name: str, x: _Value, weight: _Value, bias: _Value) -> None:
        """A layer of several rows."""
        outputs, inputs = weight.shape
        rows = x.shape[0]
        result = self._result(name, (rows, outputs))
        row = weight.entry("i", "k") if weight.is_array else weight.text
        begin = f"{bias.text}[i]" if bias.is_array else bias.text
        self._lines += [
            f"for (int row = 0; row < {rows}; ++row) {{",
            f"    for (int i = 0; i < {outputs}; ++i) {{",
            f"        float sum = {begin};",
            f"        for (int k = 0; k < {inputs}; ++k) {{ sum += {row} * {x.text}[row * {inputs} + k]; }}",
            f"        {result.text}[row * {outputs} + i] = sum;",
            "    }",
            "}",
        ]

    def _products(self, name: str, a: _Value, b: _Value) -> None:
        """A product of two matrices of one spacecraft."""
        first, rows, inner = a.shape
        columns = b.shape[-1]
        result = self._result(name, (first, rows, columns))
        self._lines += [
            f"for (int i = 0; i < {rows * columns}; ++i) {{",
            "    float sum = 0.0F;",
            f"    for (int k = 0; k < {inner}; ++k) {{",
            f"        sum += {a.text}[i / {columns} * {inner} + k] * {b.text}[k * {columns} + i % {columns}];",
            "    }",
            f"    {result.text}[i] = sum;",
            "}",
        ]

    def _reduced(self, step: Step) -> None:
        """The largest number of each row, or their sum."""
        value = self._value(step.inputs[0])
        width = value.shape[-1]
        result = self._result(step.outputs[0], (*value.shape[:-1], 1))
        entry = f"{value.text}[i * {width} + k]"
        text = f"fmaxf(found, {entry})" if step.operation == "ReduceMax" else f"found + {entry}"
        if not result.is_array:
            # Of a single row the result is a number.
            self._lines += [
                f"float {result.text} = {value.text}[0];",
                f"for (int i = 0; i < {width - 1}; ++i) {{",
                f"    const float found = {result.text};",
                f"    {result.text} = {text.replace(entry, f'{value.text}[i + 1]')};",
                "}",
            ]
            return
        self._lines += [
            f"for (int i = 0; i < {result.size}; ++i) {{",
            f"    float found = {value.text}[i * {width}];",
            f"    for (int k = 1; k < {width}; ++k) {{ found = {text}; }}",
            f"    {result.text}[i] = found;",
            "}",
        ]

    def _argmax(self, step: Step) -> None:
        """Number of the largest entry, the first of equal ones."""
        name = step.outputs[0]
        result = _Value(_variable(name), (1,), "int")
        if name in self._scores.whole:
            product, offset = self._scores.whole[name]
            table = self._value(offset)
            size = table.size
            score = f"{self._product(product)} + {table.entry('i', '0')}"
        else:
            value = self._value(step.inputs[0])
            size = value.size
            score = f"{value.text}[i]"
        self._known[name] = result
        best = f"{result.text}_score"
        self._lines += [
            f"int {result.text} = 0;",
            f"float {best} = 0.0F;",
            f"for (int i = 0; i < {size}; ++i) {{",
            f"    const float score = {score};",
            f"    if (i == 0 || score > {best}) {{",
            f"        {result.text} = i;",
            f"        {best} = score;",
            "    }",
            "}",
        ]


class _Scores(NamedTuple):
    """Searches for the largest of linear functions, which need no memory for all of their values."""

    whole: dict[str, tuple[Step, str]]
    """By the name of the largest one's number: product of the row and the slopes, and name of the offsets."""
    parts: frozenset[str]
    """Names of the values that are computed one by one."""


def _scores(program: Program) -> _Scores:
    """Searches of a program: the largest of a row times a table plus a table."""
    made = {name: step for step in program.steps for name in step.outputs}
    uses = [name for step in program.steps for name in step.inputs]
    whole = {}
    parts = set()
    for step in program.steps:
        total = made.get(step.inputs[0]) if step.operation == "ArgMax" else None
        if total is None or total.operation != "Add":
            continue
        product = made.get(total.inputs[0])
        offset = total.inputs[1]
        if product is None or product.operation != "MatMul" or offset not in program.constants:
            continue
        inner = [product.outputs[0], total.outputs[0]]
        tables = program.constants.get(product.inputs[1]), program.constants[offset]
        is_plain = tables[0] is not None and tables[0].shape[1:] == tables[1].shape
        if is_plain and all(uses.count(name) == 1 for name in inner):
            whole[step.outputs[0]] = product, offset
            parts.update(inner)
    return _Scores(whole, frozenset(parts))


def _packable(program: Program, offsets: Set[str]) -> frozenset[str]:
    """Names of the float tables of rows that are read entry by entry: weights of layers, slopes, rows to choose.

    ``offsets`` are columns that are added entry by entry.
    """
    read = {("Gemm", 1), ("MatMul", 1), ("Gather", 0)}
    others = {
        name
        for step in program.steps
        for index, name in enumerate(step.inputs)
        if (step.operation, index) not in read
    }
    return frozenset(
        name
        for name, table in program.constants.items()
        if (name in offsets or (name not in others and table.ndim == 2))
        and table.dtype == np.float32
        and table.size > 256
    )


def _variable(name: str) -> str:
    return "v_" + re.sub(r"\W", "_", name)


def _table(name: str) -> str:
    return "t_" + re.sub(r"\W", "_", name)


def _check_text(pairs: Mapping[str, Any]) -> str:
    count = len(pairs["begins"])

    def flat(rows: Sequence[Sequence[float]]) -> str:
        return _rows([_number(float(x)) for row in rows for x in row])

    return _filled(
        _CHECK,
        {
            "COUNT": count,
            "TOLERANCE": _number(float(pairs["tolerance"])),
            "BEGINS": _rows([str(int(x)) for x in pairs["begins"]]),
            "OBSERVATIONS": flat(pairs["observation"]),
            "EXPECTED": flat(pairs["command"]),
        },
    )


_HEADER = """/* @TITLE@
 *
 * Control period: @PERIOD@ s. contract.json says everything that an engineer needs to know of this agent.
 *
 * Columns of an observation:
@COLUMNS@
 *
 * Commands:
@ORDER@
 */
#ifndef RANS_AGENT_H
#define RANS_AGENT_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define RANS_OBSERVATION @WIDTH@
#define RANS_COMMANDS @COMMANDS@
#define RANS_MEMORY @MEMORY@

/* What rans_agent_act returns: a sum of these, 0 where all is well. */
#define RANS_HELD 1      /* the observation was no reading: the last one was held */
#define RANS_SHUT 2      /* no reading is young enough, or the answer is not finite: all commands are 0 */
#define RANS_FORGOTTEN 4 /* the memory was not finite and is forgotten */
#define RANS_UNTRIED 8   /* the agent was not tried with such an observation */
#define RANS_UNREADY 16  /* rans_agent_reset was never called, or the struct was overwritten: all commands are 0 */

#define RANS_PATIENCE @PATIENCE@ /* control periods for which a reading may be held */
@STACK@

typedef struct {
    uint32_t ready; /* a mark of rans_agent_reset */
    float memory[@KEPT@];
    float last[RANS_OBSERVATION];
    int held; /* control periods since a reading */
} rans_agent;

/* Begin an episode: what the agent remembers is forgotten. */
void rans_agent_reset(rans_agent *agent);

/* The commands to an observation, once every control period. An observation with a number that is not finite is no
 * reading, also where the compiler assumes finite numbers (-ffast-math). */
int rans_agent_act(rans_agent *agent, const float observation[RANS_OBSERVATION], float command[RANS_COMMANDS]);

/* The commands and the next memory, of any observation and memory, without a look at ranges. Of an agent without
 * a memory both may be null. */
void rans_agent_answer(const float observation[RANS_OBSERVATION], const float *memory,
                       float command[RANS_COMMANDS], float *after);

#ifdef __cplusplus
}
#endif
#endif
"""

_STACK = """#define RANS_STACK @BYTES@ /* bytes of stack for rans_agent_act, by the compiler's -O2 on @MACHINE@;
                          * those of tanhf and its like come on top. Measure yours by -fstack-usage. */"""
_STACK_UNKNOWN = "/* Measure the stack that rans_agent_act needs by gcc -fstack-usage. */"

_FORGET = "    for (int i = 0; i < RANS_MEMORY; ++i) { agent->memory[i] = 0.0F; }"
_CHECK_BEFORE = """    for (int i = 0; i < RANS_MEMORY; ++i) {
        if (!is_finite(&agent->memory[i])) { status |= RANS_FORGOTTEN; }
    }
    if (status & RANS_FORGOTTEN) { forget(agent); }
"""
_CHECK_AFTER = """    for (int i = 0; i < RANS_MEMORY; ++i) {
        if (!is_finite(&after[i])) { sound = 0; }
    }
"""
_KEEP = """    for (int i = 0; i < RANS_MEMORY; ++i) { agent->memory[i] = after[i]; }
"""

_SOURCE = """/* @TITLE@ */
#include "agent.h"

#include <math.h>
#include <stddef.h>
#include <string.h>

#define READY 0x52414E53U /* "RANS", which memory that was never set is unlikely to hold */

@RANGES@

@TABLES@

void rans_agent_answer(const float observation[RANS_OBSERVATION], const float *memory,
                       float command[RANS_COMMANDS], float *after)
{
@UNUSED@@STEPS@
}

/* By its bits: compilers that assume finite numbers leave out every comparison that only a NaN fails. */
static int is_finite(const float *number)
{
    uint32_t bits;
    memcpy(&bits, number, sizeof bits);
    return (bits & 0x7F800000U) != 0x7F800000U;
}

static void forget(rans_agent *agent)
{
@FORGET@
}

void rans_agent_reset(rans_agent *agent)
{
    forget(agent);
    for (int i = 0; i < RANS_OBSERVATION; ++i) { agent->last[i] = 0.0F; }
    agent->held = RANS_PATIENCE; /* at first there is no reading */
    agent->ready = READY;
}

int rans_agent_act(rans_agent *agent, const float observation[RANS_OBSERVATION], float command[RANS_COMMANDS])
{
    int status = 0;
    int fresh = 1;
    int sound = 1;
@SCRATCH@    if (agent->ready != READY || agent->held < 0 || agent->held > RANS_PATIENCE + 1) {
        for (int i = 0; i < RANS_COMMANDS; ++i) { command[i] = 0.0F; }
        return RANS_SHUT | RANS_UNREADY;
    }
    for (int i = 0; i < RANS_OBSERVATION; ++i) {
        if (!is_finite(&observation[i]) || observation[i] < refused_low[i] || observation[i] > refused_high[i]) {
            fresh = 0;
        }
    }
    if (fresh) {
        agent->held = 0;
        for (int i = 0; i < RANS_OBSERVATION; ++i) { agent->last[i] = observation[i]; }
    } else if (agent->held <= RANS_PATIENCE) {
        agent->held += 1;
    }
    if (agent->held > RANS_PATIENCE) {
        forget(agent);
        for (int i = 0; i < RANS_COMMANDS; ++i) { command[i] = 0.0F; }
        return RANS_SHUT;
    }
    if (!fresh) { status |= RANS_HELD; }
    for (int i = 0; i < RANS_OBSERVATION; ++i) {
        if (agent->last[i] < valid_low[i] || agent->last[i] > valid_high[i]) { status |= RANS_UNTRIED; }
    }
@CHECKBEFORE@    rans_agent_answer(agent->last, @REMEMBERED@, command, @AFTER@);
    for (int i = 0; i < RANS_COMMANDS; ++i) {
        if (!is_finite(&command[i])) { sound = 0; }
    }
@CHECKAFTER@    if (!sound) {
        forget(agent);
        for (int i = 0; i < RANS_COMMANDS; ++i) { command[i] = 0.0F; }
        return status | RANS_SHUT@FORGOTTEN@;
    }
@KEEP@    return status;
}
"""

_CHECK = """/* Checks agent.c by the golden pairs and by numbers that are not finite, and times it:
 * cc -O2 agent.c agent_check.c -lm && ./a.out
 * Build it with the flags of your firmware. */
#include "agent.h"

#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <time.h>

#define COUNT @COUNT@
#define TOLERANCE @TOLERANCE@

static const int begins[COUNT] = {
    @BEGINS@};
static const float observations[COUNT * RANS_OBSERVATION] = {
    @OBSERVATIONS@};
static const float expected[COUNT * RANS_COMMANDS] = {
    @EXPECTED@};

static int is_shut(const float command[RANS_COMMANDS])
{
    for (int i = 0; i < RANS_COMMANDS; ++i) {
        if (command[i] < 0.0F || command[i] > 0.0F) { return 0; }
    }
    return 1;
}

/* Whether NaN and the infinities are no readings in any column, and a struct without a reset commands nothing. */
static int is_guarded(void)
{
    static const uint32_t wild[3] = {0x7FC00000U, 0x7F800000U, 0xFF800000U};
    rans_agent agent;
    float observation[RANS_OBSERVATION];
    float command[RANS_COMMANDS];
    int guarded = 1;
    for (int i = 0; i < 3 * RANS_OBSERVATION; ++i) {
        memcpy(observation, observations, sizeof observation);
        memcpy(&observation[i % RANS_OBSERVATION], &wild[i / RANS_OBSERVATION], sizeof(float));
        rans_agent_reset(&agent);
        if (rans_agent_act(&agent, observation, command) != RANS_SHUT || !is_shut(command)) { guarded = 0; }
        rans_agent_reset(&agent);
        (void)rans_agent_act(&agent, observations, command);
        if (!(rans_agent_act(&agent, observation, command) & (RANS_HELD | RANS_SHUT))) { guarded = 0; }
    }
    agent.held = INT_MIN;
    if (!(rans_agent_act(&agent, observations, command) & RANS_SHUT) || !is_shut(command)) { guarded = 0; }
    memset(&agent, 0, sizeof agent);
    if (!(rans_agent_act(&agent, observations, command) & RANS_SHUT) || !is_shut(command)) { guarded = 0; }
    return guarded;
}

int main(void)
{
    rans_agent agent;
    float command[RANS_COMMANDS];
    int right = 0;
    double longest = 0.0;
    double whole = 0.0;
    rans_agent_reset(&agent);
    for (int row = 0; row < COUNT; ++row) {
        int same = 1;
        clock_t before;
        double taken;
        if (begins[row]) { rans_agent_reset(&agent); }
        before = clock();
        (void)rans_agent_act(&agent, observations + row * RANS_OBSERVATION, command);
        taken = 1e6 * (double)(clock() - before) / (double)CLOCKS_PER_SEC;
        whole += taken;
        if (taken > longest) { longest = taken; }
        for (int i = 0; i < RANS_COMMANDS; ++i) {
            if (!(fabsf(command[i] - expected[row * RANS_COMMANDS + i]) <= TOLERANCE)) { same = 0; }
        }
        right += same;
    }
    printf("%d of %d golden pairs come out as they should; %.1f us a command, at most %.0f us; "
           "%u bytes of state.\\n",
           right, COUNT, whole / COUNT, longest, (unsigned)sizeof(rans_agent));
    if (!is_guarded()) {
        printf("Observations that are not finite, or a struct without a reset, are flown.\\n");
        return 1;
    }
    return right != COUNT;
}
"""
