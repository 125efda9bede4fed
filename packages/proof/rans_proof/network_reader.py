"""The checker's own reader of ONNX files: one chain of operations, each with an allow list of its attributes.

Layers are in balls, with what a machine of the file's precision makes of them, and are compared with
`onnx.reference`.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
import onnx
from flint import arb, arb_mat
from onnx import numpy_helper
from onnx.reference import ReferenceEvaluator

from rans_proof.balls import Layer, Refused, column, diagonal, matrix, need, sizes

_UNITS = 1024
"""Largest number of numbers between two operations."""
_NODES = 100
"""Largest number of operations."""
_SAMPLES = 1000
"""States on which layers are compared with onnx.reference; it takes half a second."""
_DEVIATIONS = 4
"""Largest difference, in standard deviations of the rounding, which are estimated from above."""
_BEND_UNITS = 8
"""Units of rounding that activations err by at most."""
_TINY = 1e-30
"""Added to a sum's size, since products below the least normal number of single precision may become 0."""


_ATTRIBUTES: dict[str, dict[str, Callable[[Any], bool]]] = {
    "Gemm": {
        "alpha": lambda x: type(x) is float,
        "beta": lambda x: type(x) is float,
        "transA": lambda x: x == 0,
        "transB": lambda x: x in (0, 1),
    },
    "Conv": {
        "auto_pad": lambda x: x in (b"NOTSET", b"VALID"),
        "group": lambda x: x == 1,
        "kernel_shape": lambda x: True,  # it is that of the weight, or the file is not valid
        **{name: lambda x: set(x) == {1} for name in ("dilations", "strides")},
        "pads": lambda x: set(x) == {0},
    },
    "Flatten": {"axis": lambda x: x == 1},
    "Reshape": {"allowzero": lambda x: x == 0},
}
_PRECISIONS = {onnx.TensorProto.FLOAT: np.float32, onnx.TensorProto.DOUBLE: np.float64}


class _Linear(NamedTuple):
    """Linear operations that follow one another, as one: table x + shift, and what bounds a machine's sums."""

    table: Any
    shift: Any
    of_table: Any
    """Sums of absolute products of the terms of the table."""
    of_shift: Any
    count: int
    """Roundings of a term at most."""
    factor: Any
    """With the constant, a bound of all partial sums by the largest number that is taken."""
    constant: Any


@functools.lru_cache(maxsize=2)
def layers_of(content: bytes, low: tuple[float, ...], high: tuple[float, ...]) -> list[Any]:
    """Layers of a network: weight, bias and activation, in balls.

    The last ones are remembered, because cells are checked a few at a time.

    Args:
        content: content of the ONNX file.
        low: lowest starts, around which the layers are compared with onnx.reference.
        high: highest starts.

    Raises:
        Refused: the file is not a chain of operations that this reader knows, or onnx.reference answers otherwise.
    """
    try:
        model = onnx.load_model_from_string(content)
    except Exception as error:  # of junk anything
        raise Refused("its network is no ONNX file.") from error
    try:
        layers, name, shape, precision = _chain(model)
        # Types and shapes that ONNX itself infers; what does not fit opens in no runtime.
        onnx.shape_inference.infer_shapes(model, check_type=True, strict_mode=True)
    except onnx.shape_inference.InferenceError as error:
        raise Refused("its network's types or shapes do not fit, by ONNX's own rules.") from error
    except (ValueError, TypeError, IndexError, OverflowError, RuntimeError) as error:
        raise Refused(f"its network is damaged, or its shapes do not fit: {error}.") from error
    numbers = [x for layer in layers for m in layer[:2] for x in m.entries()]
    need(all(x.is_finite() for x in numbers), "its network has a weight that is not finite.")
    width = layers[0][0].ncols()
    need(
        len(low) == width,
        f"its network takes {width} numbers, and its problem has {len(low)} states.",
    )
    _compare(model, name, shape, precision, layers, low, high)
    return layers


