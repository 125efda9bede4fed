"""The steps of a program as lines of one C function, and the tables that they read.

It prints what `rans.deploy.program` makes of a policy, in float32; `tests/test_files.py` compiles it and asks for
the golden commands.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence, Set
from typing import Any

import numpy as np

from rans.extend import ConfigError, Ports, Program, RowStep
from rans_c_code.compressed import smallest
from rans_c_code.memory import Scratch, last_uses
from rans_c_code.search import searches
from rans_c_code.text import DIALECT, literal, rows_of, table_name, variable
from rans_c_code.values import Shape, Value


class _Loop:
    """Operations on single numbers of arrays of a size, which one loop computes."""

    def __init__(self) -> None:
        self.size = 0
        self.lines: dict[str, tuple[str, str]] = {}
        """By the name of a value: its entry in the loop, and the expression."""
        self.uses = Counter[str]()
        """Number of times that the loop uses a value."""


class Printer:
    """The steps of a program as lines of one C function."""

    def __init__(self, program: Program, ports: Ports) -> None:
        self._program = program
        self._known: dict[str, Value] = {
            "observation": Value("observation", (1, ports.observation)),
            "memory": Value("memory", (1, ports.memory)),
        }
        self._used: dict[str, None] = {}
        self._tables: dict[tuple[Any, ...], Value] = {}
        self._ports = ports
        self._lines: list[str] = []
        self._scores = searches(program)
        self._packable = packable(program, {offset for _, offset in self._scores.whole.values()})
        self._constants = program.constants
        self._loop = _Loop()
        self._scratch = Scratch()
        self._uses = Counter(
            [name for step in program.steps for name in step.inputs] + ["command", "memory_out"]
        )

    def lines(self) -> list[str]:
        """Everything from the observation and the memory to the command and the memory after.

        Arrays are freed only where no loop is open, since its lines are printed later than they are made.
        """
        last = last_uses(self._program, self._scores.parts)
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
        """Constant arrays that the lines use, in the order of their first use; to be called after all lines."""
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
                    byte = f"{stored.dtype}_t"
                    texts.append(
                        f"static const {byte} {table_name(name)}_index[{len(stored)}] = {{\n    "
                        f"{rows_of([str(x) for x in stored])}}};"
                    )
                    flat = packed.values.ravel()
                kind, numbers = "float", [literal(float(x)) for x in flat]
            texts.append(
                f"static const {kind} {table_name(name)}[{len(numbers)}] = {{\n    {rows_of(numbers)}}};"
            )
        return texts

    def _copy(self, name: str, target: str, size: int) -> None:
        value = self._value(name)
        text = value.at("i", (size,)) if value.is_array else value.text
        self._lines.append(f"for (int i = 0; i < {size}; ++i) {{ {target}[i] = {text}; }}")

    def _value(self, name: str) -> Value:
        """The C text, shape and kind of an operand; constants get tables on first use, equal ones share one."""
        if name not in self._known:
            constant = self._constants[name]
            kind = "int" if constant.dtype.kind == "i" else "float"
            key = constant.dtype.str, constant.shape, constant.tobytes(), name in self._packable
            if constant.size == 1:
                item = constant.item()
                text = str(int(item)) if kind == "int" else literal(float(item))
                text = f"({text})" if text.startswith("-") else text
            else:
                # Of equal tables the first one is there.
                if key in self._tables:
                    self._known[name] = self._tables[key]
                    return self._known[name]
                text = table_name(name)
                self._used[name] = None
            packed = None
            if name in self._packable:
                packed = smallest(constant.reshape(len(constant), -1))
            self._known[name] = Value(text, constant.shape, kind, packed)
            if constant.size > 1:
                self._tables[key] = self._known[name]
        return self._known[name]

    def _result(self, name: str, shape: Shape, kind: str = "float") -> Value:
        """New variable of a value of the program, declared at once if it is an array."""
        value = Value(variable(name), shape, kind)
        self._known[name] = value
        if value.is_array:
            self._declare(value)
        return value

    def _declare(self, value: Value) -> None:
        """Room for an array: floats share what other arrays have used before."""
        if value.kind == "int":
            self._lines.append(f"int {value.text}[{value.size}];")
            return
        start = self._scratch.taken(value.text, value.size)
        self._lines.append(f"float *const {value.text} = scratch + {start};")

    def _set(self, value: Value, text: str) -> None:
        """Every entry of an array, or the number."""
        if value.is_array:
            self._lines.append(
                f"for (int i = 0; i < {value.size}; ++i) {{ {value.text}[i] = {text}; }}"
            )
        else:
            self._lines.append(f"const {value.kind} {value.text} = {text};")

    def _elementwise(self, step: RowStep) -> None:
        """An operation on single numbers; those on arrays of a size that follow each other have one loop.

        Lines wait in `_loop` until a step has another size or reads an entry of another place.
        """
        name = step.outputs[0]
        values = [self._value(operand) for operand in step.inputs]
        shape = np.broadcast_shapes(*(array.shape for array in values))
        kind = "int" if step.is_truth else "float"
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
        text = step.text(DIALECT, *texts)
        if size == 1:
            self._set(self._result(name, shape, kind), text)
            return
        value = Value(variable(name), shape, kind)
        self._known[name] = value
        loop.lines[name] = (f"{value.text}_i", text)
        loop.size = size
        loop.uses.update(step.inputs)

    def _end_loop(self) -> None:
        """Print the loop; only what later steps use is stored in arrays.

        Any step that is no operation on single numbers of this size must call it before it prints.
        """
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

    def _print(self, step: RowStep) -> None:
        """Print one step of the program: element-wise operations in a shared loop, others on their own.

        Ends the waiting loop first, so that lines keep the program's order.
        """
        if step.is_of_numbers and step.outputs[0] not in self._scores.parts:
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
                self._known[name] = Value(value.text, (outer, *inner), value.kind)
            case "Concat":
                self._concat(name, [self._value(operand) for operand in step.inputs])
            case "Gemm":
                self._gemm(name, *(self._value(operand) for operand in step.inputs))
            case "Transpose":
                (value,) = (self._value(operand) for operand in step.inputs)
                first, rows, columns = value.shape
                result = self._result(name, (first, columns, rows), value.kind)
                self._set(result, f"{value.text}[i % {rows} * {columns} + i / {rows}]")
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

    def _product(self, step: RowStep) -> str:
        """Entry i of a row (1, k) times a table (k, n), as one C expression.

        Sums in the order of the columns, which golden commands allow for (`tests/base/test_files.py`).
        """
        row, table = step.inputs
        a = self._value(row)
        b = self._value(table)
        return " + ".join(
            f"{a.text}[{k}] * {b.entry(str(k), 'i')}"
            if a.is_array
            else f"{a.text} * {b.entry(str(k), 'i')}"
            for k in range(b.shape[0])
        )

    def _split(self, step: RowStep, widths: Sequence[int]) -> None:
        """Print the parts of a value along the last axis as values of their own.

        One row needs no copy: its parts are places in it.
        """
        value = self._value(step.inputs[0])
        rows = math.prod(value.shape[:-1])
        start = 0
        for name, width in zip(step.outputs, widths, strict=True):
            shape = (*value.shape[:-1], width)
            if rows == 1 and width == 1:
                self._known[name] = Value(f"{value.text}[{start}]", shape, value.kind)
            elif rows == 1:
                self._known[name] = Value(f"({value.text} + {start})", shape, value.kind)
            else:
                result = self._result(name, shape, value.kind)
                self._set(
                    result, f"{value.text}[i / {width} * {value.shape[-1]} + {start} + i % {width}]"
                )
            start += width

    def _concat(self, name: str, parts: Sequence[Value]) -> None:
        """Print values side by side along the last axis as one array; all have the same rows."""
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

    def _gemm(self, name: str, x: Value, weight: Value, bias: Value) -> None:
        """Print a product of a row with a matrix, weight times x plus bias.

        `x` is (1, inputs), the weight (outputs, inputs). Sums begin with the bias, as NumPy's form does.
        """
        outputs, inputs = weight.shape
        if x.shape[0] > 1:
            raise ConfigError(
                "the agent has a layer of several rows, which the export as C does not know: export as onnx or "
                "numpy."
            )
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

    def _products(self, name: str, a: Value, b: Value) -> None:
        """Print a product of matrices a (1, rows, inner) and b (1, inner, columns) of one spacecraft.

        Sums go from the first number to the last, in float32: checks of exported agents compare commands.
        """
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

    def _argmax(self, step: RowStep) -> None:
        """Print the number of the largest entry, the first of equal ones, as NumPy's argmax.

        Of equal ones the first, as in every executor: which thrusters open depends on it.
        """
        name = step.outputs[0]
        result = Value(variable(name), (1,), "int")
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


def packable(program: Program, offsets: Set[str]) -> frozenset[str]:
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
