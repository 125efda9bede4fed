"""Dense networks: layers of a weight, a bias and an activation, as read from an ONNX file.

A graph is read that is one chain of known operations whose every attribute is known; all else is refused. What
each linear operation does is asked of ONNX's own evaluator, on unit vectors. Layers that were read are compared
with ONNX Runtime on random states before they are returned.
`rans_proof.network_reader` reads the same files without this code, and each refuses by itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch

from rans.extend import ConfigError, brief, first_line, read_bytes, require
from rans_proof.relaxation import Layer, Rounding, Zonotope, enclose, layer_tensors

LARGEST = 2**26
"""Bytes of an ONNX file that is read; networks in control have less than a thousandth of it."""
_WIDEST = 1024
"""Largest width of a layer; networks in control have some hundred units."""
_LONGEST = 100
"""Largest number of nodes, so that a file of few bytes does not take hours."""
_OPSETS = range(7, 27)
"""Versions of ONNX's operations in which those of `_ATTRIBUTES` mean the same. Before 7 they broadcast otherwise;
26 is the newest that ONNX Runtime 1.31 opens."""

ACTIVATIONS = {"Tanh": "tanh", "Sigmoid": "sigmoid", "Relu": "relu"}
"""Operations of ONNX that bend, and their names here."""

_ATTRIBUTES: dict[str, dict[str, set[Any]]] = {
    "MatMul": {},
    "Gemm": {"alpha": set(), "beta": set(), "transA": {0}, "transB": {0, 1}},
    "Conv": {
        "auto_pad": {b"NOTSET", b"VALID"},
        "dilations": {1},
        "group": {1},
        "kernel_shape": set(),
        "pads": {0},
        "strides": {1},
    },
    "Add": {},
    "Sub": {},
    "Mul": {},
    "Div": {},
    "Flatten": {"axis": {1}},
    "Reshape": {"allowzero": {0}},
    **{name: {} for name in ACTIVATIONS},
}
"""Operations that are read, and values that their attributes, or entries of these, may have; none: any."""
_ENTRYWISE = ("Add", "Sub", "Mul", "Div")
"""Operations in which each number has one term."""
_RESHAPING = ("Flatten", "Reshape")
"""Operations that leave all numbers as they are."""

_PROBES = 1000
"""States on which layers are compared with ONNX Runtime, half of them around the starts; it takes some 20 ms."""
_TINY = 1e-30
"""Added to the sizes of terms, so that products below the least normal number of single precision, which may become
0, count, too: a thousand of them are below 1e-35."""


def read_network(file: Path) -> list[Layer]:
    """Layers of the network in an ONNX file; arguments and errors as for `network_of`."""
    return network_of(read_bytes(file, LARGEST), file)


def network_of(
    content: bytes, where: object, around: tuple[Sequence[float], Sequence[float]] | None = None
) -> list[Layer]:
    """Layers of a network in ONNX, in double precision, as it answers one state.

    Known are chains of MatMul, Gemm, Add, Sub, Mul, Div, convolutions over the whole input (Conv), Flatten,
    Reshape, Tanh, Sigmoid and Relu. Linear operations that follow one another are joined into one layer. A weight
    that is also an input of the graph has its default.

    Args:
        content: content of the file.
        where: name of the file in messages.
        around: lowest and highest starts, around which half of the states lie on which the layers are compared with
            ONNX Runtime; None: -1 and 1.

    Raises:
        ConfigError: the file has another operation, attribute or form, more than one chain, or ONNX Runtime answers
            otherwise than the layers.
        MissingPackage: the package onnx or onnxruntime is not installed.
    """
    onnx = require("onnx")
    try:
        model = onnx.load_model_from_string(content)
    except Exception as error:  # a damaged file may raise anything
        raise ConfigError(f"{where} is no ONNX network: {first_line(error)}.") from error
    try:
        with np.errstate(all="ignore"):  # products of huge weights, which are refused
            layers, taken = _read(onnx, model)
    except _Unread as reason:
        raise ConfigError(f"{where} {reason}.") from None
    _compare(content, where, layers, taken, around)
    return layers


class _Unread(Exception):
    """A network that is not read; the message continues a sentence that begins with the name of its file."""


def _need(condition: object, reason: str) -> None:
    """Refuse (`_Unread`) a network that does not meet a condition."""
    if not condition:
        raise _Unread(reason)


class _Input(NamedTuple):
    """What a graph takes."""

    name: str
    shape: tuple[int, ...]
    """Shape of the input for one state: the first axis, that of a batch, is 1."""
    precision: np.dtype[Any]
    """Floating-point type of the state, and so of every weight."""


def _read(onnx: Any, model: Any) -> tuple[list[Layer], _Input]:
    """Layers of a model whose graph is one chain, and what it takes; `_Unread` for others.

    Functions, sparse weights and other operator sets change what a graph means. `rans_proof.network_reader` refuses
    the same by its own lines; neither may rely on the other.
    """
    graph = model.graph
    versions = [entry.version for entry in model.opset_import if entry.domain == ""]
    _need(
        len(versions) == 1 and versions[0] in _OPSETS,
        f"must import ONNX's operations once, in a version from {_OPSETS.start} to {_OPSETS.stop - 1}, and has "
        f"{brief(versions)}",
    )
    count = len(graph.node)
    _need(count <= _LONGEST, f"has {count:,} nodes, and at most {_LONGEST} are read")
    _need(not model.functions, "defines operations of its own (functions), which are not read")
    _need(not graph.sparse_initializer, "has a sparse weight, which is not read")
    tables = _tables(onnx, graph)
    try:  # types, shapes, names and attributes by ONNX's own rules
        onnx.checker.check_model(
            onnx.shape_inference.infer_shapes(model, check_type=True, strict_mode=True)
        )
    except Exception as error:  # of damaged graphs anything
        raise _Unread(f"is against ONNX's rules: {first_line(error)}") from error
    taken = _input(graph, tables)
    # One operation after another, joined where they are linear.
    layers: list[Layer] = []
    opened = None
    current, shape = taken[:2]
    for number, node in enumerate(graph.node):
        fresh = opened or _identity(shape, taken.precision)
        try:
            others = _others(onnx, node, current, tables, taken.precision)
            if node.op_type in ACTIVATIONS:
                _need(opened, "is an activation without weights right before it")
                layers.append(fresh._replace(activation=ACTIVATIONS[node.op_type]))
                opened = None
            else:
                joined, shape = _then(onnx, fresh, node, shape, current, others)
                opened = opened if node.op_type in _RESHAPING else joined
        except _Unread as reason:
            title = " ".join(brief(name) for name in (node.op_type, node.name) if name)
            raise _Unread(f"is not read at node {number} ({title}): it {reason}") from None
        current = node.output[0]
    outputs = [tensor.name for tensor in graph.output]
    _need(
        outputs == [current],
        f"must have one output, that of its last node, and has {brief(outputs)}",
    )
    layers += [opened] if opened else []
    _need(layers, "has no layer")
    for layer in layers:
        is_finite = np.isfinite(layer.weight).all() and np.isfinite(layer.bias).all()
        _need(is_finite, "has a weight that is not finite")
        assert layer.rounding is not None
        _need(
            sum(layer.rounding.growth) < layer.rounding.largest,
            "has weights whose products and sums may be too large for the precision of the file, and "
            "gives no number then",
        )
    return layers, taken


def _tables(onnx: Any, graph: Any) -> dict[str, np.ndarray]:
    """Weights (arrays) by name in the file's precision; external, repeated or infinite ones are refused."""
    tables: dict[str, np.ndarray] = {}
    for tensor in graph.initializer:
        name = brief(tensor.name)
        _need(tensor.name not in tables, f"has two weights of the name {name}")
        _need(
            not (tensor.data_location or tensor.external_data),
            f"keeps the weight {name} in another file, which no hash would cover: save the network as one file",
        )
        try:
            table = onnx.numpy_helper.to_array(tensor)
        except Exception as error:  # of damaged data anything
            raise _Unread(
                f"has a weight {name} that cannot be read: {first_line(error)}"
            ) from error
        is_finite = table.dtype.kind != "f" or np.isfinite(table).all()
        _need(is_finite, f"has a weight {name} that is not finite")
        tables[tensor.name] = table
    return tables