def _chain(model: Any) -> tuple[list[Any], str, tuple[int, ...], Any]:
    """Layers of a network, and the name, the shape and the precision of its input.

    Linear operations are joined until an activation ends the layer; what the machine's rounding adds is joined with
    them.
    """
    graph = model.graph
    versions = {entry.domain: entry.version for entry in model.opset_import}
    is_known = len(versions) == len(model.opset_import) and 7 <= versions.get("", 0) <= 26
    need(is_known, "its network's version of ONNX's operations is not one from 7 to 26.")
    is_plain = not model.functions and not graph.sparse_initializer
    need(is_plain, "its network has functions of its own or sparse weights.")
    need(1 <= len(graph.node) <= _NODES, f"its network has not 1 to {_NODES} operations.")
    # Weights, which lie in this file, since its SHA-256 covers no other.
    constants: dict[str, np.ndarray] = {}
    for tensor in graph.initializer:
        is_here = tensor.data_location == tensor.DEFAULT and not tensor.external_data
        need(is_here, f"its network's weight {tensor.name!r} is in another file.")
        need(tensor.name not in ("", *constants), "its network has two weights of one name.")
        constants[tensor.name] = numpy_helper.to_array(tensor)
    # One input and one output; the first axis of the input is that of a batch.
    free = [entry for entry in graph.input if entry.name not in constants]
    need(len(free) == len(graph.output) == 1, "its network has not one input and one output.")
    kind = free[0].type.tensor_type
    axes = [axis.dim_value for axis in kind.shape.dim]
    is_state = len(axes) >= 2 and axes[0] <= 1 and min(axes) >= 0 and min(axes[1:]) >= 1
    need(is_state and kind.elem_type in _PRECISIONS, f"its network takes the shape {axes}.")
    precision = _PRECISIONS[kind.elem_type]
    first = shape = (1, *axes[1:])
    data = free[0].name
    names = {"", data, *constants}
    # Linear operations that follow one another are one layer, which ends with an activation.
    layers: list[Any] = []
    linear: _Linear | None = None
    for node in graph.node:
        operands = list(node.input)
        while operands and not operands[-1]:  # the last ones may be left out
            operands.pop()
        is_next = operands.count(data) == 1 and not node.domain and len(node.output) == 1
        is_next &= all(name == data or name in constants for name in operands)
        need(is_next, f"its network is no chain of ONNX's operations at {node.op_type!r}.")
        attributes = {item.name: onnx.helper.get_attribute_value(item) for item in node.attribute}
        allowed = _ATTRIBUTES.get(node.op_type, {})
        is_read = len(attributes) == len(node.attribute) and attributes.keys() <= allowed.keys()
        is_read &= not any(item.ref_attr_name for item in node.attribute)
        is_read = is_read and all(allowed[key](value) for key, value in attributes.items())
        need(is_read, f"its network's {node.op_type!r} has an attribute that is not read.")
        weights = [constants[name] for name in operands if name != data]
        if node.op_type in ("Tanh", "Sigmoid", "Relu") and not weights:
            if linear is None:
                raise Refused(
                    f"its network has the activation {node.op_type!r} without weights before it."
                )
            layers.append(_rounded(linear, node.op_type, precision))
            linear = None
        else:
            is_same = node.op_type == "Reshape" or all(w.dtype == precision for w in weights)
            need(is_same, "its network has a weight in another precision.")
            position = operands.index(data)
            size = math.prod(shape)
            shape, table, shift = _after(node.op_type, shape, position, weights, attributes)
            if table is not None:
                same = diagonal([arb(1)] * size), arb_mat(size, 1)
                before = linear or _Linear(*same, *same, 1, 1, 0)
                rows = sizes(table)
                tiny = column([arb(_TINY)] * table.nrows())
                # The largest product of the operation's numbers, in any order.
                scale = _scale(node.op_type, weights, attributes)
                linear = _Linear(
                    table * before.table,
                    table * before.shift + shift,
                    rows * before.of_table,
                    rows * before.of_shift + sizes(shift) + tiny,
                    before.count + size + 3,
                    size * scale * before.factor,
                    size * scale * before.constant + scale,
                )
            need(
                math.prod(shape) <= _UNITS, f"its network has {math.prod(shape)} numbers in a row."
            )
        need(node.output[0] not in names, "its network has two tensors of one name.")
        data = node.output[0]
        names.add(data)
    need(graph.output[0].name == data, "its network's output is not that of its last operation.")
    if linear:
        layers.append(_rounded(linear, "", precision))
    need(layers, "its network has no layer.")
    return layers, free[0].name, first, precision


