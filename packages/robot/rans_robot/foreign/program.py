"""Programs of networks that other libraries wrote as ONNX, from which NumPy and C are printed.

A graph is followed for one observation. Operations on constants are computed, those that only move numbers
(Reshape, Split, Concat, ...) move their places, and the others become steps of a `rans.policy.program.Program`. The
result is compared with flights before it is written (`rans_robot.foreign.export`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from rans.extend import ConfigError, Program, Spacecraft, brief, first_line, read_bytes, require
from rans.model.operations import ROWS, is_truth

_LARGEST = 2**26
"""Bytes of an ONNX file that is read; networks in control have less than a thousandth of it."""

_OWN = {"Max", "Min", "Clip", "Cast", "Elu", "Identity"}
"""Operations of programs that take other operands in a graph, or only move numbers there."""
_MOVES = {
    *("Concat", "Dropout", "Expand", "Flatten", "Gather", "Identity", "Reshape", "Slice", "Split"),
    *("Squeeze", "Transpose", "Unsqueeze"),
}
"""Operations that move numbers or repeat them."""
_IN_PIECES = 16
"""Longest row whose sum or largest number is computed by one operation after the other."""


class _Numbers(NamedTuple):
    """A value of the graph that depends on the observation: the place of every number."""

    places: np.ndarray
    """Indices into the reader's places, in the shape that the value has for one observation."""


class _Choice(NamedTuple):
    """Number of the largest entry of a row, which is only used to choose the row of a table."""

    row: str


class _Refused(Exception):
    """An operation with what a program cannot have; the reason as a clause."""


def foreign_program(file: Path, width: int, craft: Spacecraft) -> Program:
    """The network of an ONNX file as a program: "observation" (N, width) to "command" (N, commands).

    Commands beyond the craft's ranges come out at their bounds; one that is not finite stays so, and the exported
    files shut the valves.

    Args:
        file: ONNX file whose first input is the observation and whose first output is the command.
        width: number of columns of an observation.
        craft: spacecraft that the network commands.

    Raises:
        ConfigError: the file cannot be read, has a memory, other numbers of columns or commands, or an operation
            that a program does not have; the sentence names the operation and its node.
        MissingPackage: the package onnx is not installed.
    """
    onnx = require("onnx")
    content = read_bytes(file, _LARGEST)
    try:
        model = onnx.load_model_from_string(content)
        reader = _Reader(model, file, width)
    except ConfigError:
        raise
    except Exception as error:  # a damaged file may raise anything
        raise ConfigError(f"{file} is no network that can be read: {first_line(error)}.") from error
    return reader.program_of(craft)