def _input(graph: Any, tables: dict[str, np.ndarray]) -> _Input:
    """The graph's one input that is no weight."""
    inputs = [tensor for tensor in graph.input if tensor.name not in tables]
    _need(len(inputs) == 1, f"has {len(inputs)} inputs; a proof is about a network of one")
    kind = inputs[0].type.tensor_type
    precisions = {1: np.dtype(np.float32), 11: np.dtype(np.float64)}  # of TensorProto.DataType
    _need(kind.elem_type in precisions, "takes no numbers of single or double precision")
    # A first axis of any length is that of a batch.
    shape = [axis.dim_value if axis.HasField("dim_value") else 0 for axis in kind.shape.dim]
    _need(
        len(shape) >= 2 and shape[0] in (0, 1) and all(0 < n <= _WIDEST for n in shape[1:]),
        f"takes the shape {shape}, and must take (N, states), whose first axis is that of a batch (0 "
        "stands for any length)",
    )
    return _Input(inputs[0].name, (1, *shape[1:]), precisions[kind.elem_type])


def _others(
    onnx: Any, node: Any, current: str, tables: dict[str, np.ndarray], precision: np.dtype[Any]
) -> list[np.ndarray]:
    """Operands of a node beside what comes before it; `_Unread` if it is no operation that is read."""
    known = _ATTRIBUTES.get(node.op_type)
    is_known = known is not None and not node.domain
    _need(is_known, f"is of the domain {brief(node.domain)}; known are {', '.join(_ATTRIBUTES)}")
    for item in node.attribute:
        value = onnx.helper.get_attribute_value(item)
        allowed = (known or {}).get(item.name)
        entries = set(value if item.type == onnx.AttributeProto.INTS else [value])
        is_read = allowed is not None and not item.ref_attr_name and entries <= (allowed or entries)
        _need(is_read, f"has the {brief(item.name)} {brief(value)}, which is not read")
    inputs = [name for name in node.input if name]
    is_next = inputs.count(current) == 1
    _need(is_next, "must take the answer of the node before it, once")
    is_first = inputs[0] == current or node.op_type in _ENTRYWISE[:-1]
    _need(is_first, "takes the answer of the node before it as another operand than the first")
    others = [name for name in inputs if name != current]
    are_weights = all(name in tables for name in others)
    _need(are_weights, "has an operand that is neither a weight of the file nor what is before it")
    weights = [tables[name] for name in others]
    is_same = node.op_type == "Reshape" or all(x.dtype == precision for x in weights)
    _need(is_same, "has a weight of another precision than the network's input")
    return weights