def _after(
    kind: str,
    shape: tuple[int, ...],
    position: int,
    weights: list[np.ndarray],
    attributes: dict[str, Any],
) -> tuple[tuple[int, ...], Any, Any]:
    """Shape after a linear operation, and its matrix and shift, or None twice where numbers stay as they are.

    Args:
        kind: name of the operation.
        shape: of what it takes.
        position: of what it takes among its operands.
        weights: its other operands.
        attributes: each with an allowed value.
    """
    size = math.prod(shape)
    match kind, weights:
        case "MatMul", [w] if position == 0 and w.ndim == 2 and math.prod(shape[:-1]) == 1:
            table = matrix(w.T)
            shift = arb_mat(w.shape[1], 1)
            shape = (*shape[:-1], w.shape[1])
        case "Gemm", [w, *bias] if position == 0 and w.ndim == 2 == len(shape) and len(bias) < 2:
            w = w if attributes.get("transB") else w.T
            bias = np.broadcast_to(bias[0] if bias else 0.0, (1, len(w)))
            table = matrix(w) * arb(attributes.get("alpha", 1.0))
            shift = matrix(bias.T) * arb(attributes.get("beta", 1.0))
            shape = (1, len(w))
        case "Conv", [w, *bias] if position == 0 and len(shape) > 2 and len(bias) < 2:
            # A convolution whose kernel covers all it takes, so that each output is a sum over the whole input.
            need(w.shape[1:] == shape[1:], "its network has a convolution of parts of its input.")
            need(
                not bias or bias[0].shape == w.shape[:1], "its network has a bias of another size."
            )
            table = matrix(w.reshape(len(w), -1))
            shift = matrix((bias[0] if bias else np.zeros(len(w))).reshape(-1, 1))
            shape = (1, len(w), *[1] * (len(shape) - 2))
        case ("Add" | "Sub" | "Mul" | "Div", [c]) if kind != "Div" or position == 0:
            values = [arb(float(x)) for x in np.broadcast_to(c, shape).ravel()]
            zeros = [arb(0)] * size
            ones = [arb(1)] * size
            factors, shift = {
                "Add": (ones, values),
                "Sub": ([-x for x in ones], values) if position else (ones, [-x for x in values]),
                "Mul": (values, zeros),
                "Div": ([1 / x for x in values], zeros),
            }[kind]
            table = diagonal(factors)
            shift = column(shift)
        case "Flatten", []:
            return (1, size), None, None
        case "Reshape", [axes] if position == 0 and axes.dtype == np.int64 and axes.ndim == 1:
            target = [shape[k] if axis == 0 else int(axis) for k, axis in enumerate(axes)]
            after = np.zeros(shape, np.int8).reshape(target).shape
            need(len(after) > 1 and after[0] == 1, "its network has a Reshape that parts a state.")
            return after, None, None
        case _:
            raise Refused(f"its network has an operation that is not read: {kind!r}.")
    need(table.ncols() == size, f"its network has a {kind!r} of {table.ncols()} inputs for {size}.")
    return shape, table, shift


def _scale(kind: str, weights: list[np.ndarray], attributes: dict[str, Any]) -> Any:
    """Largest product of one number each of an operation's operands and attributes, which count as 1 at least.

    A runtime may multiply weights with each other before it takes the state, and keeps scales in single precision.
    """
    groups = [*weights, *(attributes.get(name, 1.0) for name in ("alpha", "beta"))]
    product = arb(1)
    for numbers in groups:
        product *= max(1.0, float(np.abs(numbers).max()))
    if kind == "Div":
        product /= min(1.0, float(np.abs(weights[0]).min()))
    need(product < 1.7e38, "its network has weights that are too large for single precision.")
    return product


