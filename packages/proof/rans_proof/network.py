"""Dense networks: layers of a weight, a bias and an activation, as read from an ONNX file.

The reader is an allow list: a graph is one chain of known operations whose every attribute is known, and all else
is refused. Layers that were read are compared with ONNX Runtime on random states before they are returned.
`rans_proof.network_reader` reads the same files without this code, and each refuses by itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from rans.extend import ConfigError, brief, first_line, read_bytes, require

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

_ATTRIBUTES: dict[str, dict[str, Any]] = {
    "MatMul": {},
    "Gemm": {"alpha": 1.0, "beta": 1.0, "transA": 0, "transB": 0},
    "Conv": {
        "auto_pad": b"NOTSET",
        "dilations": [],
        "group": 1,
        "kernel_shape": [],
        "pads": [],
        "strides": [],
    },
    "Add": {},
    "Sub": {},
    "Mul": {},
    "Div": {},
    "Flatten": {"axis": 1},
    "Reshape": {"allowzero": 0},
    "Tanh": {},
    "Sigmoid": {},
    "Relu": {},
}
"""Operations that are read, and their attributes with what they are where a file leaves them out."""
_ALLOWED: dict[str, set[Any]] = {
    "allowzero": {0},
    "auto_pad": {b"NOTSET", b"VALID"},
    "axis": {1},
    "dilations": {1},
    "group": {1},
    "pads": {0},
    "strides": {1},
    "transA": {0},
    "transB": {0, 1},
}
"""Values that attributes, or entries of their lists, may have; of others any."""

_PROBES = 1000
"""States on which layers are compared with ONNX Runtime, half of them around the starts; it takes some 20 ms."""
_DEVIATIONS = 4.0
"""Largest difference from ONNX Runtime, in standard deviations of the rounding, which are estimated from above: no
network that was read right differed by one of them."""
_TINY = 1e-30
"""Added to the sizes of terms, so that products below the least normal number of single precision, which may become
0, count, too: a thousand of them are below 1e-35."""


class Rounding(NamedTuple):
    """Sizes of the terms of a layer's sums, as a machine rounds them one operation after the other."""

    weight: Any
    """(outputs, inputs) sums of absolute products along the joined operations; an array, or a tensor."""
    bias: Any
    """(outputs,)."""
    times: int
    """Roundings of a term at most."""
    unit: float
    """Unit roundoff of the file's precision."""
    growth: tuple[float, float]
    """Factor and constant of a bound of all partial sums by the largest number that the layer takes, 1 at least."""
    largest: float
    """Largest bound of a partial sum that surely is a number of the file's precision."""

    @property
    def part(self) -> float:
        """Error of a sum at most, a part of the size of its terms, in any order of summation.

        Higham, "Accuracy and stability of numerical algorithms", 3.1.
        """
        return self.times * self.unit / (1.0 - self.times * self.unit)


class Layer(NamedTuple):
    """Layer y = activation(weight x + bias)."""

    weight: Any
    """(outputs, inputs), an array, or a tensor where sets of states go through it."""
    bias: Any
    """(outputs,)."""
    activation: str
    """ "tanh", "sigmoid", "relu" or "" for none."""
    rounding: Rounding | None = None
    """None: computed exactly."""


def read_network(
    file: Path, around: tuple[Sequence[float], Sequence[float]] | None = None
) -> list[Layer]:
    """Layers of the network in an ONNX file; arguments and errors as for `network_of`."""
    return network_of(read_bytes(file, LARGEST), file, around)


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
    taken = _input(graph, tables)
    # One operation after another, joined where they are linear.
    chain = _Chain(tables, taken)
    for number, node in enumerate(graph.node):
        try:
            chain.append(onnx, node)
        except _Unread as reason:
            title = (
                f"{brief(node.op_type)} {brief(node.name)}" if node.name else brief(node.op_type)
            )
            raise _Unread(f"is not read at node {number} ({title}): it {reason}") from None
    outputs = [tensor.name for tensor in graph.output]
    _need(
        outputs == [chain.current],
        f"must have one output, that of its last node, and has {brief(outputs)}",
    )
    precision = onnx.helper.np_dtype_to_tensor_dtype(taken.precision)
    _need(
        graph.output[0].type.tensor_type.elem_type == precision,
        "must give numbers of the precision that it takes",
    )
    layers = chain.layers()
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
    """Weights (arrays) by name in the file's precision; external, unnamed or infinite ones are refused."""
    tables: dict[str, np.ndarray] = {}
    for tensor in graph.initializer:
        name = brief(tensor.name)
        is_new = tensor.name and tensor.name not in tables
        _need(is_new, f"has two weights of the name {name}, or one without a name")
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