def _identity(shape: tuple[int, ...], precision: np.dtype[Any]) -> Layer:
    """The layer that gives what it takes, with no operation so far but the rounding of what it takes."""
    size = int(np.prod(shape))
    unit = float(np.finfo(precision).eps) / 2.0
    # Half of the largest number, which leaves more than rounding adds.
    largest = float(np.finfo(precision).max) / 2.0
    same = np.eye(size), np.zeros(size)
    return Layer(*same, "", Rounding(*same, 1, unit, (1.0, 0.0), largest))


def _then(
    onnx: Any,
    layer: Layer,
    node: Any,
    shape: tuple[int, ...],
    current: str,
    others: Sequence[np.ndarray],
) -> tuple[Layer, tuple[int, ...]]:
    """A layer and a linear operation after it as one, and the shape of what that gives.

    ONNX's evaluator gives the operation's matrix column by column, from unit vectors and with what is added left
    out, and its shift from zeros, in double precision.
    """
    from onnx.reference import ReferenceEvaluator

    kind = node.op_type
    names = [name for name in node.input if name and name != current]
    weights = [x if x.dtype.kind == "i" else x.astype(np.float64) for x in others]
    added = [kind in ("Add", "Sub") or (kind in ("Gemm", "Conv") and k) for k in range(len(names))]
    linear = [0.0 * x if is_added else x for x, is_added in zip(weights, added, strict=True)]
    size = int(np.prod(shape))
    try:
        run: Any = ReferenceEvaluator(node).run
        columns = [
            run(None, dict(zip(names, linear, strict=True)) | {current: x.reshape(shape)})[0]
            for x in np.eye(size)
        ]
        zeros = {current: np.zeros(shape)}
        after = run(None, dict(zip(names, weights, strict=True)) | zeros)[0]
    except Exception as error:  # of the evaluator anything
        raise _Unread(f"cannot be evaluated by onnx.reference: {first_line(error)}") from error
    table = np.stack([x.ravel() for x in columns], axis=1)
    shift = after.ravel()
    if kind == "Conv":
        is_whole = after.size == after.shape[1] and all(len(x) == after.size for x in weights)
        _need(is_whole, f"has a kernel that is not as large as the shape {shape}, or another bias")
    elif kind not in _RESHAPING:
        is_fitting = after.ndim == len(shape) and (kind not in _ENTRYWISE or after.size == size)
        _need(is_fitting, f"makes the shape {after.shape} of {shape}")
    is_state = after.ndim > 1 and len(after) == 1 and 0 < after.size <= _WIDEST
    _need(is_state, f"gives the shape {after.shape}; known are 1 to {_WIDEST} numbers of one state")
    # Runtimes join operations and multiply weights first, in any order, so that each number counts as 1 at least.
    # They keep scales in single precision, whatever that of the file is.
    attributes = [onnx.helper.get_attribute_value(item) for item in node.attribute]
    numbers = [*weights, *(x for x in attributes if isinstance(x, float))]
    numbers += [1.0 / x for x in weights if kind == "Div"]
    scale = float(np.prod([max(1.0, float(np.abs(x).max())) for x in numbers]))
    if not scale < 0.5 * float(np.finfo(np.float32).max):
        scale = np.inf
    # A product has a rounding for each of its terms; the scales alpha and beta, and the sum, have one each.
    terms = 1 if kind in _ENTRYWISE else size
    machine = layer.rounding
    assert machine is not None
    factor, constant = machine.growth
    rows = np.abs(table)
    rounding = machine._replace(
        weight=rows @ machine.weight,
        bias=rows @ machine.bias + np.abs(shift) + _TINY,
        times=machine.times + terms + 3,
        growth=(terms * scale * factor, terms * scale * constant + scale),
    )
    joined = Layer(table @ layer.weight, table @ layer.bias + shift, "", rounding)
    return joined, after.shape


