"""The single numbers in a program's rows, as fields: how executors that print scalars read `Program`.

Dense layers stay what they are: inputs and outputs of `Stage`.
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
from rans.policy.program import Program, Step, inputs

Row = np.ndarray
"""Fields (objects) of one spacecraft, in the shape that ONNX gives a value without its first axis, of N."""
Dense = Callable[[Step, Sequence[Field]], Sequence[Field]]
"""The outputs of a layer to inputs."""
Gather = Callable[[str, Sequence[Field], np.ndarray], Sequence[Field] | None]
"""Numbers chosen from others, by the step's name, those others and a table (S, n) of which each side takes.

None: they are chosen by comparisons.
"""


class Layer(NamedTuple):
    """A dense layer, by the names of its parameters."""

    weight: str
    bias: str
    units: int
    activation: str
    """A key of `rans.policy.activations.ACTIVATIONS`, or ""."""


class Stage(NamedTuple):
    """Dense layers one after the other."""

    inputs: tuple[Symbol, ...]
    layers: tuple[Layer, ...]
    outputs: tuple[Symbol, ...]
    """Inputs of what is computed afterwards."""


class _Choice(NamedTuple):
    """Which of S values is the largest: the last one of which a condition holds, else the first."""

    conditions: tuple[Field, ...]

    def of(self, candidates: Sequence[Field]) -> Field:
        """The chosen one of S fields."""
        chosen = candidates[0]
        for condition, candidate in zip(self.conditions, candidates[1:], strict=True):
            plain = isinstance(candidate, int | float) and isinstance(chosen, int | float)
            same = candidate == chosen if plain else candidate is chosen
            chosen = chosen if same else where(condition, candidate, chosen)
        return chosen


class _Index(NamedTuple):
    """A row of a table (S, ...) of whole numbers, by a choice."""

    table: np.ndarray
    choice: _Choice


_EACH: dict[str, Callable[..., Field]] = {
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
"""What operations do to single numbers."""


def fields(
    program: Program,
    known: Mapping[str, Iterable[Field]],
    wanted: Sequence[str],
    dense: Dense,
    gather: Gather | None = None,
) -> dict[str, list[Field]]:
    """The numbers of rows, from those of others.

    Args:
        program: of the policy.
        known: fields of rows and of parameters, each in one sequence; layers' parameters are not asked for.
        wanted: names of rows; of "view", the side of the spacecraft, one whole number.
        dense: computes layers.
        gather: chooses commands, where that is better done otherwise.
    """
    values: dict[str, Any] = {
        name: _row(row, program.parameters.get(name)) for name, row in known.items()
    }
    for step in program.needed(wanted, known):
        arguments = [
            values[name] if name in values else program.constants.get(name) for name in step.inputs
        ]
        result = _result(step, arguments, dense, gather)
        pieces = result if step.operation == "Split" else [result]
        values |= dict(zip(step.outputs, pieces, strict=True))
    rows = {name: values[name] for name in wanted}
    return {
        name: [value.of(range(len(value.conditions) + 1))]
        if isinstance(value, _Choice)
        else [*value.flat]
        for name, value in rows.items()
    }


def symbols(
    program: Program,
    known: Mapping[str, Iterable[Field]],
    wanted: Sequence[str],
    gather: Gather | None = None,
) -> tuple[dict[str, list[Symbol]], tuple[Stage, ...]]:
    """The same of symbols, and the layers between them; parameters are inputs such as "mean_0"."""
    stages = _Stages(program, wanted, known)
    read = {
        name
        for step in program.needed(wanted, known)
        if step.operation != "Dense"
        for name in step.inputs
    }
    parameters = {
        name: inputs(name, math.prod(shape))
        for name, shape in program.parameters.items()
        if name in read
    }
    result = fields(program, parameters | dict(known), wanted, stages.through, gather)
    return {name: [*map(Symbol.constant, row)] for name, row in result.items()}, tuple(
        stages.found.values()
    )


class _Stages:
    """Writes down layers, joining those of which one is all that reads the other."""

    def __init__(self, program: Program, wanted: Iterable[str], known: Iterable[str]) -> None:
        self.found: dict[str, Stage] = {}
        """By the name of their outputs."""
        steps = program.needed(wanted, known)
        self._uses = Counter([*wanted, *(name for step in steps for name in step.inputs)])

    def through(self, step: Step, row: Sequence[Field]) -> Sequence[Field]:
        """See `Dense`."""
        given, weight, bias = step.inputs
        (name,) = step.outputs
        units = int(step.attributes["units"])
        layer = Layer(weight, bias, units, str(step.attributes["activation"]))
        before = Stage(tuple(map(Symbol.constant, row)), (), ())
        if given in self.found and self._uses[given] == 1:
            before = self.found.pop(given)
        outputs = tuple(inputs(name, units))
        self.found[name] = Stage(before.inputs, (*before.layers, layer), outputs)
        return outputs


def _row(values: Iterable[Field], shape: tuple[int, ...] | None = None) -> Row:
    """An array whose entries are these fields, whatever they are."""
    entries = list(values)
    row = np.empty(len(entries), object)
    for k, value in enumerate(entries):
        row[k] = value
    return row if shape is None else row.reshape(shape)


def _result(step: Step, arguments: Sequence[Any], dense: Dense, gather: Gather | None) -> Any:
    """The value of a step, or the values of a split."""
    operation = step.operation
    if operation in _EACH:
        return _each(_EACH[operation], [np.asarray(x, object) for x in arguments])
    axis = int(step.attributes.get("axis", -1))
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
            sides = [np.take_along_axis(row, one, axis - 1) for one in table]
            return _each(lambda *candidates: choice.of(candidates), sides)
    raise Untraceable(f"the operation {operation!r} of a policy has no meaning for single numbers.")


def _each(function: Callable[..., Field], rows: Sequence[Row]) -> Row:
    """A function of the numbers of rows, broadcast against each other."""
    rows = np.broadcast_arrays(*rows)
    result = np.empty(rows[0].shape, object)
    for index in np.ndindex(result.shape):
        result[index] = function(*(_number(row[index]) for row in rows))
    return result


def _number(x: Any) -> Field:
    """A field; an entry of a table as a plain number."""
    return x.item() if isinstance(x, np.generic) else x


def _largest(values: Sequence[Field]) -> _Choice:
    best = values[0]
    conditions = []
    for value in values[1:]:
        nearer = value > best
        best = where(nearer, value, best)
        conditions.append(nearer)
    return _Choice(tuple(conditions))
