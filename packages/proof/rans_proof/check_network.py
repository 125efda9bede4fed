"""The checker's own reader of networks in ONNX: from the output back to the state, in ball arithmetic.

It shares no code with `rans_proof.network`. What it read is compared with onnx.reference, the evaluator that comes
with the definition of ONNX, and not with ONNX Runtime.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
import onnx
from flint import arb, arb_mat
from onnx import numpy_helper
from onnx.reference import ReferenceEvaluator

from rans_proof.balls import Refused, diagonal, matrix, scaled, with_sizes

_UNITS = 1024
"""Largest number of numbers between two operations."""
_NODES = 100
"""Largest number of operations."""
_STATES = 1000
"""States on which layers are compared with onnx.reference; it takes half a second."""
_PART = 1e-4
"""Largest difference, a part of the largest answer to the states around the starts, whatever commands' unit is."""
_BENDS = ("Tanh", "Sigmoid", "Relu")
_VALUES: dict[str, dict[str, tuple[Any, ...]]] = {
    "Conv": {"auto_pad": (b"NOTSET", b"VALID"), "group": (1,)},
    "Flatten": {"axis": (1,)},
    "Gemm": {"transA": (0,)},
    "Reshape": {"allowzero": (0,)},
}
"""Attributes of which only these values are read, and which then mean nothing further."""


class _Graph(NamedTuple):
    """Chain of nodes from the state to the answer."""

    nodes: list[Any]
    """From the first to the last."""
    data: list[str]
    """Name of each node's data."""
    constants: dict[str, np.ndarray]
    """Weights by their names, in the file's precision."""
    state: str
    """Name of the input."""
    shape: tuple[int, ...]
    """Shape of one state."""
    precision: Any
    """Of states and weights."""