def _compare(
    content: bytes,
    where: object,
    layers: Sequence[Layer],
    taken: _Input,
    around: tuple[Sequence[float], Sequence[float]] | None,
) -> None:
    """Compare layers with ONNX Runtime on random states: half of them around the starts, the others of any size.

    Its answers must be within what a proof takes for possible, the planes around the layers' answers.

    Args:
        content: content of the ONNX file.
        where: its name in messages.
        layers: layers that were read.
        taken: what the graph takes.
        around: lowest and highest starts; None: -1 and 1.

    Raises:
        ConfigError: they differ, or ONNX Runtime cannot run the file.
    """
    runtime = require("onnxruntime")
    width = layers[0].weight.shape[1]
    low, high = ([-1.0] * width, [1.0] * width) if around is None else around
    if len(low) != width:
        raise ConfigError(f"{where} takes {width} numbers, and the problem has {len(low)} states.")
    # Half: the starts' box, three times as wide. Half: up to ten thousand times as large as it, with any signs.
    random = np.random.default_rng(0)
    middle = 0.5 * np.add(low, high)
    half = np.maximum(0.5 * np.subtract(high, low), 0.01 * np.abs(middle) + 1e-6)
    near = middle + 3.0 * half * random.uniform(-1.0, 1.0, (_PROBES // 2, width))
    sizes = 10.0 ** random.uniform(-3.0, 4.0, near.shape)
    far = (np.abs(middle) + half) * sizes * random.choice((-1.0, 1.0), near.shape)
    states = np.concatenate((near, far)).astype(taken.precision)
    options = runtime.SessionOptions()
    options.intra_op_num_threads = 1
    options.log_severity_level = 4  # its errors are exceptions, too
    try:
        session = runtime.InferenceSession(content, options, providers=["CPUExecutionProvider"])
        answers = np.stack(
            [session.run(None, {taken.name: x.reshape(taken.shape)})[0].ravel() for x in states]
        )
    except Exception as error:  # ONNX Runtime's errors have no common class
        raise ConfigError(f"{where} does not run in ONNX Runtime: {first_line(error)}.") from error
    x = torch.from_numpy(states.astype(np.float64))
    none = torch.zeros((*x.shape, 0), dtype=torch.float64)
    tensors = layer_tensors(layers, torch.device("cpu"))
    planes = enclose(tensors, Zonotope(x, none, torch.zeros_like(x)))
    read = ((planes.gain @ x[:, :, None])[:, :, 0] + planes.offset).numpy()
    allowed = planes.error.numpy()
    if answers.shape != read.shape:
        raise ConfigError(
            f"{where} gives {answers.shape[1]} numbers in ONNX Runtime, and {read.shape[1]} were read."
        )
    excess = np.abs(answers - read) - allowed
    worst = int(np.nan_to_num(excess, nan=np.inf).max(axis=1).argmax())
    # Where the rounding is as large as the answers the comparison would say nothing; that of an activation is less.
    is_fine = (allowed.max(axis=0) <= np.abs(read).max(axis=0) + 1e-6).all()
    if not (is_fine and (excess <= 0.0).all()):
        raise ConfigError(
            f"{where} is not read as ONNX Runtime computes it: to the state {brief(states[worst].tolist())} it "
            f"answers {brief(answers[worst].tolist())}, and the layers that were read "
            f"{brief(read[worst].tolist())}; or single precision is too coarse for its weights."
        )


def apply(layers: Sequence[Layer], states: np.ndarray) -> np.ndarray:
    """Outputs (N, outputs) of a network for states (N, inputs), in double precision without any enclosure.

    For flights and comparisons; proofs use `rans_proof.relaxation.enclose`.
    """
    x = states
    for layer in layers:
        x = x @ layer.weight.T + layer.bias
        if layer.activation == "tanh":
            x = np.tanh(x)
        elif layer.activation == "sigmoid":
            x = 0.5 + 0.5 * np.tanh(0.5 * x)
        elif layer.activation == "relu":
            x = np.maximum(x, 0.0)
    return x