def _rounded(linear: _Linear, kind: str, precision: Any) -> Layer:
    """A layer, with what a machine of a precision makes of it.

    A sum of products, each of which is rounded n times at most, errs by 1 / (1 - n u) - 1 of the sum of their
    sizes, in any order (Higham, "Accuracy and stability of numerical algorithms", 3.1).
    """
    table, shift, of_table, of_shift, count, factor, constant = linear
    unit = arb(float(np.finfo(precision).eps)) / 2
    part = 1 / (1 - count * unit) - 1
    bends = _BEND_UNITS * unit if kind in ("Tanh", "Sigmoid") else arb(0)
    # Rounding makes no sum twice as large.
    limit = arb(float(np.finfo(precision).max)) / 2
    machine = of_table * part, of_shift * part, bends
    return Layer(table, shift, kind, machine, (factor, constant, limit))


def _compare(
    model: Any,
    name: str,
    shape: tuple[int, ...],
    precision: Any,
    layers: Sequence[Any],
    low: Sequence[float],
    high: Sequence[float],
) -> None:
    """Refuse layers that answer otherwise than onnx.reference on random states around the starts, and far away.

    The allowed difference follows from the rounding of the file's precision, so that a wrong weight stands out.
    """
    random = np.random.default_rng(1)
    wide = np.maximum(np.abs(np.subtract(high, low)), 0.02 * np.abs(np.add(high, low)) + 1e-6)
    close = np.add(low, high) / 2 + wide * random.uniform(-1.5, 1.5, (_SAMPLES // 2, len(low)))
    away = random.normal(size=close.shape) * 10.0 ** random.uniform(-3.0, 4.0, (len(close), 1))
    away = away * (np.maximum(np.abs(low), np.abs(high)) + wide)
    states = np.concatenate([close, away]).astype(precision)
    # Answers of both, and the standard deviations of the rounding, a part of its bounds: errors of n terms add up
    # to some sqrt(n) of one, and those of units to the root of their squares' sum.
    x = states.astype(float).T
    deviations = np.zeros_like(x)
    bends: dict[str, Callable[[Any], Any]] = {
        "Tanh": np.tanh,
        "Sigmoid": lambda z: (1 + np.tanh(z / 2)) / 2,
        "Relu": lambda z: z * (z > 0),
        "": lambda z: z,
    }
    for layer in layers:
        table, shift, factors, constants = (
            np.array([[float(e.mid()) for e in r] for r in m.tolist()])
            for m in (*layer[:2], *layer.machine[:2])
        )
        bend = bends[layer.kind]
        of_bend = float(layer.machine[2]) / 2
        single = (factors @ abs(x) + constants) / math.sqrt(table.shape[1])
        deviations = np.hypot(np.sqrt(table**2 @ deviations**2), single)
        z = table @ x + shift
        x = bend(z)
        # How far a bend passes them on.
        passed = abs(bend(z + deviations) - x) + abs(bend(z - deviations) - x)
        deviations = np.hypot(passed / (1 + (layer.kind != "Relu")), of_bend)
    try:
        evaluator = ReferenceEvaluator(model)
        with np.errstate(all="ignore"):  # its sigmoid overflows on the way to a right answer
            runs: Any = [evaluator.run(None, {name: s.reshape(shape)}) for s in states]
        difference = abs(np.array([np.ravel(y) for (y,) in runs], dtype=float).T - x)
    except Exception as error:  # of the evaluator anything
        raise Refused("its network cannot be evaluated by onnx.reference.") from error
    bound = _DEVIATIONS * deviations
    worst = float(np.nan_to_num(difference, nan=np.inf).max())
    is_fine = (bound.max(axis=1) <= abs(x).max(axis=1) + 1e-6).all()  # a bend errs by less
    need(
        is_fine and (difference <= bound).all(),
        f"its network answers otherwise by {worst:.2g} in onnx.reference than as it was read, or single precision "
        "is too coarse for its weights.",
    )