@functools.lru_cache(maxsize=2)
def layers_of(content: bytes, low: tuple[float, ...], high: tuple[float, ...]) -> list[Any]:
    """Layers of a network: weight, bias, activation and absolute weight, in balls.

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
    graph = _graph(model)
    try:
        layers = _joined(_operations(graph))
    except (ValueError, TypeError, IndexError, OverflowError) as error:  # shapes that do not fit
        raise Refused(f"its network's shapes do not fit: {error}.") from error
    if not all(
        x.is_finite()
        for weight, bias, _ in layers
        for table in (weight, bias)
        for x in table.entries()
    ):
        raise Refused("its network has a weight that is not finite.")
    _compare(model, graph, layers, low, high)
    return with_sizes(layers)


def _graph(model: Any) -> _Graph:
    """Nodes on the way from the graph's output back to its input, which must be all nodes.

    Raises:
        Refused: it is no such chain, or has what is not read.
    """
    graph = model.graph
    versions = {entry.domain: entry.version for entry in model.opset_import}
    if len(versions) != len(model.opset_import) or not 7 <= versions.get("", 0) <= 28:
        raise Refused("its network's version of ONNX's operations is not one from 7 to 28.")
    if not 1 <= len(graph.node) <= _NODES:
        raise Refused(f"its network has {len(graph.node)} operations; checked are 1 to {_NODES}.")
    if len(model.functions) or len(graph.sparse_initializer):
        raise Refused("its network has functions of its own or sparse weights.")
    # Weights, which lie in this file, since its SHA-256 covers no other.
    constants: dict[str, np.ndarray] = {}
    for tensor in graph.initializer:
        if tensor.data_location != onnx.TensorProto.DEFAULT or len(tensor.external_data):
            raise Refused(f"its network's weight {tensor.name!r} is in another file.")
        if not tensor.name or tensor.name in constants:
            raise Refused(f"its network has two weights of the name {tensor.name!r}.")
        try:
            constants[tensor.name] = numpy_helper.to_array(tensor)
        except Exception as error:
            raise Refused(f"its network's weight {tensor.name!r} is damaged.") from error
    # One input and one output; the first axis of the input is that of a batch.
    free = [entry for entry in graph.input if entry.name not in constants]
    if len(free) != 1 or len(graph.output) != 1:
        raise Refused("its network has not one input and one output.")
    tensor_type = free[0].type.tensor_type
    precision = {onnx.TensorProto.FLOAT: np.float32, onnx.TensorProto.DOUBLE: np.float64}.get(
        tensor_type.elem_type
    )
    axes = [axis.dim_value for axis in tensor_type.shape.dim]
    if precision is None or len(axes) < 2 or axes[0] > 1 or min(axes[1:]) < 1:
        raise Refused(f"its network takes the shape {axes}, or no floating point numbers.")
    # From the output back to the state.
    makers: dict[str, Any] = {}
    for node in graph.node:
        for name in node.output:
            if not name or name in makers or name in constants or name == free[0].name:
                raise Refused(f"its network has two tensors of the name {name!r}.")
            makers[name] = node
    nodes: list[Any] = []
    data: list[str] = []
    name = graph.output[0].name
    while name != free[0].name:
        node = makers.get(name)
        if node is None or len(nodes) > len(graph.node):
            raise Refused(f"its network's tensor {name!r} comes from no node.")
        sources = [source for source in node.input if source and source not in constants]
        if len(sources) != 1 or len(node.output) != 1 or node.domain:
            raise Refused(f"its network is no chain of ONNX's operations at {node.op_type!r}.")
        name = sources[0]
        nodes.append(node)
        data.append(name)
    if len(nodes) != len(graph.node) or nodes[::-1] != list(graph.node):
        raise Refused("its network has a node that its answer does not come from.")
    return _Graph(nodes[::-1], data[::-1], constants, free[0].name, (1, *axes[1:]), precision)


def _operations(graph: _Graph) -> list[tuple[Any, Any] | str]:
    """Matrix and shift of every linear operation, and names of activations.

    A list in place of a matrix has the factors of a diagonal one.
    """
    shape = graph.shape
    operations: list[tuple[Any, Any] | str] = []
    for node, data in zip(graph.nodes, graph.data, strict=True):
        kind = node.op_type
        operands = [name for name in node.input if name]
        if list(node.input)[: len(operands)] != operands:
            raise Refused(f"its network leaves out an operand of {kind!r}.")
        position = operands.index(data)
        constants = [graph.constants[name] for name in operands if name != data]
        if kind != "Reshape" and any(c.dtype != graph.precision for c in constants):
            raise Refused(f"its network has a weight of {kind!r} in another precision.")
        rule = _RULES.get(kind)
        if rule is None and kind not in _BENDS:
            raise Refused(f"its network has an operation that is not checked: {kind!r}.")
        attributes = _attributes(node)
        if rule is None:
            if constants or attributes:
                raise Refused(f"its network's {kind!r} has more than its argument.")
            operations.append(kind)
            continue
        shape, step = rule(shape, position, constants, attributes)
        if not 1 <= int(np.prod(shape)) <= _UNITS:
            raise Refused(f"its network has {int(np.prod(shape))} numbers after {kind!r}.")
        if step is not None:
            operations.append(step)
    return operations


def _attributes(node: Any) -> dict[str, Any]:
    """Attributes of a node that a rule has to read, by their names."""
    attributes = {item.name: onnx.helper.get_attribute_value(item) for item in node.attribute}
    if len(attributes) != len(node.attribute) or any(item.ref_attr_name for item in node.attribute):
        raise Refused(f"its network's {node.op_type!r} has an attribute twice.")
    for name, values in _VALUES.get(node.op_type, {}).items():
        if name in attributes and attributes.pop(name) not in values:
            raise Refused(f"its network's {node.op_type!r} has another {name} than {values}.")
    return attributes


def _no_more(
    kind: str, constants: Sequence[Any], counts: tuple[int, ...], attributes: dict[str, Any]
) -> None:
    """Refuse other numbers of weights, and attributes that a rule has not read."""
    if len(constants) not in counts or attributes:
        raise Refused(
            f"its network's {kind} has other operands or attributes: {sorted(attributes)}."
        )


_Step = tuple[tuple[int, ...], tuple[Any, Any] | None]
"""Shape after an operation, and its matrix and shift, if it has any."""


def _product(
    shape: tuple[int, ...], position: int, constants: list[np.ndarray], attributes: dict[str, Any]
) -> _Step:
    """Product x W."""
    _no_more("MatMul", constants, (1,), attributes)
    if position != 0 or constants[0].ndim != 2 or any(n != 1 for n in shape[:-1]):
        raise Refused("its network has a MatMul that is no row times a matrix.")
    after = (np.zeros(shape, np.float32) @ constants[0]).shape
    table = constants[0].astype(float)
    return after, (matrix(table).transpose(), arb_mat(table.shape[1], 1))


def _general_product(
    shape: tuple[int, ...], position: int, constants: list[np.ndarray], attributes: dict[str, Any]
) -> _Step:
    """Sum alpha x B + beta C."""
    is_transposed = attributes.pop("transB", 0)
    alpha, beta = (attributes.pop(name, 1.0) for name in ("alpha", "beta"))
    _no_more("Gemm", constants, (1, 2), attributes)
    if (
        position != 0
        or len(shape) != 2
        or constants[0].ndim != 2
        or not all(type(x) is float for x in (alpha, beta))
        or type(is_transposed) is not int
        or is_transposed not in (0, 1)
    ):
        raise Refused("its network has a Gemm that is no row times a matrix.")
    table = constants[0].astype(float)
    if not is_transposed:
        table = table.T
    if table.shape[1] != shape[1]:
        raise Refused(f"its network has a Gemm of {table.shape[1]} inputs for {shape[1]}.")
    shift = arb_mat(len(table), 1)
    if len(constants) == 2:
        shift = matrix(
            np.broadcast_to(constants[1].astype(float), (1, len(table))).reshape(-1, 1)
        ) * arb(beta)
    return (1, len(table)), (matrix(table) * arb(alpha), shift)


def _convolution(
    shape: tuple[int, ...], position: int, constants: list[np.ndarray], attributes: dict[str, Any]
) -> _Step:
    """A convolution that covers all it takes at once: each output is a sum over the whole input."""
    if position != 0 or not constants or constants[0].shape[1:] != shape[1:] or len(shape) < 3:
        raise Refused(
            "its network has a convolution whose kernel is not as large as what it takes."
        )
    extent = list(shape[2:])
    plain = {
        "dilations": [1] * len(extent),
        "kernel_shape": extent,
        "pads": [0] * (2 * len(extent)),
        "strides": [1] * len(extent),
    }
    for name, value in plain.items():
        if list(attributes.pop(name, value)) != value:
            raise Refused(f"its network has a convolution with {name} that are not {value}.")
    _no_more("Conv", constants, (1, 2), attributes)
    count = constants[0].shape[0]
    bias = constants[1] if len(constants) == 2 else np.zeros(count)
    if bias.shape != (count,):
        raise Refused(f"its network has a convolution whose bias has the shape {bias.shape}.")
    table = matrix(constants[0].astype(float).reshape(count, -1))
    return (1, count, *(1 for _ in extent)), (table, matrix(bias.astype(float).reshape(-1, 1)))


def _elementwise(kind: str) -> Callable[..., _Step]:
    """Rule of an operation on each number, with a weight that broadcasts to them."""

    def rule(
        shape: tuple[int, ...],
        position: int,
        constants: list[np.ndarray],
        attributes: dict[str, Any],
    ) -> _Step:
        _no_more(kind, constants, (1,), attributes)
        values = [arb(float(x)) for x in np.broadcast_to(constants[0], shape).ravel()]
        zeros = arb_mat(len(values), 1)
        column = arb_mat(len(values), 1, values)
        same = [arb(1)] * len(values)
        if kind == "Add":
            return shape, (same, column)
        if kind == "Sub":  # x - c, or c - x
            return shape, ((same, -column) if position == 0 else ([-x for x in same], column))
        if kind == "Mul":
            return shape, (values, zeros)
        if position != 0:
            raise Refused("its network divides by what depends on the state.")
        return shape, ([1 / x for x in values], zeros)

    return rule


def _flattened(
    shape: tuple[int, ...], position: int, constants: list[np.ndarray], attributes: dict[str, Any]
) -> _Step:
    _no_more("Flatten", constants, (0,), attributes)
    return (1, int(np.prod(shape))), None


def _reshaped(
    shape: tuple[int, ...], position: int, constants: list[np.ndarray], attributes: dict[str, Any]
) -> _Step:
    _no_more("Reshape", constants, (1,), attributes)
    axes = constants[0]
    if position != 0 or axes.dtype != np.int64 or axes.ndim != 1 or not 2 <= len(axes) <= 8:
        raise Refused("its network has a Reshape to a shape that is no list of whole numbers.")
    target = [shape[k] if axes[k] == 0 else int(axes[k]) for k in range(len(axes))]
    after = np.zeros(shape, np.int8).reshape(target).shape
    if after[0] != 1:
        raise Refused(f"its network has a Reshape to {after}, which parts one state.")
    return after, None


_RULES: dict[str, Callable[..., _Step]] = {
    "MatMul": _product,
    "Gemm": _general_product,
    "Conv": _convolution,
    "Flatten": _flattened,
    "Reshape": _reshaped,
    **{kind: _elementwise(kind) for kind in ("Add", "Sub", "Mul", "Div")},
}
"""Rule of each operation: of a shape, the position of the data, the weights and attributes it makes the step."""


def _joined(operations: Sequence[tuple[Any, Any] | str]) -> list[tuple[Any, Any, str]]:
    """Layers of operations: linear ones that follow one another are one."""
    layers: list[tuple[Any, Any, str]] = []

    def times(factor: Any, table: Any) -> Any:
        """A matrix, or a list of the factors of rows, times a matrix."""
        return scaled(factor, table) if isinstance(factor, list) else factor * table

    for operation in operations:
        is_open = bool(layers) and not layers[-1][2]
        if isinstance(operation, str):
            if not is_open:
                raise Refused(
                    f"its network has the activation {operation!r} without weights right before it."
                )
            layers[-1] = (*layers[-1][:2], operation)
        elif is_open:
            weight, bias, _ = layers.pop()
            factor, shift = operation
            layers.append((times(factor, weight), times(factor, bias) + shift, ""))
        else:
            factor, shift = operation
            layers.append((diagonal(factor) if isinstance(factor, list) else factor, shift, ""))
    if not layers:
        raise Refused("its network has no layer.")
    return layers


def _compare(
    model: Any, graph: _Graph, layers: Sequence[Any], low: Sequence[float], high: Sequence[float]
) -> None:
    """Compare layers with onnx.reference on random states around the starts, and far from them.

    Raises:
        Refused: an answer differs.
    """
    width = layers[0][0].ncols()
    if len(low) != width:
        raise Refused(f"its network takes {width} numbers, and its problem has {len(low)} states.")
    random = np.random.default_rng(1)
    wide = np.maximum(np.abs(np.subtract(high, low)), 0.02 * np.abs(np.add(high, low)) + 1e-6)
    close = np.add(low, high) / 2 + wide * random.uniform(-1.5, 1.5, (_STATES // 2, width))
    away = random.normal(size=close.shape) * 10.0 ** random.uniform(-3.0, 4.0, (len(close), 1))
    away = away * (np.maximum(np.abs(low), np.abs(high)) + wide)
    states = np.concatenate([close, away]).astype(graph.precision)
    # Answers of both; also how large the numbers are that each answer is a sum of, for its rounding.
    x = states.astype(float).T
    unit = float(np.finfo(np.float32).eps)
    rounding = np.zeros_like(x)
    for weight, bias, kind in layers:
        table, shift = (
            np.array([[float(e.mid()) for e in row] for row in m.tolist()]) for m in (weight, bias)
        )
        rounding = abs(table) @ rounding + unit * (abs(table) @ abs(x) + abs(shift))
        x = table @ x + shift
        if kind:
            x = {
                "Tanh": np.tanh,
                "Sigmoid": lambda z: (1 + np.tanh(z / 2)) / 2,
                "Relu": lambda z: z * (z > 0),
            }[kind](x)
        rounding = rounding + unit * abs(x)
    try:
        evaluator = ReferenceEvaluator(model)
        with np.errstate(all="ignore"):  # its sigmoid overflows on the way to a right answer
            runs: Any = [evaluator.run(None, {graph.state: s.reshape(graph.shape)}) for s in states]
        difference = abs(np.array([np.ravel(y) for (y,) in runs], dtype=float).T - x)
    except Exception as error:  # of the evaluator anything
        raise Refused("its network cannot be evaluated by onnx.reference.") from error
    count = len(close)
    bound = np.repeat(_PART * abs(x[:, :count]).max(axis=1, keepdims=True), len(states), axis=1)
    bound[:, count:] += _PART * abs(x[:, count:]) + 8 * rounding[:, count:]
    if not (difference <= bound).all():
        worst = float(np.nan_to_num(difference, nan=np.inf).max())
        raise Refused(
            f"its network answers otherwise by {worst:.2g} in onnx.reference than as it was read, or single "
            "precision is too coarse for its weights."
        )
