"""A straight-line program over rows of numbers, in which a policy is written down (`rans.policy.traced`).

A row is (N, k): k numbers of each of N spacecraft. An operation is one of ONNX's, by its name there
(https://onnx.ai/onnx/operators), with ONNX's meaning; a dense layer is one node, "Dense", that nobody opens who has
something better for it, such as tensor cores. Executors print the rows (`rans.deploy`), or ask for the single
numbers in them (`Program.fields`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from rans.model.fields import Field
from rans.model.operations import OPERATIONS, ROWS, Dialect, Untraceable, of_row
from rans.model.trace import Symbol, ordered


@dataclass(frozen=True)
class RowStep:
    """One operation, by ONNX's name and with its meaning; or a layer with its activation, "Dense".

    Inputs of a layer are a row, weights (o, i) and biases (o,); its attributes the number of ``units`` o and the
    ``activation``, a key of `rans.policy.activations.ACTIVATIONS` or "".
    """

    operation: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    attributes: Mapping[str, Any] = field(default_factory=dict)

    @property
    def is_of_numbers(self) -> bool:
        """Whether the operation is one on single numbers, entry by entry, and not on whole rows and tables."""
        return self.operation in ROWS

    @property
    def is_truth(self) -> bool:
        """Whether an operation on single numbers gives truth values, as comparisons do."""
        name, kind = of_row(self.operation)
        return (OPERATIONS[name].result or kind) == "bool"

    def text(self, dialect: Dialect, *operands: str) -> str:
        """An operation on single numbers as an expression of a language."""
        return dialect.text(*of_row(self.operation), *operands)


@dataclass(eq=False)
class Program:
    """Steps in order, on values that have names."""

    steps: list[RowStep] = field(default_factory=list)
    """The operations."""
    constants: dict[str, np.ndarray] = field(default_factory=dict)
    """Tables and numbers that are the same for all policies of one architecture, by their names."""
    parameters: dict[str, tuple[int, ...]] = field(default_factory=dict)
    """Shapes of those that training changes, by their names."""
    _single: dict[tuple[str, int], list[str]] = field(default_factory=dict)

    def constant(self, value: object, name: str = "", dtype: type = np.float64) -> str:
        """A table or number that is the same for all observations; whole numbers are indices."""
        name = name or f"constant_{len(self.constants)}"
        self.constants[name] = np.array(value, dtype)
        return name

    def parameter(self, name: str, *shape: int) -> str:
        """A table that training changes, float32."""
        self.parameters[name] = shape
        return name

    def apply(self, operation: str, *inputs: str, name: str = "", **attributes: Any) -> str:
        """The value of an operation; a name is for readers, and for executors that ask for this row."""
        output = name or f"x{len(self.steps)}"
        self.steps.append(RowStep(operation, inputs, (output,), attributes))
        return output

    def split(self, value: str, widths: Sequence[int], names: Sequence[str] = ()) -> list[str]:
        """The value's last axis in pieces of these widths; none for a piece without any.

        Names are those of the next steps, so that two values of one program may not be split under the same names.
        """
        nonempty = [index for index, width in enumerate(widths) if width]
        if len(nonempty) == 1 and not names:
            return [value if width else "" for width in widths]
        outputs = [names[index] if names else f"{value}_{n}" for n, index in enumerate(nonempty)]
        if len(nonempty) == 1:
            self.apply("Identity", value, name=outputs[0])
        else:
            sizes = self.constant([widths[index] for index in nonempty], dtype=np.int64)
            self.steps.append(RowStep("Split", (value, sizes), tuple(outputs), {"axis": -1}))
        pieces = iter(outputs)
        return [next(pieces) if width else "" for width in widths]

    def single(self, value: str, width: int) -> list[str]:
        """The columns of a row, each by itself."""
        if (value, width) not in self._single:
            self._single[value, width] = self.split(value, [1] * width)
        return self._single[value, width]

    def joined(self, *values: str, name: str = "") -> str:
        """Values side by side along the last axis; empty names are nothing, a number is the same for all N.

        ONNX and C take rows of one length only, which is why numbers are spread first.
        """
        parts = [value for value in values if value]
        row = next((part for part in parts if part not in self.constants), "")
        if row and len(row_numbers := self.constants.keys() & set(parts)):
            # A number has no axis of N: it is added to nothing of a row that has.
            nothing = self.apply("Mul", row, self.constant(0.0))
            sums = {number: self.apply("Add", nothing, number) for number in sorted(row_numbers)}
            parts = [sums.get(part, part) for part in parts]
        return self.apply("Concat", *parts, name=name, axis=-1)

    def shaped(self, value: str, *shape: int) -> str:
        """Value reshaped to (N, *shape)."""
        return self.apply("Reshape", value, self.constant((-1, *shape), dtype=np.int64))

    def dense(
        self,
        value: str,
        layer: str,
        units: int,
        width: int,
        activation: str = "",
    ) -> str:
        """A layer of that name and its activation, (N, width) to (N, units)."""
        weight = self.parameter(f"{layer}.weight", units, width)
        bias = self.parameter(f"{layer}.bias", units)
        return self.apply("Dense", value, weight, bias, units=units, activation=activation)

    def each(self, formula: Callable[..., Field], *rows: str) -> str:
        """A formula on fields applied to every number of rows, which are broadcast against each other."""
        symbols = inputs("number", len(rows))
        result = Symbol.constant(formula(*symbols))
        return self.lowered([result], dict(zip(symbols, rows, strict=True)))[0]

    def lowered(self, results: Sequence[Field], names: Mapping[Symbol, str]) -> list[str]:
        """The rows that these symbols are, of inputs that are rows.

        Raises:
            Untraceable: one of them is made by an operation that ONNX does not have.
        """
        roots = [Symbol.constant(result) for result in results]
        values = dict(names)
        for symbol in ordered(roots, names):
            if symbol.operation == "constant":
                values[symbol] = self.constant(symbol.value)
                continue
            operands = [values[x] for x in symbol.args]
            if symbol.operation == "where" and [x.value for x in symbol.args[1:]] == [1.0, 0.0]:
                values[symbol] = self.apply("Cast", operands[0], to=1)  # to float32
            elif (clipped := _clipped(symbol)) is not None:
                row, *bounds = (values.get(x) or self.constant(x.value) for x in clipped)
                values[symbol] = self.apply("Clip", row, *bounds)
            elif (kind := OPERATIONS.get(symbol.operation)) and kind.onnx:
                values[symbol] = self.apply(kind.onnx, *operands)
            else:
                raise Untraceable(
                    f"{symbol.operation!r} of an observation's columns has no place in a policy's program: "
                    "only what ONNX has an operation for does."
                )
        return [values[root] for root in roots]

    def pruned(self, outputs: Iterable[str]) -> Program:
        """Program reduced to the steps that these outputs need, and the tables that they read."""
        steps = self.needed(outputs)
        used = {name for step in steps for name in step.inputs}
        return Program(
            steps,
            {name: x for name, x in self.constants.items() if name in used},
            {name: x for name, x in self.parameters.items() if name in used},
        )

    def has(self, name: str) -> bool:
        """Whether one of its steps makes this value."""
        return any(name in step.outputs for step in self.steps)

    def needed(self, outputs: Iterable[str], computed: Iterable[str] = ()) -> list[RowStep]:
        """The steps that these values need, once others are known.

        Raises:
            Untraceable: one of them is made by no step; inputs belong in ``computed``.
        """
        names = set(outputs) - set(computed)
        if missing := names - {name for step in self.steps for name in step.outputs}:
            raise Untraceable(f"a program of this policy has no {', '.join(sorted(missing))}.")
        required = []
        for step in reversed(self.steps):
            if names.intersection(step.outputs):
                names.update(set(step.inputs) - set(computed))
                required.append(step)
        return required[::-1]


def _clipped(symbol: Symbol) -> tuple[Symbol, ...] | None:
    """(x, low, high) of a symbol min(max(x, low), high) with constant bounds; None of another symbol."""
    inner = symbol.args[0]
    if (symbol.operation, inner.operation) != ("minimum", "maximum"):
        return None
    result = *inner.args, symbol.args[1]
    return result if all(x.operation == "constant" for x in result[1:]) else None


def inputs(name: str, count: int) -> list[Symbol]:
    """Symbols of so many numbers of this name."""
    return [Symbol.input(f"{name}_{k}") for k in range(count)]