class _Chain:
    """Chain of operations on one state, and the layers that it amounts to so far.

    Args:
        tables: weights by their names.
        taken: what the graph takes.
    """

    def __init__(self, tables: dict[str, np.ndarray], taken: _Input) -> None:
        self.current = taken.name
        self._shape = taken.shape
        self._tables = tables
        self._precision = taken.precision
        self._names = {"", taken.name, *tables}
        self._layers: list[Layer] = []
        self._weight: np.ndarray | None = None  # of linear operations since the last activation
        self._bias = np.zeros(int(np.prod(taken.shape)))
        self._sizes = np.zeros((0, 0)), np.zeros(0)  # of their terms
        self._count = 0
        self._growth = 1.0, 0.0
        self._unit = float(np.finfo(taken.precision).eps) / 2.0
        # Half of the largest number, which leaves more than rounding adds.
        self._largest = float(np.finfo(taken.precision).max) / 2.0

    def layers(self) -> list[Layer]:
        """All layers, the last of which may have no activation."""
        return self._layers if self._weight is None else [*self._layers, self._layer("")]

    def _layer(self, activation: str) -> Layer:
        """Layer of the linear operations since the last activation; one rounding more is that of what it takes."""
        assert self._weight is not None
        rounding = Rounding(*self._sizes, self._count + 1, self._unit, self._growth, self._largest)
        return Layer(self._weight, self._bias, activation, rounding)

    def append(self, onnx: Any, node: Any) -> None:
        """Append an operation. It joins the layer that is open, or begins one.

        Raises:
            _Unread: it is not one that is read; the message continues a sentence about the operation.
        """
        kind = node.op_type
        _need(
            not node.domain and kind in _ATTRIBUTES,
            f"is of the domain {brief(node.domain)}; known are ONNX's own {', '.join(_ATTRIBUTES)}",
        )
        settings = _settings(onnx, node)
        inputs = list(node.input)
        while inputs and not inputs[-1]:  # an optional operand that is left out
            inputs.pop()
        is_next = inputs.count(self.current) == 1
        _need(is_next, "must take the answer of the node before it, once")
        others = [name for name in inputs if name != self.current]
        _need(
            all(name in self._tables for name in others),
            "has an operand that is neither a weight of the file nor what comes before it",
        )
        is_new = len(node.output) == 1 and node.output[0] not in self._names
        _need(is_new, "must have one output, of a name of its own")
        operands = [self._tables[name] for name in others]
        if kind != "Reshape":
            is_same = all(x.dtype == self._precision for x in operands)
            _need(is_same, "has a weight of another precision than the network's input")
            operands = [x.astype(np.float64) for x in operands]
        terms = len(self._bias) if kind in ("MatMul", "Gemm", "Conv") else 1
        self._apply(kind, inputs.index(self.current), operands, settings)
        if kind not in ("Flatten", "Reshape", *ACTIVATIONS):
            self._grow(terms, [*operands, *(x for x in settings.values() if type(x) is float)])
        count = len(self._bias)
        _need(0 < count <= _WIDEST, f"gives {count} numbers; known are 1 to {_WIDEST}")
        self.current = node.output[0]
        self._names.add(self.current)

    def _apply(
        self, kind: str, position: int, operands: list[np.ndarray], settings: dict[str, Any]
    ) -> None:
        """Append an operation whose data is the operand of a position, beside the other operands.

        `_Unread` where its operands are not those that are read.
        """
        shape = self._shape
        count = len(self._bias)
        is_first = position == 0
        match kind, operands:
            case "MatMul", [table] if (
                is_first and table.ndim == 2 and shape[-1] == count == len(table)
            ):
                self._affine(table.T)
                self._shape = (*shape[:-1], table.shape[1])
            case "Gemm", [table, *shifts] if is_first and table.ndim == 2 and len(shifts) <= 1:
                table = table if settings["transB"] else table.T
                width = table.shape[1]
                _need(shape == (1, width), f"takes {width} numbers, and is given the shape {shape}")
                self._shape = (1, len(table))
                shift = sum(
                    (settings["beta"] * self._spread(x) for x in shifts), np.zeros(len(table))
                )
                self._affine(settings["alpha"] * table, shift)
            case "Conv", [kernel, *shifts] if is_first and len(shape) > 2 and len(shifts) <= 1:
                # A kernel as large as what it takes makes the convolution one product.
                is_whole = kernel.shape[1:] == shape[1:]
                is_whole &= settings["kernel_shape"] in ([], list(kernel.shape[2:]))
                _need(
                    is_whole,
                    f"has a kernel {kernel.shape} that is not as large as the shape {shape}",
                )
                is_fine = all(x.shape == (len(kernel),) for x in shifts)
                _need(is_fine, f"has a bias of another size than {len(kernel)}")
                self._affine(kernel.reshape(len(kernel), -1), *shifts)
                self._shape = (1, len(kernel)) + (1,) * (len(shape) - 2)
            case "Add", [operand]:
                self._affine(np.ones(count), self._spread(operand))
            case "Sub", [operand]:
                sign = 1.0 if is_first else -1.0
                self._affine(sign * np.ones(count), -sign * self._spread(operand))
            case "Mul", [operand]:
                self._affine(self._spread(operand))
            case "Div", [operand] if is_first:
                _need(operand.all(), "divides by 0")
                self._affine(1.0 / self._spread(operand))
                self._grow(1, [1.0 / operand])
            case "Flatten", []:
                self._shape = (1, count)
            case "Reshape", [target] if is_first:
                self._reshape(target)
            case (("Tanh" | "Sigmoid" | "Relu"), []):
                _need(self._weight is not None, "is an activation without weights right before it")
                self._layers.append(self._layer(ACTIVATIONS[kind]))
                self._growth = 1.0, 0.0
                self._weight = None
                self._bias = np.zeros(count)
            case _:
                raise _Unread(
                    f"takes data of the shape {shape} as operand {position}, and weights of the shapes "
                    f"{[x.shape for x in operands]}"
                )

    def _grow(self, terms: int, numbers: Sequence[Any]) -> None:
        """Bound the partial sums of an operation of so many terms and these numbers, in any order.

        Runtimes join operations and multiply weights first, so that each number counts as 1 at least. They keep
        scales in single precision, whatever that of the file is.
        """
        factor, constant = self._growth
        size = 1.0
        for number in numbers:
            size *= max(1.0, float(np.max(np.abs(number))))
        if not size < 0.5 * float(np.finfo(np.float32).max):
            size = np.inf
        self._growth = terms * size * factor, terms * size * constant + size

    def _reshape(self, target: np.ndarray) -> None:
        """Another shape of the same numbers, whose first axis is still one. It changes `_shape` alone."""
        is_list = target.dtype == np.int64 and target.ndim == 1 and 2 <= len(target) <= 8
        _need(is_list, "must have the axes of its new shape in a list of 2 to 8 whole numbers")
        axes = [int(n) for n in target]
        is_there = all(axes[len(self._shape) :]) and min(axes) >= -1
        _need(is_there, "keeps an axis that is not there, or has a negative one")
        axes = [self._shape[k] if n == 0 else n for k, n in enumerate(axes)]
        try:
            new = np.empty(self._shape, dtype=bool).reshape(axes).shape
        except ValueError as error:
            raise _Unread(f"has a shape that does not fit: {error}") from None
        _need(new[0] == 1, f"makes the shape {new}, whose first axis must be that of the batch")
        self._shape = new

    def _spread(self, operand: np.ndarray) -> np.ndarray:
        """Entries of an operand for every number of the shape that is reached."""
        try:
            return np.broadcast_to(operand, self._shape).ravel()
        except ValueError:
            raise _Unread(
                f"has an operand of the shape {operand.shape} for {self._shape}"
            ) from None

    def _affine(self, table: np.ndarray, shift: np.ndarray | float = 0.0) -> None:
        """Append table x + shift; a table of one axis is a diagonal matrix.

        What rounding may cost is counted beside it (`_sizes`, `_count`).
        """
        # A product has a rounding for each of its terms; the scales alpha and beta, and the sum, have one each.
        count = 3 + (1 if table.ndim == 1 else table.shape[1])
        if table.ndim == 1:
            table = np.diag(table)
        if self._weight is None:
            self._sizes = np.eye(len(self._bias)), np.zeros(len(self._bias))
            self._count = 0
        self._count += count
        self._weight = table if self._weight is None else table @ self._weight
        self._bias = table @ self._bias + shift
        weight, bias = (np.abs(table) @ size for size in self._sizes)
        self._sizes = weight, bias + np.abs(shift) + _TINY


