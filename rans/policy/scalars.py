"""Evaluation of a policy's program number by number, for executors that print scalars.

`fields` computes rows of a `Program` from fields of any kind, `symbols` traces them. Dense layers are not opened:
they become a `Stage`, whose outputs are inputs of what follows.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from rans.model.fields import (
    Field,
    absolute,
    at_least,
    cos,
    exp,
    floor,
    log,
    sin,
    sqrt,
    tanh,
    where,
    within,
)
from rans.model.trace import Symbol, Untraceable
from rans.policy.program import Program, RowStep, inputs

Row = np.ndarray
"""Fields of one spacecraft, an array of objects with the shape of the ONNX value but for its first axis, of N."""
Dense = Callable[[RowStep, Sequence[Field]], Sequence[Field]]
"""Computes the outputs of a layer from its inputs."""
Gather = Callable[[str, Sequence[Field], np.ndarray], Sequence[Field] | None]
"""Chooses n numbers by the side: from the step's name, the numbers, and a table (S, n) of indices into them.

Its result None means that they are to be chosen by comparisons.
"""


class Layer(NamedTuple):
    """A dense layer, by the names of its parameters."""

    weight: str
    bias: str
    units: int
    activation: str
    """A key of `rans.policy.activations.ACTIVATIONS`, or ""."""


class Stage(NamedTuple):
    """Consecutive dense layers, with no other operation between them."""

    inputs: tuple[Symbol, ...]
    """Inputs of the first layer."""
    layers: tuple[Layer, ...]
    outputs: tuple[Symbol, ...]
    """Outputs of the last layer, which are inputs of what follows."""


class _ArgMax(NamedTuple):
    """Index of the largest of S values: of the last value whose condition holds, else of the first."""

    conditions: tuple[Field, ...]
    """(S - 1,) whether each value but the first is larger than all before it."""

    def of(self, candidates: Sequence[Field]) -> Field:
        """The candidate at the index, of S fields."""
        chosen = candidates[0]
        for condition, candidate in zip(self.conditions, candidates[1:], strict=True):
            are_numbers = isinstance(candidate, int | float) and isinstance(chosen, int | float)
            is_same = candidate == chosen if are_numbers else candidate is chosen
            chosen = chosen if is_same else where(condition, candidate, chosen)
        return chosen


class _Index(NamedTuple):
    """Row of a table (S, ...) of whole numbers, by the index of the largest value."""

    table: np.ndarray
    choice: _ArgMax


EACH: dict[str, Callable[..., Field]] = {
    "Add": lambda a, b: a + b,
    "Sub": lambda a, b: a - b,
    "Mul": lambda a, b: a * b,
    "Div": lambda a, b: a / b,
    "Neg": lambda a: -a,
    "Equal": lambda a, b: a == b,
    "Greater": lambda a, b: a > b,
    "Less": lambda a, b: a < b,
    "Where": where,
    "Cast": lambda condition: where(condition, 1.0, 0.0),
    "Max": at_least,
    "Min": lambda a, high: -at_least(-a, -high),
    "Clip": within,
    "GreaterOrEqual": lambda a, b: a >= b,
    "LessOrEqual": lambda a, b: a <= b,
    "And": lambda a, b: a & b,
    "Or": lambda a, b: a | b,
    "Abs": absolute,
    "Floor": floor,
    "Sqrt": sqrt,
    "Sin": sin,
    "Cos": cos,
    "Tanh": tanh,
    "Exp": exp,
    "Log": log,
    "Identity": lambda a: a,
}
"""Operations on single numbers, by their ONNX names."""


def fields(
    program: Program,
    inputs: Mapping[str, Iterable[Field]],
    requested: Sequence[str],
    dense: Dense,
    gather: Gather | None = None,
) -> dict[str, list[Field]]:
    """Compute rows of a program from others.

    Args:
        program: of the policy.
        inputs: fields of rows and of parameters by name, flat; parameters of layers are not needed.
        requested: names of the rows to compute. "view", the side of the spacecraft, is a single index.
        dense: computes layers.
        gather: chooses commands by the side; None: by comparisons.

    Returns:
        Fields of each row, flat, by its name.

    Raises:
        Untraceable: a row is not in the program, or an operation has no meaning for single numbers.
    """
    values: dict[str, Any] = {
        name: _row(row, program.parameters.get(name)) for name, row in inputs.items()
    }
    for step in program.needed(requested, inputs):
        arguments = [
            values[name] if name in values else program.constants.get(name) for name in step.inputs
        ]
        result = _result(step, arguments, dense, gather)
        pieces = result if step.operation == "Split" else [result]
        values |= dict(zip(step.outputs, pieces, strict=True))
    rows = {name: values[name] for name in requested}
    return {
        name: [value.of(range(len(value.conditions) + 1))]
        if isinstance(value, _ArgMax)
        else [*value.flat]
        for name, value in rows.items()
    }


def symbols(
    program: Program,
    arguments: Mapping[str, Iterable[Field]],
    requested: Sequence[str],
    gather: Gather | None = None,
) -> tuple[dict[str, list[Symbol]], tuple[Stage, ...]]:
    """Trace rows of a program as symbols.

    Arguments are those of `fields`. Parameters that are not known become inputs such as "mean_0".

    Returns:
        Symbols of each row, flat, by its name, and the stages of layers, in order.
    """
    stages = _Stages(program, requested, arguments)
    read = {
        name
        for step in program.needed(requested, arguments)
        if step.operation != "Dense"
        for name in step.inputs
    }
    parameters = {
        name: inputs(name, math.prod(shape))
        for name, shape in program.parameters.items()
        if name in read
    }
    result = fields(program, parameters | dict(arguments), requested, stages.through, gather)
    return {name: [*map(Symbol.constant, row)] for name, row in result.items()}, tuple(
        stages.stages.values()
    )


class _Stages:
    """Collects dense layers, joining a layer to the one before if nothing else reads its outputs."""

    def __init__(self, program: Program, requested: Iterable[str], inputs: Iterable[str]) -> None:
        self.stages: dict[str, Stage] = {}
        """Stages by the name of their outputs."""
        steps = program.needed(requested, inputs)
        self._uses = Counter([*requested, *(name for step in steps for name in step.inputs)])

    def through(self, step: RowStep, row: Sequence[Field]) -> Sequence[Field]:
        """Record a layer in `stages`, and give inputs that stand for its outputs; see `Dense`.

        A layer is joined to the stage before only if nobody else reads that stage's outputs, since these are then
        not stored.
        """
        source, weight, bias = step.inputs
        (name,) = step.outputs
        units = int(step.attributes["units"])
        layer = Layer(weight, bias, units, str(step.attributes["activation"]))
        before = Stage(tuple(map(Symbol.constant, row)), (), ())
        if source in self.stages and self._uses[source] == 1:
            before = self.stages.pop(source)
        outputs = tuple(inputs(name, units))
        self.stages[name] = Stage(before.inputs, (*before.layers, layer), outputs)
        return outputs


def _row(values: Iterable[Field], shape: tuple[int, ...] | None = None) -> Row:
    """An array of objects with these fields as entries, even if a field is an array itself."""
    entries = list(values)
    row = np.empty(len(entries), object)
    for k, value in enumerate(entries):
        row[k] = value
    return row if shape is None else row.reshape(shape)


def _result(step: RowStep, arguments: Sequence[Any], dense: Dense, gather: Gather | None) -> Any:
    """Value of a step, an array of fields, or its values for a split; new operations are a case here."""
    operation = step.operation
    if operation in EACH:
        return _each(EACH[operation], [np.asarray(x, object) for x in arguments])
    axis = int(step.attributes.get("axis", -1))
    # Operations on whole rows; `_Index` is a table with an index that is traced.
    match operation:
        case "Dense" if arguments[0].ndim == 1:
            return _row(dense(step, [*arguments[0].flat]))
        case "Split":
            return np.split(arguments[0], np.cumsum(arguments[1])[:-1], axis=-1)
        case "Concat":
            return np.concatenate(arguments, axis=axis)
        case "Reshape" if isinstance(arguments[0], _Index):
            table, choice = arguments[0]
            return _Index(table.reshape(len(table), *arguments[1][1:]), choice)
        case "Reshape" if arguments[0].size == np.prod(arguments[1][1:]):
            return arguments[0].reshape(arguments[1][1:])
        case "MatMul" if arguments[0].ndim == 1 and arguments[1].dtype.kind == "f":
            row, table = arguments
            return _row(
                sum((x * float(c) for x, c in zip(row, column, strict=True)), start=0.0)
                for column in table.T
            )
        case "ArgMax":
            return _largest(arguments[0])
        case "Gather":
            table, choice = arguments
            if table.dtype.kind == "i":
                return _Index(table, choice)
            return _row(choice.of([*map(float, column)]) for column in table.T)
        case "GatherElements":
            row, (table, choice) = arguments
            if gather is not None and row.size == row.shape[-1]:
                result = gather(step.outputs[0], [*row.flat], table.reshape(len(table), -1))
                if result is not None:
                    return _row(result, row.shape)
            sides = [np.take_along_axis(row, indices, axis - 1) for indices in table]
            return _each(lambda *candidates: choice.of(candidates), sides)
    raise Untraceable(f"the operation {operation!r} of a policy has no meaning for single numbers.")


def _each(function: Callable[..., Field], rows: Sequence[Row]) -> Row:
    """Apply a function number by number to rows, which are broadcast against each other."""
    rows = np.broadcast_arrays(*rows)
    result = np.empty(rows[0].shape, object)
    for index in np.ndindex(result.shape):
        result[index] = function(*(_number(row[index]) for row in rows))
    return result


def _number(x: Any) -> Field:
    """A field as it is; an entry of a table as a Python number."""
    return x.item() if isinstance(x, np.generic) else x


def _largest(values: Sequence[Field]) -> _ArgMax:
    """Index of the largest field as conditions, of equal ones the first: as NumPy's and torch's argmax.

    Ties decide commands: torch, machine code and C choose the same thruster only if the first of equals wins
    everywhere.
    """
    best = values[0]
    conditions = []
    for value in values[1:]:
        is_larger = value > best
        best = where(is_larger, value, best)
        conditions.append(is_larger)
    return _ArgMax(tuple(conditions))