class _Reader:
    """Follows an ONNX graph from its observation (width,) to its command, and writes a program alike.

    Every number on the way has a place (`_places`); what the program cannot say is refused (`_Refused`).
    """

    def __init__(self, model: Any, file: Path, width: int) -> None:
        from onnx import numpy_helper

        graph = model.graph
        self._model = model
        self._file = file
        self._program = Program()
        self._places: list[tuple[str, int, int]] = []
        """Row, its width and the column of every place; a constant has no row, and its index in `_fixed`."""
        self._fixed: list[float] = []
        self._truths: set[str] = set()
        self._values: dict[str, Any] = {
            table.name: numpy_helper.to_array(table) for table in graph.initializer
        }
        # The observation, for one spacecraft.
        inputs = [item for item in graph.input if item.name not in self._values]
        if len(inputs) != 1:
            raise ConfigError(
                f"{file} has {len(inputs)} inputs ({', '.join(item.name for item in inputs)}): exported is a "
                "network of one input, the observation, without a memory."
            )
        sizes = [item.dim_value for item in inputs[0].type.tensor_type.shape.dim]
        if sizes and sizes[-1] not in (0, width):
            raise ConfigError(
                f"{file} observes {sizes[-1]} numbers, but this task and spacecraft have {width}."
            )
        self._values[inputs[0].name] = self._numbers(
            "observation", (1,) * (len(sizes) - 1) + (width,)
        )
        # Only what the first output needs: other outputs are values, probabilities and the like.
        needed = {graph.output[0].name}
        nodes = []
        for node in reversed(graph.node):
            if needed.intersection(node.output):
                needed.update(node.input)
                nodes.append(node)
        for node in reversed(nodes):
            self._follow(node)
        self._answer = self._values[graph.output[0].name]

    def program_of(self, craft: Spacecraft) -> Program:
        """The program, with its answer as commands within the ranges of a craft.

        Clipping to the ranges is part of the exported program, as a foreign network answers with anything.
        """
        if not isinstance(self._answer, _Numbers):
            raise ConfigError(
                f"{self._file} answers without its observation, or with the number of a choice: its first output "
                f"must be {craft.command_count} commands."
            )
        count = self._answer.places.size
        if count != craft.command_count:
            raise ConfigError(
                f"{self._file} answers with {count} numbers, but {craft.name} takes {craft.command_count} commands."
            )
        row = self._row(self._answer.places)
        # A comparison is false for what is not a number, which therefore stays.
        for operation, bounds in (
            ("Greater", [span.high for span in craft.commands]),
            ("Less", [span.low for span in craft.commands]),
        ):
            limit = self._program.constant(bounds)
            is_beyond = self._program.apply(operation, row, limit)
            row = self._program.apply("Where", is_beyond, limit, row)
        self._program.apply("Identity", row, name="command")
        program = self._program.pruned(["command"])
        for name, table in program.constants.items():
            if table.dtype.kind == "f":
                program.constants[name] = table.astype(np.float32)
        return program

    def _follow(self, node: Any) -> None:
        """Add the values of one node's outputs to `_values`, by the kind of its operands.

        A refusal names the node.
        """
        operands: list[Any] = [self._values[name] if name else None for name in node.input]
        attributes = _attributes(node)
        try:
            if not any(isinstance(value, _Numbers | _Choice) for value in operands):
                results = self._computed(node, operands)
            elif node.op_type == "Shape":
                results = [np.array(operands[0].places.shape, dtype=np.int64)]
            elif any(isinstance(value, _Choice) for value in operands):
                results = [self._of_choice(node.op_type, operands, attributes)]
            elif node.op_type in _MOVES:
                results = self._moved(node, operands)
            else:
                results = [self._applied(node.op_type, operands, attributes)]
        except _Refused as reason:
            raise ConfigError(
                f"{self._file}: the node {brief(node.name or node.output[0])} is the operator {node.op_type}, "
                f"{reason}. `rans evaluate` and `rans compare` fly the file as it is."
            ) from None
        self._values |= dict(zip(node.output, results, strict=False))

    def _computed(self, node: Any, operands: Sequence[Any]) -> list[np.ndarray]:
        """Arrays that ONNX's own reference makes of constants; random operations are refused (`_Refused`)."""
        from onnx import helper
        from onnx.reference import ReferenceEvaluator

        names = dict.fromkeys(name for name in node.input if name)
        inputs = [helper.make_empty_tensor_value_info(name) for name in names]
        outputs = [helper.make_empty_tensor_value_info(name) for name in node.output if name]
        graph = helper.make_graph([node], "node", inputs, outputs)
        model = helper.make_model(graph, opset_imports=self._model.opset_import)
        arrays = {name: value for name, value in zip(node.input, operands, strict=True) if name}
        if node.op_type.startswith(("Random", "Bernoulli", "Multinomial")):
            raise _Refused("whose results are random: export the deterministic policy")
        try:
            return [np.asarray(value) for value in ReferenceEvaluator(model).run(None, arrays)]
        except Exception as error:  # an operation of another domain, or with wrong tables
            raise _Refused(f"which cannot be computed: {first_line(error)}") from error

    def _moved(self, node: Any, operands: Sequence[Any]) -> list[_Numbers]:
        """Places after an operation that moves numbers; constants between them get places of their own.

        Places are whole numbers that ONNX's own reference moves, so that no rule of an operation is written here.
        """
        # Concat alone takes numbers in all of its operands; those of the others after the first are indices.
        joins = node.op_type == "Concat"
        places = [
            value.places
            if isinstance(value, _Numbers)
            else self._constants(value)
            if joins and value is not None
            else value
            for value in operands
        ]
        if any(isinstance(value, _Numbers) for value in operands[1:]) and not joins:
            raise _Refused("whose indices depend on the observation, which no exported file knows")
        return [_Numbers(value.astype(np.int64)) for value in self._computed(node, places)]

    def _applied(self, operator: str, operands: Sequence[Any], attributes: dict[str, Any]) -> Any:
        """Numbers after an operation that computes some: steps are added to the program in the graph's order."""
        first = operands[0]
        if operator == "Div" and any(
            isinstance(value, np.ndarray) and value.dtype.kind in "iu" for value in operands
        ):
            # ONNX leaves out the fraction there, and a program has no whole numbers.
            raise _Refused("of whole numbers, which exported files do not know")
        if operator in ROWS.keys() - _OWN:
            return self._each(operator, *operands)
        match operator:
            case "Gemm" | "MatMul":
                return self._linear(operator, operands, attributes)
            case "Max" | "Min":
                result = first
                for value in operands[1:]:
                    result = self._each(operator, result, value)
                return result
            case "Clip":
                low, high = (*operands[1:], None, None)[:2]
                low = attributes.get("min") if low is None else low
                high = attributes.get("max") if high is None else high
                result = first if low is None else self._each("Max", first, low)
                return result if high is None else self._each("Min", result, high)
            case "Elu":
                below = self._each("Mul", self._each("Elu", first), attributes.get("alpha", 1.0))
                return self._each("Where", self._each("Greater", first, 0.0), first, below)
            case "LeakyRelu" | "PRelu":
                slope = attributes.get("alpha", 0.01) if operator == "LeakyRelu" else operands[1]
                below = self._each("Mul", first, slope)
                return self._each("Where", self._each("Less", first, 0.0), below, first)
            case "Erf":
                return self._error_function(first)
            case "Gelu":
                return self._gelu(first, attributes.get("approximate", b"none"))
            case "Softplus":
                # log(1 + exp(x)) without overflow.
                small = self._each("Exp", self._each("Neg", self._each("Abs", first)))
                rest = self._each("Log", self._each("Add", small, 1.0))
                return self._each("Add", self._each("Max", first, 0.0), rest)
            case "Pow":
                exponent = _table(operands[1])
                if np.size(exponent) != 1 or float(np.ravel(exponent)[0]) != 2.0:
                    raise _Refused("with another exponent than 2, which exported files do not know")
                return self._each("Mul", first, first)
            case "Reciprocal":
                return self._each("Div", 1.0, first)
            case "Cast":
                return self._cast(first, attributes["to"])
            case "Softmax" | "LogSoftmax" | "ReduceLogSumExp":
                return self._exponentials(operator, operands, attributes)
            case "ReduceSum" | "ReduceMax" | "ReduceMean":
                return self._reduced(operator, first.places, *_axis(operands, attributes))
            case "LayerNormalization":
                return self._layer_norm(operands, attributes)
            case "BatchNormalization" if first.places.ndim <= 2:
                scale, shift, mean, variance = map(_table, operands[1:5])
                factor = scale / np.sqrt(variance + attributes.get("epsilon", 1e-5))
                return self._each("Add", self._each("Mul", first, factor), shift - mean * factor)
            case "ArgMax":
                return self._largest(first.places, attributes)
        raise _Refused("which exported files do not know")

    def _error_function(self, x: _Numbers) -> _Numbers:
        """Error function of numbers x, within 1.5e-7, which is single precision of numbers near 1.

        Source: Abramowitz and Stegun, Handbook of Mathematical Functions, 1964, formula 7.1.26.

        Source: Abramowitz and Stegun, Handbook of Mathematical Functions, 1964, formula 7.1.26.
        """
        size = self._each("Abs", x)
        inverse = self._each("Div", 1.0, self._each("Add", self._each("Mul", size, 0.3275911), 1.0))
        sum_so_far: Any = 1.061405429
        for coefficient in (-1.453152027, 1.421413741, -0.284496736, 0.254829592):
            sum_so_far = self._each("Add", self._each("Mul", inverse, sum_so_far), coefficient)
        tail = self._each("Exp", self._each("Neg", self._each("Mul", size, size)))
        rest = self._each("Mul", self._each("Mul", sum_so_far, inverse), tail)
        positive = self._each("Sub", 1.0, rest)
        negative = self._each("Neg", positive)
        return self._each("Where", self._each("Less", x, 0.0), negative, positive)

    def _gelu(self, x: _Numbers, approximation: bytes | str) -> _Numbers:
        """Gaussian error linear unit: x times the normal distribution function of x, or its approximation by tanh.

        Source: Hendrycks and Gimpel, "Gaussian Error Linear Units (GELUs)", arXiv:1606.08415, 2016.
        """
        if approximation in (b"tanh", "tanh"):
            cube = self._each("Mul", self._each("Mul", x, x), x)
            inner = self._each("Add", x, self._each("Mul", cube, 0.044715))
            step = self._each("Tanh", self._each("Mul", inner, math.sqrt(2.0 / math.pi)))
        else:
            step = self._error_function(self._each("Mul", x, math.sqrt(0.5)))
        return self._each("Mul", self._each("Mul", x, 0.5), self._each("Add", step, 1.0))

    def _numbers(self, row: str, shape: Sequence[int]) -> _Numbers:
        """Places of all columns of a row of the program."""
        width = math.prod(shape)
        begin = len(self._places)
        self._places += [(row, width, column) for column in range(width)]
        return _Numbers(np.arange(begin, begin + width).reshape(shape))

    def _constants(self, table: Any) -> np.ndarray:
        """Places of numbers that are the same for all observations."""
        begin = len(self._places)
        values = np.asarray(table, dtype=float)
        self._places += [("", 0, len(self._fixed) + k) for k in range(values.size)]
        self._fixed += values.ravel().tolist()
        return np.arange(begin, begin + values.size).reshape(values.shape)

    def _row(self, places: np.ndarray) -> str:
        """Name of the program's row of these numbers (any shape, raveled), an existing one if it is the same.

        Steps may be added to the program for it.
        """
        entries = [self._places[k] for k in places.ravel()]
        name, width, _ = entries[0]
        if name and entries == [(name, width, column) for column in range(width)]:
            return name
        parts = [
            self._program.single(row, size)[column]
            if row
            else self._program.constant(self._fixed[column])
            for row, size, column in entries
        ]
        return parts[0] if len(parts) == 1 and name else self._program.joined(*parts)

    def _each(self, operation: str, *operands: Any) -> _Numbers:
        """An operation number by number, of numbers and constants that are broadcast against each other."""
        arrays = [
            value.places if isinstance(value, _Numbers) else np.asarray(value) for value in operands
        ]
        shape = np.broadcast_shapes(*(array.shape for array in arrays))
        rows = []
        for value, array in zip(operands, arrays, strict=True):
            if isinstance(value, _Numbers):
                rows.append(self._row(np.broadcast_to(array, shape)))
            elif array.size == 1:
                rows.append(self._program.constant(float(array.ravel()[0])))
            else:
                table = np.broadcast_to(array, shape).astype(float).ravel()
                rows.append(self._program.constant(table))
        row = self._program.apply(operation, *rows)
        if is_truth(operation):
            self._truths.add(row)
        return self._numbers(row, shape)

    def _linear(self, operator: str, operands: Sequence[Any], attributes: dict[str, Any]) -> Any:
        """A layer: a row times a constant table, plus a constant row.

        `_Refused` if both factors depend on the observation.
        """
        x, table, *bias = operands
        if not isinstance(x, _Numbers) or not isinstance(table, np.ndarray):
            raise _Refused(
                "whose factors both depend on the observation, or come the other way round"
            )
        if operator == "Gemm" and attributes.get("transA"):
            raise _Refused("of a transposed row, which exported files do not know")
        weight = np.asarray(table, dtype=float)
        if not attributes.get("transB"):
            weight = weight.T
        if weight.ndim != 2 or x.places.size != weight.shape[1]:
            raise _Refused(
                f"of {x.places.shape} and {table.shape} numbers, and exported files know a row times a table"
            )
        shift = np.zeros(len(weight))
        if bias and bias[0] is not None:
            if not isinstance(bias[0], np.ndarray):
                raise _Refused(
                    "whose bias depends on the observation, which exported files do not know"
                )
            shift = shift + attributes.get("beta", 1.0) * np.asarray(bias[0], dtype=float).ravel()
        row = self._program.apply(
            "Gemm",
            self._row(x.places),
            self._program.constant(attributes.get("alpha", 1.0) * weight),
            self._program.constant(shift),
            transB=1,
        )
        return self._numbers(row, (*x.places.shape[:-1], len(weight)))

    def _cast(self, x: _Numbers, to: int) -> _Numbers:
        """Truths as 0 and 1, and numbers x without their fraction where the type ``to`` is whole."""
        from onnx import TensorProto

        if {self._places[k][0] for k in x.places.ravel()} <= self._truths:
            return x if to == TensorProto.BOOL else self._each("Cast", x)
        if to in (TensorProto.FLOAT, TensorProto.DOUBLE, TensorProto.FLOAT16):
            return x
        if to == TensorProto.BOOL:
            return self._each("Greater", self._each("Abs", x), 0.0)
        whole = self._each("Floor", self._each("Abs", x))
        below = self._each("Neg", whole)
        return self._each("Where", self._each("Less", x, 0.0), below, whole)

    def _pieces(self, places: np.ndarray, axis: int) -> list[_Numbers]:
        """Numbers along an axis, each kept as an axis of one."""
        count = places.shape[axis]
        return [_Numbers(places.take([k], axis=axis)) for k in range(count)]

    def _reduced(self, operator: str, places: np.ndarray, axis: int, keeps: bool) -> _Numbers:
        """Sum, mean or largest number of places (an array of any shape) along an axis, in their order.

        The order of sums is that of the places, in pieces; ONNX Runtime's is another one, to which `_check` gives
        room.
        """
        count = places.shape[axis]
        operation = "Max" if operator == "ReduceMax" else "Add"
        if count > _IN_PIECES and places.size == count:
            name = "ReduceMax" if operation == "Max" else "ReduceSum"
            row = self._program.apply(name, self._row(places), axes=[-1], keepdims=1)
            shape = [1] * places.ndim
            result = self._numbers(row, shape)
        else:
            result, *others = self._pieces(places, axis)
            for value in others:
                result = self._each(operation, result, value)
        if operator == "ReduceMean":
            result = self._each("Div", result, float(count))
        return result if keeps else _Numbers(result.places.squeeze(axis))

    def _exponentials(
        self, operator: str, operands: Sequence[Any], attributes: dict[str, Any]
    ) -> _Numbers:
        """Softmax, its logarithm, or the logarithm of the sum of exponentials, less the largest number first."""
        x = operands[0]
        axis, keeps = (
            _axis(operands, attributes)
            if operator == "ReduceLogSumExp"
            else (int(attributes.get("axis", -1)), True)
        )
        largest = self._reduced("ReduceMax", x.places, axis, True)
        less = self._each("Sub", x, largest)
        powers = self._each("Exp", less)
        total = self._reduced("ReduceSum", powers.places, axis, True)
        if operator == "Softmax":
            return self._each("Div", powers, total)
        if operator == "LogSoftmax":
            return self._each("Sub", less, self._each("Log", total))
        result = self._each("Add", self._each("Log", total), largest)
        return result if keeps else _Numbers(result.places.squeeze(axis))

    def _layer_norm(self, operands: Sequence[Any], attributes: dict[str, Any]) -> _Numbers:
        """A row less its mean, over its standard deviation, times a scale and plus a shift, along the last axis."""
        x, scale, *shift = operands
        if attributes.get("axis", -1) not in (-1, x.places.ndim - 1):
            raise _Refused("over several axes, which exported files do not know")
        mean = self._reduced("ReduceMean", x.places, -1, True)
        off = self._each("Sub", x, mean)
        variance = self._reduced("ReduceMean", self._each("Mul", off, off).places, -1, True)
        deviation = self._each("Sqrt", self._each("Add", variance, attributes.get("epsilon", 1e-5)))
        result = self._each("Mul", self._each("Div", off, deviation), scale)
        return self._each("Add", result, shift[0]) if shift and shift[0] is not None else result

    def _largest(self, places: np.ndarray, attributes: dict[str, Any]) -> Any:
        """Number of the largest entry along an axis: 0 or 1 of two; of more a choice.

        Places are an array of any shape.
        """
        axis = int(attributes.get("axis", 0))
        if attributes.get("select_last_index"):
            raise _Refused("which takes the last of equal ones, and exported files the first")
        if places.shape[axis] == 2:
            first, second = self._pieces(places, axis)
            result = self._each("Cast", self._each("Greater", second, first))
            keeps = attributes.get("keepdims", 1)
            return result if keeps else _Numbers(result.places.squeeze(axis))
        if places.size != places.shape[axis]:
            raise _Refused(
                "of several rows of more than two numbers, which exported files do not know"
            )
        return _Choice(self._row(places))

    def _of_choice(self, operator: str, operands: Sequence[Any], attributes: dict[str, Any]) -> Any:
        """The row of a constant table that a choice picks; whatever computes with its number is refused."""
        choice = next(value for value in operands if isinstance(value, _Choice))
        if operator in ("Reshape", "Squeeze", "Unsqueeze", "Flatten", "Identity", "Cast"):
            return choice
        table = operands[0]
        is_table = isinstance(table, np.ndarray) and table.ndim == 2
        if operator == "Gather" and is_table and attributes.get("axis", 0) == 0:
            index = self._program.apply("ArgMax", choice.row, axis=1, keepdims=0)
            rows = self._program.constant(np.asarray(table, dtype=float))
            chosen = self._program.apply("Gather", rows, index, axis=0)
            return self._numbers(chosen, (1, table.shape[1]))
        raise _Refused(
            "which computes with the number of a choice among more than two; exported files know tables of "
            "commands (Gather) of which it chooses a row"
        )


def _attributes(node: Any) -> dict[str, Any]:
    from onnx import helper

    return {item.name: helper.get_attribute_value(item) for item in node.attribute}


def _table(value: Any) -> np.ndarray:
    """An operand that must be constant, such as an exponent or axes, as an array of float64.

    Raises:
        _Refused: it depends on the observation (`_Numbers`, which has places in place of values).
    """
    if isinstance(value, _Numbers):
        raise _Refused(
            "by numbers that depend on the observation, which exported files do not know"
        )
    return np.asarray(value, dtype=float)


def _axis(operands: Sequence[Any], attributes: dict[str, Any]) -> tuple[int, bool]:
    """The one axis of a reduction, and whether it stays as an axis of one."""
    axes = attributes.get("axes")
    if len(operands) > 1 and operands[1] is not None:
        axes = _table(operands[1])
    if axes is None or np.size(axes) != 1:
        raise _Refused("along several axes, which exported files do not know")
    return int(np.ravel(axes)[0]), bool(attributes.get("keepdims", 1))