def _settings(onnx: Any, node: Any) -> dict[str, Any]:
    """Attributes of a node of `_ATTRIBUTES`, defaults where it has none.

    Raises:
        _Unread: one is unknown, there twice, of another type or value.
    """
    defaults = _ATTRIBUTES[node.op_type]
    settings = dict(defaults)
    names = [item.name for item in node.attribute]
    for item in node.attribute:
        name = brief(item.name)
        is_known = item.name in defaults and names.count(item.name) == 1
        _need(is_known and not item.ref_attr_name, f"has an attribute {name} that is not read")
        value = onnx.helper.get_attribute_value(item)
        is_list = item.type == onnx.AttributeProto.INTS
        value = list(value) if is_list else value
        is_typed = type(value) is type(defaults[item.name]) and isinstance(value, list) == is_list
        is_typed = is_typed and not (isinstance(value, float) and not np.isfinite(value))
        _need(is_typed, f"has an attribute {name} of another type than ONNX's")
        entries = set(value if isinstance(value, list) else [value])
        is_allowed = entries <= _ALLOWED.get(item.name, entries)
        _need(is_allowed, f"has the {name} {brief(value)}, which is not read")
        settings[item.name] = value
    return settings


def _compare(
    content: bytes,
    where: object,
    layers: Sequence[Layer],
    taken: _Input,
    around: tuple[Sequence[float], Sequence[float]] | None,
) -> None:
    """Compare layers with ONNX Runtime on random states: half of them around the starts, the others of any size.

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
    x = states.astype(np.float64)
    read = apply(layers, x)
    if answers.shape != read.shape:
        raise ConfigError(
            f"{where} gives {answers.shape[1]} numbers in ONNX Runtime, and {read.shape[1]} were read."
        )
    allowed = _DEVIATIONS * _deviation(layers, x)
    excess = np.abs(answers - read) - allowed
    worst = int(np.nan_to_num(excess, nan=np.inf).max(axis=1).argmax())
    # Where the rounding is as large as the answers the comparison would say nothing; that of an activation is less.
    is_fine = (allowed.max(axis=0) <= np.abs(read).max(axis=0) + 1e-6).all()
    if not (is_fine and (excess <= 0.0).all()):
        raise ConfigError(
            f"{where} is not read as ONNX Runtime computes it: to the state {brief(x[worst].tolist())} it answers "
            f"{brief(answers[worst].tolist())}, and the layers that were read {brief(read[worst].tolist())}; or "
            "single precision is too coarse for its weights."
        )


def _deviation(layers: Sequence[Layer], states: np.ndarray) -> np.ndarray:
    """Standard deviation (N, outputs) of the rounding of a network's answers, from above.

    Roundings are taken for independent, so that they add up by their squares (Higham and Mary, "A new approach to
    probabilistic rounding error analysis", 2019). An activation errs by four units.
    """
    x = states
    variance = np.zeros_like(x)
    for layer in layers:
        assert layer.rounding is not None
        weight, bias, times, unit = layer.rounding[:4]
        size = np.abs(x) @ weight.T + bias
        variance = variance @ (layer.weight**2).T + times * (unit * size) ** 2
        sums = x @ layer.weight.T + layer.bias
        x = apply([layer], x)
        if layer.activation in ("tanh", "sigmoid"):
            slope = 1.0 - x**2 if layer.activation == "tanh" else x * (1.0 - x)
            variance = slope**2 * variance + (4.0 * unit) ** 2
        elif layer.activation == "relu":
            variance = variance * (sums + _DEVIATIONS * np.sqrt(variance) > 0.0)
    return np.sqrt(variance)


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
