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

    weight: np.ndarray
    """(outputs, inputs) sums of absolute products along the joined operations."""
    bias: np.ndarray
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

    weight: np.ndarray
    """(outputs, inputs)."""
    bias: np.ndarray
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
    _refuse_beside_the_graph(model, where)
    graph = model.graph
    tables = _tables(onnx, graph, where)
    taken = _input(graph, tables, where)
    # One operation after another, joined where they are linear.
    chain = _Chain(tables, taken)
    for number, node in enumerate(graph.node):
        title = f"{where}: node {number} ({brief(node.op_type)[1:-1]}"
        title += f" {brief(node.name)})" if node.name else ")"
        try:
            with np.errstate(all="ignore"):  # products of huge weights, which are refused below
                chain.append(onnx, node)
        except _Unread as reason:
            raise ConfigError(f"{title} {reason}.") from None
    if [tensor.name for tensor in graph.output] != [chain.current]:
        raise ConfigError(
            f"{where} must have one output, that of its last node, and has "
            f"{brief([tensor.name for tensor in graph.output])}."
        )
    if graph.output[0].type.tensor_type.elem_type != onnx.helper.np_dtype_to_tensor_dtype(
        taken.precision
    ):
        raise ConfigError(f"{where} must give numbers of the precision that it takes.")
    layers = chain.layers()
    if not layers:
        raise ConfigError(f"{where} has no layer.")
    if not all(
        np.isfinite(layer.weight).all() and np.isfinite(layer.bias).all() for layer in layers
    ):
        raise ConfigError(f"{where} has a weight that is not finite.")
    for layer in layers:
        assert layer.rounding is not None
        if not sum(layer.rounding.growth) < layer.rounding.largest:
            raise ConfigError(
                f"{where} has weights whose products and sums may be too large for the precision of the file, and "
                "gives no number then."
            )
    _compare(content, where, layers, taken, around)
    return layers


class _Unread(Exception):
    """A node that is not read; the message continues a sentence that begins with its name."""


def _refuse_beside_the_graph(model: Any, where: object) -> None:
    """Refuse (`ConfigError`) functions, sparse weights and other operator sets: they change what a graph means.

    `rans_proof.network_reader` refuses the same by its own lines; neither may rely on the other.
    """
    versions = [entry.version for entry in model.opset_import if entry.domain == ""]
    if len(versions) != 1 or versions[0] not in _OPSETS:
        raise ConfigError(
            f"{where} must import ONNX's operations once, in a version from {_OPSETS.start} to "
            f"{_OPSETS.stop - 1}, and has {brief(versions)}."
        )
    if len(model.graph.node) > _LONGEST:
        raise ConfigError(
            f"{where} has {len(model.graph.node):,} nodes, and at most {_LONGEST} are read."
        )
    if model.functions:
        raise ConfigError(f"{where} defines operations of its own (functions), which are not read.")
    if model.graph.sparse_initializer:
        raise ConfigError(f"{where} has a sparse weight, which is not read.")


def _tables(onnx: Any, graph: Any, where: object) -> dict[str, np.ndarray]:
    """Weights (arrays) by name in the file's precision.

    External, unnamed or infinite ones are refused (`ConfigError`).
    """
    tables: dict[str, np.ndarray] = {}
    for tensor in graph.initializer:
        name = brief(tensor.name)
        if not tensor.name or tensor.name in tables:
            raise ConfigError(f"{where} has two weights of the name {name}, or one without a name.")
        if tensor.data_location or tensor.external_data:
            raise ConfigError(
                f"{where} keeps the weight {name} in another file, which no hash would cover: save the network "
                "as one file."
            )
        try:
            table = onnx.numpy_helper.to_array(tensor)
        except Exception as error:  # of damaged data anything
            raise ConfigError(
                f"{where} has a weight {name} that cannot be read: {first_line(error)}."
            ) from error
        if table.dtype.kind == "f" and not np.isfinite(table).all():
            raise ConfigError(f"{where} has a weight {name} that is not finite.")
        tables[tensor.name] = table
    return tables


class _Input(NamedTuple):
    """What a graph takes."""

    name: str
    shape: tuple[int, ...]
    """Of one state: the first axis, that of a batch, is 1."""
    precision: np.dtype[Any]
    """Of the state, and so of every weight."""


def _input(graph: Any, tables: dict[str, np.ndarray], where: object) -> _Input:
    """The graph's one input: its name, shape with one state, and precision (`ConfigError` for others)."""
    inputs = [tensor for tensor in graph.input if tensor.name not in tables]
    if len(inputs) != 1:
        raise ConfigError(f"{where} has {len(inputs)} inputs; a proof is about a network of one.")
    kind = inputs[0].type.tensor_type
    precisions = {1: np.dtype(np.float32), 11: np.dtype(np.float64)}  # of TensorProto.DataType
    if kind.elem_type not in precisions:
        raise ConfigError(f"{where} takes no numbers of single or double precision.")
    # A first axis of any length is that of a batch.
    shape = [axis.dim_value if axis.HasField("dim_value") else 0 for axis in kind.shape.dim]
    if not (len(shape) >= 2 and shape[0] in (0, 1) and all(0 < n <= _WIDEST for n in shape[1:])):
        raise ConfigError(
            f"{where} takes the shape {shape}, and must take (N, states), whose first axis is that of a batch (0 "
            "stands for any length)."
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
        self._names = {taken.name, *tables}
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
            _Unread: it is not one that is read.
        """
        kind = node.op_type
        if node.domain or kind not in _ATTRIBUTES:
            raise _Unread(
                f"of the domain {brief(node.domain)} is not read; known are ONNX's own {', '.join(_ATTRIBUTES)}"
            )
        settings = _settings(onnx, node)
        inputs = list(node.input)
        while inputs and not inputs[-1]:  # an optional operand that is left out
            inputs.pop()
        if inputs.count(self.current) != 1:
            raise _Unread("must take the answer of the node before it, once")
        position = inputs.index(self.current)
        others = [name for name in inputs if name != self.current]
        if not all(name in self._tables for name in others):
            raise _Unread(
                "has an operand that is neither a weight of the file nor what comes before it"
            )
        operands = [self._tables[name] for name in others]
        if any(x.dtype != self._precision for x in operands) and kind != "Reshape":
            raise _Unread("has a weight of another precision than the network's input")
        if len(node.output) != 1 or node.output[0] in self._names | {""}:
            raise _Unread("must have one output, of a name of its own")
        if kind != "Reshape":
            operands = [x.astype(np.float64) for x in operands]
        terms = len(self._bias) if kind in ("MatMul", "Gemm", "Conv") else 1
        self._apply(kind, position, operands, settings)
        if kind not in ("Flatten", "Reshape", *ACTIVATIONS):
            self._grow(terms, [*operands, *(x for x in settings.values() if type(x) is float)])
        if not 0 < len(self._bias) <= _WIDEST:
            raise _Unread(f"gives {len(self._bias)} numbers; known are 1 to {_WIDEST}")
        self.current = node.output[0]
        self._names.add(self.current)

    def _apply(
        self, kind: str, position: int, operands: list[np.ndarray], settings: dict[str, Any]
    ) -> None:
        """Append an operation whose data is the operand of a position, beside the other operands.

        `_Unread` where its operands are not those that are read.
        """
        least, largest = {"Gemm": (1, 2), "Conv": (1, 2)}.get(
            kind, (int(kind not in ("Flatten", *ACTIVATIONS)),) * 2
        )
        if not least <= len(operands) <= largest:
            raise _Unread(f"has {len(operands)} operands beside its data")
        if position != 0 and kind not in ("Add", "Sub", "Mul"):
            raise _Unread("must have its data as its first operand")
        match kind:
            case "MatMul":
                self._multiply(operands[0])
            case "Gemm":
                self._gemm(operands, settings)
            case "Conv":
                self._convolve(operands, settings)
            case "Add":
                self._affine(np.ones(len(self._bias)), self._spread(operands[0]))
            case "Sub":
                sign = -1.0 if position else 1.0
                self._affine(sign * np.ones(len(self._bias)), -sign * self._spread(operands[0]))
            case "Mul":
                self._affine(self._spread(operands[0]), np.zeros(len(self._bias)))
            case "Div":
                divisor = self._spread(operands[0])
                if not divisor.all():
                    raise _Unread("divides by 0")
                self._affine(1.0 / divisor, np.zeros(len(self._bias)))
                self._grow(1, [1.0 / divisor])
            case "Flatten":
                if settings["axis"] != 1:
                    raise _Unread(f"has the axis {settings['axis']}; known is 1")
                self._shape = (1, len(self._bias))
            case "Reshape":
                self._reshape(operands[0], settings)
            case _:
                self._bend(ACTIVATIONS[kind])

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

    def _multiply(self, table: np.ndarray) -> None:
        """Product x W of one row x."""
        if table.ndim != 2 or self._shape[-1] != len(table) or len(self._bias) != len(table):
            raise _Unread(
                f"multiplies the shape {self._shape} by {table.shape}, which is no row by a matrix"
            )
        self._affine(table.T, np.zeros(table.shape[1]))
        self._shape = (*self._shape[:-1], table.shape[1])

    def _gemm(self, operands: list[np.ndarray], settings: dict[str, Any]) -> None:
        """Append alpha x B + beta C, where B may be marked as transposed; `_Unread` for other shapes."""
        if settings["transA"] or settings["transB"] not in (0, 1) or operands[0].ndim != 2:
            raise _Unread("has another transA, transB or shape than those that are read")
        table = operands[0] if settings["transB"] else operands[0].T
        if self._shape != (1, table.shape[1]):
            raise _Unread(f"multiplies the shape {self._shape} by {table.shape[::-1]}")
        shift = np.zeros(len(table))
        self._shape = (1, len(table))
        if len(operands) == 2:
            shift = settings["beta"] * _broadcast(operands[1], self._shape)
        self._affine(settings["alpha"] * table, shift)

    def _convolve(self, operands: list[np.ndarray], settings: dict[str, Any]) -> None:
        """A convolution whose kernel is as large as what it takes, so that it is one product.

        Changes shape and layer.
        """
        kernel = operands[0]
        axes = len(self._shape) - 2
        plain = {
            "auto_pad": [b"NOTSET", b"VALID"],
            "dilations": [[], [1] * axes],
            "group": [1],
            "kernel_shape": [[], list(kernel.shape[2:])],
            "pads": [[], [0] * 2 * axes],
            "strides": [[], [1] * axes],
        }
        for name, values in plain.items():
            if settings[name] not in values:
                raise _Unread(f"has {name} {brief(settings[name])}; known is {values[-1]}")
        if axes < 1 or kernel.shape[1:] != self._shape[1:]:
            raise _Unread(
                f"has a kernel {kernel.shape} for the shape {self._shape}; known are those as large as that"
            )
        count = len(kernel)
        shift = np.zeros(count)
        if len(operands) == 2:
            if operands[1].shape != (count,):
                raise _Unread(f"has a bias of shape {operands[1].shape} for {count} outputs")
            shift = operands[1]
        self._affine(kernel.reshape(count, -1), shift)
        self._shape = (1, count) + (1,) * axes

    def _reshape(self, target: np.ndarray, settings: dict[str, Any]) -> None:
        """Another shape of the same numbers, whose first axis is still one. It changes `_shape` alone."""
        if (
            settings["allowzero"]
            or target.dtype != np.int64
            or target.ndim != 1
            or not 2 <= len(target) <= 8
        ):
            raise _Unread("must have the axes of its new shape in a list of 2 to 8 whole numbers")
        shape = [int(n) for n in target]
        if any(n == 0 for n in shape[len(self._shape) :]) or min(shape) < -1:
            raise _Unread("keeps an axis that is not there, or has a negative one")
        shape = [self._shape[k] if n == 0 else n for k, n in enumerate(shape)]
        try:
            new = np.empty(self._shape, dtype=bool).reshape(shape).shape
        except ValueError as error:
            raise _Unread(f"has a shape that does not fit: {error}") from None
        if new[0] != 1:
            raise _Unread(f"makes the shape {new}, whose first axis must be that of the batch")
        self._shape = new

    def _bend(self, activation: str) -> None:
        if self._weight is None:
            raise _Unread("is an activation without weights right before it")
        self._layers.append(self._layer(activation))
        self._growth = 1.0, 0.0
        self._weight = None
        self._bias = np.zeros(len(self._bias))

    def _spread(self, operand: np.ndarray) -> np.ndarray:
        return _broadcast(operand, self._shape)

    def _affine(self, table: np.ndarray, shift: np.ndarray) -> None:
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
        _Unread: one is unknown, of another type, or there twice.
    """
    defaults = _ATTRIBUTES[node.op_type]
    settings = dict(defaults)
    names = [item.name for item in node.attribute]
    for item in node.attribute:
        if item.name not in defaults or names.count(item.name) > 1 or item.ref_attr_name:
            raise _Unread(f"has an attribute {brief(item.name)} that is not read")
        value = onnx.helper.get_attribute_value(item)
        value = list(value) if isinstance(defaults[item.name], list) else value
        if type(value) is not type(defaults[item.name]) or (
            isinstance(value, float) and not np.isfinite(value)
        ):
            raise _Unread(f"has an attribute {brief(item.name)} of another type than ONNX's")
        settings[item.name] = value
    return settings


def _broadcast(operand: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Entries of an operand for every number of a shape."""
    try:
        return np.broadcast_to(operand, shape).ravel()
    except ValueError:
        raise _Unread(f"has an operand of the shape {operand.shape} for {shape}") from None


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
