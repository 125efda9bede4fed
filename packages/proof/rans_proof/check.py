"""Check of a network's certificate in ball arithmetic: one file, which shares no code with the prover.

A certificate names a network by its SHA-256, a problem (plant, starts, property), and cells of starts, or a flight.
It is accepted if

1. it is well formed: a closed schema, so that no claim is made which is not checked here (`claim_of`);
2. the network is the file at hand, read by a reader of its own and compared with `onnx.reference` (`layers_of`);
3. its cells cover the starts (`_cover`);
4. from every cell the property holds at all times with a margin above zero (`Loop.margin`). A set of states
   goes through the network (`balls.network_enclosure`) and the plant (`Plant.move`), period by period, and the
   property is judged over each step (`Property.margin`). A cell that is too wide as a whole is halved;
5. a flight breaks the property at an instant for sure (`Loop.broken`).

Every number is an interval of FLINT, so that no rounding is argued about. It needs numpy, onnx and python-flint.
"""

from __future__ import annotations

import ast
import contextlib
import functools
import hashlib
import json
import math
import operator
import tomllib
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
import onnx
from flint import arb, arb_mat, arb_series, ctx
from onnx import numpy_helper
from onnx.reference import ReferenceEvaluator

from rans_proof.balls import (
    Layer,
    Refused,
    absolute_row_sums,
    column,
    diagonal,
    matrix,
    need,
    network_enclosure,
    side_by_side,
    sizes,
)

_BITS = 80
"""Bits of a ball's middle."""
LARGEST = 2**28
"""Bytes of a certificate that is read; a million cells of four states have 10^8."""
_STATES, _UNITS, _NODES = 16, 1024, 100
"""Largest numbers of states, of numbers between two operations of a network, and of its operations."""
_SAMPLES = 1000
"""States on which layers are compared with onnx.reference; it takes half a second."""
_DEVIATIONS = 4
"""Largest difference, in standard deviations of the rounding, which are estimated from above."""
_BEND_UNITS = 8
"""Units of rounding that activations err by at most."""
_TINY = 1e-30
"""Added to a sum's size, since products below the least normal number of single precision may become 0."""
_TERMS = 6
"""Terms of a step's series in time; the next one is its rest."""
_COARSE, _FINE = 5e-5, 1e-8
"""Parts of a state's spread and of its size that the rest of a step may add; a step that adds more is halved."""
_HALVINGS = 10
"""A period is halved so often at most."""
_DEPTH = 12
"""A cell is halved so often at most."""
_KEPT = 64
"""Columns of a spread, at least, of which the least ones become a box."""
_SIDES = 48
"""Sides of the polygon around a circle of speeds."""
_OFF = 1e-6
"""Part of a state by which a flight that was written out may be off: it was computed in double precision."""


def check(certificate: bytes, network: bytes, only: Sequence[int] | None = None) -> float:
    """Least margin that this program finds over the cells of a certificate, or that of a flight that breaks it.

    Args:
        certificate: content of a certificate's file.
        network: content of the ONNX file.
        only: numbers of the cells whose flights are checked; None: all. The cover is checked in any case.

    Returns:
        A number above 0 if the property is proved, and below 0 if the certificate is of a flight that breaks it.

    Raises:
        Refused: it proves nothing, or is of another network.
    """
    ctx.prec = _BITS
    claim = _claim(certificate, network)
    loop = Loop(claim.problem, network)
    if claim.flight:
        return loop.broken(claim.flight)
    least = math.inf
    for k in range(len(claim.cells)) if only is None else only:
        margin = loop.margin(claim.cells[k], _DEPTH)
        need(margin > 0.0, f"cell {k} has the margin {margin:.3g}.")
        least = min(least, margin)
    return least


@functools.lru_cache(maxsize=1)
def _claim(certificate: bytes, network: bytes) -> Claim:
    """Claim of a certificate of this network, whose cells cover its starts.

    The last one is remembered, because cells are checked a few at a time.
    """
    claim = claim_of(certificate)
    digest = hashlib.sha256(network).hexdigest()
    need(claim.network == digest, "it is of another network: the SHA-256 of the file differs.")
    start = claim.problem["start"]
    box = [(float(a), float(b)) for a, b in zip(start["lower"], start["upper"], strict=True)]
    if claim.flight:
        is_start = all(a <= x <= b for (a, b), x in zip(box, claim.flight[0], strict=True))
        need(is_start, "its flight does not begin among the starts.")
    else:
        _cover(box, claim.cells)
    return claim


def _cover(box: Any, cells: Any) -> None:
    """Refuse cells that leave a part of a box open. Coordinates are compared, never computed."""
    stack = [(box, cells)]
    while stack:
        box, inside = stack.pop()
        pairs = [list(zip(box, cell, strict=True)) for cell in inside]
        pairs = [
            overlap
            for overlap in pairs
            if all((a < d and c < b) or a == b for (a, b), (c, d) in overlap)
        ]
        inside = [[cell for _, cell in overlap] for overlap in pairs]
        if any(all(c <= a and b <= d for (a, b), (c, d) in overlap) for overlap in pairs):
            continue
        cuts = [
            (axis, edge)
            for overlap in pairs
            for axis, ((a, b), ends) in enumerate(overlap)
            for edge in ends
            if a < edge < b
        ]
        need(cuts, f"its cells do not cover {box}.")
        axis, edge = cuts[len(cuts) // 2]
        parts = ((box[axis][0], edge), (edge, box[axis][1]))
        stack += [([*box[:axis], part, *box[axis + 1 :]], inside) for part in parts]


# 1. The certificate: what is not in its schema is refused, since a key that no checker reads would be a claim that
# no checker checks.


class Claim(NamedTuple):
    """What a certificate claims."""

    network: str
    """SHA-256 of the ONNX file."""
    problem: dict[str, Any]
    """Table of `problem_table`."""
    cells: list[list[tuple[float, float]]]
    """Ends of each cell along each state; []: it is of a flight."""
    flight: list[list[float]]
    """States at the control instants of a flight that breaks the property; []: the property is claimed."""


class _Kind(NamedTuple):
    """Values that an entry may have."""

    words: str
    fits: Callable[[Any], bool]


def _whole(low: int, high: int) -> _Kind:
    words = f"whole number from {low} to {high}"
    return _Kind(words, lambda x: type(x) is int and low <= x <= high)


def _list(kind: _Kind, low: int, high: int) -> _Kind:
    words = f"list of {low} to {high}, each a {kind.words}"
    return _Kind(
        words, lambda x: isinstance(x, list) and low <= len(x) <= high and all(map(kind.fits, x))
    )


_TABLE = _Kind("table", lambda x: isinstance(x, dict))
_TEXT = _Kind("text", lambda x: isinstance(x, str) and len(x) < 2**16)
_FORMULAS = _list(_TEXT, 1, 1000)
_NUMBER = _Kind("number below 1e9", lambda x: type(x) in (int, float) and -1e9 < x < 1e9)
_POSITIVE = _Kind("number above 0, at most 1e4", lambda x: _NUMBER.fits(x) and 0 < x <= 1e4)
_DIGEST = _Kind(
    "SHA-256 of 64 digits",
    lambda x: isinstance(x, str) and len(x) == 64 and set(x) <= set("0123456789abcdef"),
)
_LINE = _Kind("line of text", lambda x: _TEXT.fits(x) and len(x) <= 200 and x.isprintable())
_ANYTHING = _Kind("value", lambda x: True)


def _entries(
    what: str, table: Any, needed: dict[str, _Kind], optional: dict[str, _Kind] | None = None
) -> None:
    """Refuse what is no table of these keys, with values of their kinds."""
    kinds = needed | (optional or {})
    is_closed = isinstance(table, dict) and needed.keys() <= table.keys() <= kinds.keys()
    need(is_closed, f"{what} has not exactly the keys {', '.join(sorted(kinds))}.")
    for key, value in table.items():
        need(kinds[key].fits(value), f"the {key} of {what} is no {kinds[key].words}.")


def claim_of(certificate: bytes) -> Claim:
    """Claim of a certificate's file.

    Raises:
        Refused: it has not exactly the keys of format 1, or a value of another type or out of bounds.
    """
    need(len(certificate) <= LARGEST, f"it has more than {LARGEST:,} bytes.")
    try:
        table = json.loads(certificate, object_pairs_hook=_once)
    except (ValueError, RecursionError, MemoryError) as error:
        raise Refused("it is damaged, it is not valid JSON.") from error
    is_flight = isinstance(table, dict) and "flight" in table
    proofs = {"flight": _ANYTHING} if is_flight else {"cells": _ANYTHING, "margins": _ANYTHING}
    head = {"format": _whole(1, 1), "network": _DIGEST, "problem": _TEXT}
    _entries("it", table, head | proofs)
    problem = problem_table(table["problem"])
    count = len(problem["derivative"])
    state = _list(_NUMBER, count, count)
    if is_flight:
        instants = problem["steps"] + 1
        _entries("it", {"flight": table["flight"]}, {"flight": _list(state, instants, instants)})
        return Claim(table["network"], problem, [], table["flight"])
    rows, margins = table["cells"], table["margins"]
    kind = _list(_list(state, 2, 2), 1, 10_000_000)
    _entries("it", {"cells": rows}, {"cells": kind})
    positive = _Kind("number above 0", lambda x: _NUMBER.fits(x) and x > 0)
    _entries("it", {"margins": margins}, {"margins": _list(positive, len(rows), len(rows))})
    cells = [[(float(a), float(b)) for a, b in zip(*row, strict=True)] for row in rows]
    need(all(a <= b for cell in cells for a, b in cell), "it has a cell of upper ends first.")
    return Claim(table["network"], problem, cells, [])


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Object of JSON whose keys are there once."""
    need(len(dict(pairs)) == len(pairs), "it is damaged, it has a key twice.")
    return dict(pairs)


def problem_table(text: str) -> dict[str, Any]:
    """Table of a problem in TOML, every entry of which was checked.

    Raises:
        Refused: it has not exactly the keys of a problem, or a value of another type or out of bounds.
    """
    need(_TEXT.fits(text), "its problem is too long.")
    try:
        table = tomllib.loads(text)
    except (ValueError, RecursionError, MemoryError) as error:
        raise Refused("its problem is not valid TOML.") from error
    needed = {"name": _LINE, "period": _POSITIVE, "steps": _whole(1, 10_000), "start": _TABLE}
    needed |= {"derivative": _list(_TEXT, 1, _STATES), "commands": _whole(1, _STATES)}
    optional = {"keep": _TABLE, "end": _TABLE, "inputs": _FORMULAS, "begins": _whole(0, 9999)}
    _entries("its problem", table, needed, optional)
    steps, count = table["steps"], len(table["derivative"])
    need(table["commands"] <= count, "its problem has more commands than states.")
    need(table.get("begins", 0) < steps, "its property begins after the last period.")
    need({"keep", "end"} & table.keys(), "its problem asks nothing of flights.")
    _box(table["start"], count, "its start")
    if "end" in table:
        _box(table["end"], count, "its end", {"earliest": _whole(0, steps)})
    if "keep" in table:
        need(len(table["keep"]) == 1, "its keep has not exactly one property.")
        ((kind, limit),) = table["keep"].items()
        _limit(kind, limit, count)
    return table


def _box(table: Any, count: int, what: str, optional: dict[str, _Kind] | None = None) -> None:
    """Refuse what is no table of a lower and an upper corner."""
    corner = _list(_NUMBER, count, count)
    _entries(what, table, {"lower": corner, "upper": corner}, optional)
    ends = zip(table["lower"], table["upper"], strict=True)
    need(all(a <= b for a, b in ends), f"{what} has a lower end above the upper one.")


def _limit(kind: str, limit: Any, count: int) -> None:
    """Refuse a property that is not checked."""
    every = _list(_whole(0, count - 1), 1, count)
    states = _Kind("list of different states", lambda x: every.fits(x) and len(set(x)) == len(x))
    if kind in ("avoid", "within"):
        _box(limit, count, f"its {kind}")
    elif kind in ("every", "some"):
        _entries("its keep", {kind: limit}, {kind: _FORMULAS})
    elif kind in ("keep_out", "stay_in"):
        _entries(f"its {kind}", limit, {"position": states, "radius": _NUMBER})
        need(limit["radius"] > 0, "its radius is not above 0.")
    else:
        need(kind == "speed_limit", f"its property {kind[:40]!r} is not checked.")
        plane = _Kind("two different states", lambda x: states.fits(x) and len(x) == 2)
        kinds = {"position": states, "velocity": plane, "base": _NUMBER, "slope": _NUMBER}
        _entries(f"its {kind}", limit, kinds)
        # Distances are bounded from below, which serves limits that grow with them.
        need(limit["slope"] >= 0, "the slope of its speed limit is below 0.")


def difference(problem: dict[str, Any], other: dict[str, Any]) -> str:
    """Names of the entries in which two problems differ, or "" if they are the same."""
    names = sorted(problem.keys() | other.keys())
    return ", ".join(name for name in names if problem.get(name) != other.get(name))


def statement(problem: dict[str, Any]) -> str:
    """What is proved of a network if a certificate of a problem is accepted, in a few lines."""
    rates = [" ".join(rate.split()) for rate in problem["derivative"]]
    taken = ", ".join(problem.get("inputs", [f"x{i}" for i in range(len(rates))]))
    commands = ", ".join(f"u{i}" for i in range(problem["commands"]))
    period, steps, begins = problem["period"], problem["steps"], problem.get("begins", 0)
    begin, last = (f"{n * period:.10g}" for n in (begins, steps))
    held = f"rounded as its file computes, and held for {_digits(period)} s each"
    lines = [
        "plant: " + ", ".join(f"x{i}' = {rate}" for i, rate in enumerate(rates)),
        f"commands: {commands} = network({taken}), {held}",
        f"starts: {_within(problem['start'])}",
    ]
    if "keep" in problem:
        ((kind, limit),) = problem["keep"].items()
        lines.append(f"property, at all times from {begin} to {last} s: {_sentence(kind, limit)}")
    if "end" not in problem:
        return "\n".join(lines)
    end, start = problem["end"], problem["start"]
    earliest = end.get("earliest", 0) or steps
    one_of = f" one of the control instants from {earliest * period:.10g} to"
    lines.append(f"end, at{one_of if earliest < steps else ''} {last} s: {_within(end)}")
    is_back = all(a <= x for a, x in zip(start["lower"], end["lower"], strict=True)) and all(
        x <= b for x, b in zip(end["upper"], start["upper"], strict=True)
    )
    if is_back and earliest == steps and "keep" in problem and not begins:
        lines.append("flights end among the starts: the property holds at all later times, too")
    return "\n".join(lines)


def _sentence(kind: str, limit: Any) -> str:
    """A property in a formula."""
    if kind == "within":
        return _within(limit)
    if kind == "avoid":
        return f"never {_within(limit)}, all at once"
    if kind in ("every", "some"):
        joint = " and " if kind == "every" else " or "
        return joint.join(f"{' '.join(text.split())} >= 0" for text in limit)
    distance = f"|({', '.join(f'x{i}' for i in limit['position'])})|"
    if kind != "speed_limit":
        return f"{distance} {'>=' if kind == 'keep_out' else '<='} {_digits(limit['radius'])}"
    speed = f"|({', '.join(f'x{i}' for i in limit['velocity'])})|"
    return f"{speed} <= {_digits(limit['base'])} + {_digits(limit['slope'])} {distance}"


def _within(box: dict[str, Any]) -> str:
    ends = enumerate(zip(box["lower"], box["upper"], strict=True))
    return ", ".join(f"x{i} in [{_digits(low)}, {_digits(high)}]" for i, (low, high) in ends)


def _digits(value: float) -> str:
    """A number with all its digits."""
    return repr(float(value)).removesuffix(".0")


# 2. The network: one chain of operations from the input to the output, each with an allow list of its attributes.

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
    """Layers of a network, and the name, the shape and the precision of its input."""
    graph = model.graph
    versions = {entry.domain: entry.version for entry in model.opset_import}
    is_known = len(versions) == len(model.opset_import) and 7 <= versions.get("", 0) <= 28
    need(is_known, "its network's version of ONNX's operations is not one from 7 to 28.")
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
    # Linear operations that follow one another are one layer, which ends with an activation: matrix and shift,
    # those of the sizes of its terms, and how often a term is rounded.
    layers: list[Any] = []
    linear: list[Any] = []
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
            need(
                linear,
                f"its network has the activation {node.op_type!r} without weights before it.",
            )
            layers.append(_rounded(linear, node.op_type, precision))
            linear = []
        else:
            is_same = node.op_type == "Reshape" or all(w.dtype == precision for w in weights)
            need(is_same, "its network has a weight in another precision.")
            position = operands.index(data)
            size = math.prod(shape)
            shape, table, shift = _after(node.op_type, shape, position, weights, attributes)
            if table is not None:
                before = linear or [diagonal([arb(1)] * size), arb_mat(size, 1)] * 2 + [1]
                rows, tiny = sizes(table), column([arb(_TINY)] * table.nrows())
                linear = [table * before[0], table * before[1] + shift, rows * before[2]]
                linear += [rows * before[3] + sizes(shift) + tiny, before[4] + size + 3]
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
            table, shift, shape = matrix(w.T), arb_mat(w.shape[1], 1), (*shape[:-1], w.shape[1])
        case "Gemm", [w, *bias] if position == 0 and w.ndim == 2 == len(shape) and len(bias) < 2:
            w = w if attributes.get("transB") else w.T
            bias = np.broadcast_to(bias[0] if bias else 0.0, (1, len(w)))
            table = matrix(w) * arb(attributes.get("alpha", 1.0))
            shift, shape = matrix(bias.T) * arb(attributes.get("beta", 1.0)), (1, len(w))
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
            zeros, ones = [arb(0)] * size, [arb(1)] * size
            factors, shift = {
                "Add": (ones, values),
                "Sub": ([-x for x in ones], values) if position else (ones, [-x for x in values]),
                "Mul": (values, zeros),
                "Div": ([1 / x for x in values], zeros),
            }[kind]
            table, shift = diagonal(factors), column(shift)
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


def _rounded(linear: Sequence[Any], kind: str, precision: Any) -> Layer:
    """A layer, with what a machine of a precision makes of it.

    A sum of products, each of which is rounded n times at most, errs by 1 / (1 - n u) - 1 of the sum of their
    sizes, in any order (Higham, "Accuracy and stability of numerical algorithms", 3.1).
    """
    table, shift, of_table, of_shift, count = linear
    unit = arb(float(np.finfo(precision).eps)) / 2
    part = 1 / (1 - count * unit) - 1
    bends = _BEND_UNITS * unit if kind in ("Tanh", "Sigmoid") else arb(0)
    return Layer(table, shift, kind, (of_table * part, of_shift * part, bends))


def _compare(
    model: Any,
    name: str,
    shape: tuple[int, ...],
    precision: Any,
    layers: Sequence[Any],
    low: Sequence[float],
    high: Sequence[float],
) -> None:
    """Refuse layers that answer otherwise than onnx.reference on random states around the starts, and far away."""
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
        bend, of_bend = bends[layer.kind], float(layer.machine[2]) / 2
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


# 3. The plant: power series in time, and slopes of them by the state. A function's slopes s over a set around c
# are balls with f(z) - f(c) in s (z - c) for every z of the set (Krawczyk and Neumaier, "Interval slopes for
# rational functions and associated centered forms", 1985).

Formula = Callable[[Sequence[Any]], Any]
"""Value of a formula, of numbers of any one kind in the place of its names."""
_SIGNS: dict[type, Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
}
_FUNCTIONS = ("sin", "cos", "tan", "exp", "sqrt")


def formula(text: str, names: Sequence[str]) -> Formula:
    """Formula of a text: numbers, names, +, -, *, /, brackets and functions.

    Raises:
        Refused: it has anything else.
    """

    def read(node: Any, depth: int) -> Formula:
        need(depth <= 60, f"its formula {text[:80]!r} is nested too deep.")
        match node:
            case ast.Constant(value=int() | float() as value) if (
                type(value) is not bool and abs(value) < 1e300
            ):
                number = arb(float(value))
                return lambda _: number
            case ast.Name(id=name) if name in names:
                return operator.itemgetter(list(names).index(name))
            case ast.UnaryOp(op=ast.USub()):
                inner = read(node.operand, depth + 1)
                return lambda values: -inner(values)
            case ast.BinOp(op=op) if type(op) in _SIGNS:
                sign = _SIGNS[type(op)]
                a, b = (read(part, depth + 1) for part in (node.left, node.right))
                return lambda values: sign(a(values), b(values))
            case ast.Call(func=ast.Name(id=name), args=[argument], keywords=[]) if (
                name in _FUNCTIONS
            ):
                inner = read(argument, depth + 1)
                return lambda values: getattr(inner(values), name)()
        raise Refused(f"its formula {text[:80]!r} has more than names, numbers and functions.")

    try:
        return read(ast.parse(text, mode="eval").body, 0)
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        raise Refused(f"its formula {text[:80]!r} cannot be read.") from error


class Sloped:
    """Series of a function of the state: at the centre, over the set, and its slopes by the variables in it."""

    def __init__(self, at: Any, over: Any, slopes: dict[int, Any]) -> None:
        self.at = at
        self.over = over
        self.slopes = slopes

    def of(self, other: Any) -> Sloped:
        """A number as a function."""
        if isinstance(other, Sloped):
            return other
        constant = arb_series([other])
        return Sloped(constant, constant, {})

    def __add__(self, other: Any) -> Sloped:
        b = self.of(other)
        slopes = self.slopes | {
            k: self.slopes[k] + q if k in self.slopes else q for k, q in b.slopes.items()
        }
        return Sloped(self.at + b.at, self.over + b.over, slopes)

    def __mul__(self, other: Any) -> Sloped:
        b = self.of(other)
        slopes = {k: p * b.over for k, p in self.slopes.items()}
        for k, q in b.slopes.items():
            slopes[k] = slopes[k] + self.at * q if k in slopes else self.at * q
        return Sloped(self.at * b.at, self.over * b.over, slopes)

    __radd__, __rmul__ = __add__, __mul__

    def __neg__(self) -> Sloped:
        return Sloped(-self.at, -self.over, {k: -p for k, p in self.slopes.items()})

    def __sub__(self, other: Any) -> Sloped:
        return self + -self.of(other)

    def __rsub__(self, other: Any) -> Sloped:
        return -self + other

    def __truediv__(self, other: Any) -> Sloped:
        return self * self.of(other).bent(lambda x: (1 / x, -1 / (x * x), 2 / (x * x * x)))

    def __rtruediv__(self, other: Any) -> Sloped:
        return self.of(other) / self

    def bent(self, function: Callable[[Any], tuple[Any, Any, Any]]) -> Sloped:
        """A function of this one, which gives its value and its first and second derivative.

        f(z) - f(c) is (z - c) (f'(c) + (z - c) times the mean of (1 - t) f''(c + t (z - c)) over t from 0 to 1).
        """
        at, first, _ = function(self.at)
        over, _, second = function(self.over)
        slope = first + (self.over - self.at) * second * arb("0.5")
        return Sloped(at, over, {k: slope * p for k, p in self.slopes.items()})

    def sin(self) -> Sloped:
        """See `_FUNCTIONS`, as for the others."""
        return self.bent(lambda x: (x.sin(), x.cos(), -x.sin()))

    def cos(self) -> Sloped:
        """The cosine."""
        return self.bent(lambda x: (x.cos(), -x.sin(), -x.cos()))

    def exp(self) -> Sloped:
        """The exponential function."""
        return self.bent(lambda x: (x.exp(), x.exp(), x.exp()))

    def tan(self) -> Sloped:
        """The tangent."""
        return self.sin() / self.cos()

    def sqrt(self) -> Sloped:
        """The square root."""
        half = arb("0.5")
        return self.bent(lambda x: (x.sqrt(), half / x.sqrt(), -half * half / (x * x.sqrt())))


def _linear(text: str, names: Sequence[str]) -> list[Any]:
    """Factors of names in a formula, and its constant as the last one; a formula that is not linear is refused."""
    ctx.cap = 1
    zero, wide = arb_series([0]), arb_series([arb(0, 1e30)])
    variables = [Sloped(zero, wide, {k: arb_series([1])}) for k in range(len(names))]
    result = variables[0].of(formula(text, names)(variables))
    row = [result.slopes[k][0] if k in result.slopes else arb(0) for k in range(len(names))]
    row.append(result.at[0])
    is_linear = all(x.is_finite() and x.rad() <= 1e-15 * (1 + abs(x.mid())) for x in row)
    need(is_linear, f"its formula {text[:80]!r} is no linear function of the state.")
    return row


class Plant:
    """Plant whose commands are held.

    Args:
        rates: formula of each state's rate.
        commands: number of commands.
        period: s for which they are held.
    """

    def __init__(self, rates: Sequence[str], commands: int, period: float) -> None:
        self._count = len(rates)
        names = [f"x{i}" for i in range(len(rates))] + [f"u{i}" for i in range(commands)]
        self._rates = [formula(text, names) for text in rates]
        self._period = arb(period)
        self.halvings = self._periods = 0

    def move(
        self, centre: Any, spread: Any, gain: Any, offset: Any, errors: Sequence[Any]
    ) -> list[tuple[Any, Any, list[Any]]]:
        """Sets at the begin and end of the steps of a period, and how far the way is off the chord between.

        Args:
            centre: c (n, 1) of the states c + G s, |s| <= 1.
            spread: G (n, k).
            gain: commands are gain x + offset +- errors.
            offset: of the commands, (p, 1).
            errors: of the commands.
        """
        n = self._count
        # States and commands as one set, centre + spread s; errors of commands are further s.
        middle = [*centre.entries(), *(gain * centre + offset).entries()]
        of_states = side_by_side(spread, arb_mat(n, len(errors)))
        of_commands = side_by_side(gain * spread, diagonal(errors))
        wide = arb_mat(of_states.tolist() + of_commands.tolist())
        first = middle, wide
        pieces: list[tuple[Any, Any, list[Any]]] = []
        self._periods += 1
        if self._periods % 8 == 0:  # the motion may have become slower
            self.halvings = max(0, self.halvings - 1)
        while len(pieces) < 2**self.halvings:
            step: Any = None
            with contextlib.suppress(ValueError):  # FLINT's division by a ball round 0
                step = self._step(middle, wide, self._period / 2**self.halvings)
            if step is None:  # again, in shorter steps
                self.halvings += 1
                need(self.halvings <= _HALVINGS, "its motion has no bound within a Taylor step.")
                middle, wide, pieces = *first, []
                continue
            begin = column(middle[:n]), arb_mat(wide.tolist()[:n])
            (middle, wide), sag = step
            pieces.append((begin, (column(middle[:n]), arb_mat(wide.tolist()[:n])), sag))
        return pieces

    def _step(self, middle: list[Any], wide: Any, h: Any) -> tuple[Any, Any] | None:
        """Set after a step and its sag, or None if the step is too long."""
        n = self._count
        widths = absolute_row_sums(wide)
        balls = [_ball(c.mid(), w + c.rad()) for c, w in zip(middle, widths, strict=True)]
        during = self.during(balls, h)
        if during is None:
            return None
        ctx.cap = _TERMS + 1  # a series ends where the cap was when it was made
        rough = self._series([arb_series([x]) for x in during], _TERMS)
        # The next term over all of the motion is the rest of the series, and x'' h^2 / 8 the sag.
        rest = [abs(x[_TERMS] * h**_TERMS).upper() for x in rough]
        allowed = [
            _COARSE * w + _FINE * (abs(x) + arb("0.001"))
            for w, x in zip(widths, balls, strict=True)
        ]
        if not all(r.is_finite() and r < a.upper() for r, a in zip(rest, allowed, strict=False)):
            return None
        sag = [(h * h / 4 * abs(x[2])).upper() for x in rough]
        # f(z) is in f(c) + slopes (z - c), whose uncertain part is an error.
        ctx.cap = _TERMS
        start = [
            Sloped(arb_series([c.mid()]), arb_series([x]), {k: arb_series([1])})
            for k, (c, x) in enumerate(zip(middle, balls, strict=True))
        ]
        series = self._series(start, _TERMS - 1)
        after = [_sum(x.at, h) for x in series]
        slopes = arb_mat(
            [
                [_sum(x.slopes[k], h) if k in x.slopes else arb(0) for k in range(len(balls))]
                for x in series
            ]
        )
        fixed = arb_mat([[x.mid() for x in row] for row in slopes.tolist()])
        loose = arb_mat([[arb(x.rad()) for x in row] for row in slopes.tolist()])
        reach = column([w + arb(c.rad()) for w, c in zip(widths, middle, strict=True)])
        of_centre = (sizes(fixed) * column([arb(c.rad()) for c in middle])).entries()
        moved = [[*row] for row in (fixed * wide).tolist()]
        # The balls' own radii, which would grow from step to step, are errors, too.
        off = [
            a + b + r + arb(x.rad()) + sum((arb(y.rad()) for y in row), arb(0))
            for a, b, r, x, row in zip(
                (loose * reach).entries(), of_centre, rest, after, moved, strict=True
            )
        ]
        moved = arb_mat([[y.mid() for y in row] for row in moved] + wide.tolist()[n:])
        extra = arb_mat(diagonal(off).tolist() + [[arb(0)] * n] * (len(middle) - n))
        return ([x.mid() for x in after] + middle[n:], side_by_side(moved, extra)), sag

    def _series(self, start: list[Any], terms: int) -> list[Any]:
        """Series of the states, up to a power of time, from series of states and commands of one term."""
        states = start[: self._count]
        for k in range(terms):
            ctx.cap = k + 1  # the rates' terms that follow from the states' so far
            rates = [rate([*states, *start[self._count :]]) for rate in self._rates]
            ctx.cap = k + 2
            states = [_integral(x, rate) for x, rate in zip(start, rates, strict=False)]
        return states

    def during(self, balls: list[Any], h: Any) -> list[Any] | None:
        """Balls that hold the motion of a step from ``balls``: a guess that their own rates do not leave."""
        ctx.cap = 1

        def moved(guess: list[Any]) -> list[Any]:
            rates = [rate([arb_series([x]) for x in guess]) for rate in self._rates]
            rates = [r[0] if isinstance(r, arb_series) else r for r in rates]
            return [x + arb(0).union(h) * r for x, r in zip(balls, rates, strict=False)]

        guess = balls
        for _ in balls:  # states that follow from exact ones, one by one, need as many guesses
            guess = [
                _ball(x.mid(), x.rad() * arb("1.1") + abs(x) * arb(1e-9) + arb(1e-12))
                for x in moved(guess)
            ] + balls[self._count :]
            way = moved(guess)
            if all(x.contains_interior(y) for x, y in zip(guess, way, strict=False)):
                # The motion is within what a box that holds it is moved to, and in that of this.
                return moved(way + balls[self._count :]) + balls[self._count :]
        return None


def reduced(centre: Any, spread: Any) -> tuple[Any, Any]:
    """A set around another one, in which the least columns of the spread are replaced by a box."""
    rows, columns = spread.nrows(), spread.ncols()
    kept = max(_KEPT, 10 * rows)
    if columns <= kept + rows:
        return centre, spread
    table = spread.tolist()
    scale = [float(w.upper()) or 1.0 for w in absolute_row_sums(spread)]
    sizes = [[abs(float(x.mid())) / s for x in row] for row, s in zip(table, scale, strict=True)]
    # A column along one state is a part of a box already, so that the second largest part says what is lost.
    order = sorted(range(columns), key=lambda k: sorted(row[k] for row in sizes)[-2:][0])[::-1]
    box = [sum((abs(row[k]) for k in order[kept:]), arb(0)) for row in table]
    left = arb_mat([[row[k] for k in order[:kept]] for row in table])
    return centre, side_by_side(left, diagonal(box))


def _ball(middle: Any, radius: Any) -> Any:
    return arb(middle, radius.upper())


def _sum(series: Any, h: Any) -> Any:
    """Value of a polynomial at h."""
    return functools.reduce(lambda total, x: total * h + x, reversed(series.coeffs()), arb(0))


def _integral(start: Any, rate: Any) -> Any:
    """Integral of a rate by time, from the first term of a series."""
    if isinstance(start, Sloped):
        rate = start.of(rate)
        slopes = {k: q.integral() for k, q in rate.slopes.items()}
        slopes |= {k: p + slopes[k] if k in slopes else p for k, p in start.slopes.items()}
        return Sloped(start.at + rate.at.integral(), start.over + rate.over.integral(), slopes)
    return start + (rate if isinstance(rate, arb_series) else arb_series([rate])).integral()


# 4. The property.


class Property:
    """A property of the state, of which a margin is not more than the state may move before it is broken.

    Args:
        keep: table of one kind and its limits.
        count: number of states.
    """

    def __init__(self, keep: dict[str, Any], count: int) -> None:
        ((self._kind, self._limit),) = keep.items()
        self._is_every = self._kind in ("within", "every")
        # Functions that are not to be negative, as rows of factors and constants: within a box those of its faces,
        # outside of it the negated ones.
        self._rows: list[tuple[Any, Any]] = []
        if self._kind in ("within", "avoid"):
            sign = 1 if self._is_every else -1
            for axis in range(count):
                row = arb_mat(1, count, [arb(int(i == axis)) for i in range(count)])
                low, high = (arb(self._limit[end][axis]) for end in ("lower", "upper"))
                self._rows += [(sign * row, -sign * low), (-sign * row, sign * high)]
        if self._kind in ("every", "some"):
            for text in self._limit:
                *factors, constant = _linear(text, [f"x{i}" for i in range(count)])
                self._rows.append((arb_mat(1, count, factors), constant))

    def margin(self, begin: Any, end: Any, sag: Sequence[Any]) -> float:
        """Margin over a piece of a flight, which is off the chord between its ends by at most ``sag``.

        It is of linear functions of the state, so that over the chord each is least at an end.
        """
        if not self._rows:
            return self._distance(begin, end, sag)
        margins = []
        for row, constant in self._rows:
            off = (sizes(row) * column(sag))[0, 0]
            lowest = [constant - _highest(-row, state) - off for state in (begin, end)]
            margins.append(_least(x.lower() for x in lowest))
        return _least(margins) if self._is_every else max(margins)

    def _distance(self, begin: Any, end: Any, sag: Sequence[Any]) -> float:
        """Margin of a ball to keep out of or to stay in, or of a limit of the speed, |v| < base + slope |p|.

        Along any unit vector d a position is no longer than it is, |p| >= d p: here along the middle of the chord.
        A velocity in the plane is at most 1 / cos(pi / K) times its longest component along K directions.
        """
        limit, position = self._limit, self._limit["position"]
        if self._kind == "stay_in":  # the farthest corner of the boxes around both ends
            hulls = [_hull(state) for state in (begin, end)]
            corners = [[abs(hull[i]).upper() + sag[i] for i in position] for hull in hulls]
            return _least((arb(limit["radius"]) - _norm(corner)).lower() for corner in corners)
        is_speed = self._kind == "speed_limit"
        ahead = [arb((begin[0][i, 0] + end[0][i, 0]).mid()) for i in position]
        slope = arb(limit["slope"]) if is_speed else arb(1)
        # The rows times a state are what counts against the margin; the sag adds to them.
        row = [arb(0)] * len(sag)
        for i, value in zip(position, ahead, strict=True):
            row[i] -= slope * value / _norm(ahead)
        off = slope * _norm(sag[i] for i in position)
        rows, base = [row], arb(limit["base"] if is_speed else -limit["radius"])
        if is_speed:
            off += _norm(sag[i] for i in limit["velocity"])
            turns = [arb(2 * side) / _SIDES for side in range(_SIDES)]
            rows = [list(row) for _ in turns]
            for row_of_turn, turn in zip(rows, turns, strict=True):
                direction = turn.cos_pi(), turn.sin_pi()
                for i, value in zip(limit["velocity"], direction, strict=True):
                    row_of_turn[i] += value / (arb(1) / _SIDES).cos_pi()
        factors = [arb_mat(1, len(sag), values) for values in rows]
        return _least(
            (base - _highest(x, state) - off).lower() for x in factors for state in (begin, end)
        )

    def value(self, state: tuple[Any, Any]) -> Any:
        """Ball around the property's value over a set, which is below 0 where it is broken."""
        x = _hull(state)
        values = [(row * column(x))[0, 0] + constant for row, constant in self._rows]
        if values:
            return functools.reduce(arb.min if self._is_every else arb.max, values)
        limit, distance = self._limit, _norm(x[i] for i in self._limit["position"])
        if self._kind == "speed_limit":
            speed = _norm(x[i] for i in limit["velocity"])
            return arb(limit["base"]) + arb(limit["slope"]) * distance - speed
        away = distance - arb(limit["radius"])
        return away if self._kind == "keep_out" else -away


def _hull(state: tuple[Any, Any]) -> list[Any]:
    """Balls around each coordinate of a set."""
    widths = absolute_row_sums(state[1])
    return [x + arb(0, w.upper()) for x, w in zip(state[0].entries(), widths, strict=True)]


def _norm(vector: Iterable[Any]) -> Any:
    return sum((x * x for x in vector), arb(0)).nonnegative_part().sqrt()


def _least(values: Iterable[Any]) -> float:
    """Least number; what is none, such as infinity less infinity, is below all."""
    return min(x if x == x else -math.inf for x in map(float, values))


def _highest(row: Any, state: tuple[Any, Any]) -> Any:
    """Largest value of a row of factors (1, n) times a state (centre, spread)."""
    return (row * state[0])[0, 0] + absolute_row_sums(row * state[1])[0]


# 5. The closed loop.


class Loop:
    """Closed loop of a problem and a network, in balls.

    Args:
        problem: table of `problem_table`.
        network: content of the ONNX file.
    """

    def __init__(self, problem: dict[str, Any], network: bytes) -> None:
        self._problem = problem
        count = len(problem["derivative"])
        names = [f"x{i}" for i in range(count)]
        # What the network takes, as rows of factors and a constant, and its range over the starts.
        rows = [_linear(text, names) for text in problem.get("inputs", names)]
        self._inputs = arb_mat([row[:-1] for row in rows]), column([row[-1] for row in rows])
        ends = list(zip(problem["start"]["lower"], problem["start"]["upper"], strict=True))
        self._spans = [high - low for low, high in ends]
        start = _set(ends)
        taken = _hull((self._inputs[0] * start[0] + self._inputs[1], self._inputs[0] * start[1]))
        low, high = (tuple(float(end(x)) for x in taken) for end in (arb.lower, arb.upper))
        self._layers = layers_of(network, low, high)
        given, commands = self._layers[-1][0].nrows(), problem["commands"]
        need(
            given == commands,
            f"its network gives {given} numbers, and its problem has {commands} commands.",
        )
        self._plant = Plant(problem["derivative"], commands, problem["period"])
        self._keep = Property(problem["keep"], count) if "keep" in problem else None
        self._end = Property({"within": _last(problem)}, count) if "end" in problem else None
        self._begins = problem.get("begins", 0)
        self._earliest = problem.get("end", {}).get("earliest", 0) or problem["steps"]

    def _pieces(self, centre: Any, spread: Any) -> Iterator[tuple[int, bool, Any, Any, Any]]:
        """Pieces of flights: control period, whether it ends with the piece, begin, end and sag."""
        self._plant.halvings = 0
        for number in range(self._problem["steps"]):
            pieces = self._plant.move(centre, spread, *self._commands(centre, spread))
            for begin, end, sag in pieces:
                centre, spread = end
                yield number, begin is pieces[-1][0], begin, end, sag
            centre, spread = reduced(centre, spread)

    def _commands(self, centre: Any, spread: Any) -> tuple[Any, Any, list[Any]]:
        """Commands of a set of states x: gain x + offset +- errors."""
        table, shift = self._inputs
        taken = table * centre + shift, table * spread
        gain, offset, errors = network_enclosure(self._layers, *taken)
        return gain * table, gain * shift + offset, errors

    def margin(self, cell: Any, depth: int = 0) -> float:
        """Margin over all times of the flights from a cell, which is halved ``depth`` times at most."""
        try:
            margin = self._margin(*_set(cell))
        except Refused:  # of a motion without a bound
            margin = -math.inf
        if margin > 0.0 or not depth:
            return margin
        # Halves along the state that is widest as a part of its starts, until one is refused.
        margins: list[float] = []
        parts = [
            (b - a) / (span or math.inf) for (a, b), span in zip(cell, self._spans, strict=True)
        ]
        axis = parts.index(max(parts))
        low, high = cell[axis]
        cut = low + (high - low) / 2
        for part in ((low, cut), (cut, high)):
            margins.append(self.margin([*cell[:axis], part, *cell[axis + 1 :]], depth - 1))
            if not margins[-1] > 0.0:
                break
        return min(margins)

    def _margin(self, centre: Any, spread: Any) -> float:
        """Margin over all times of the flights from a set."""
        least, at_end = math.inf, -math.inf
        still = [arb(0)] * centre.nrows()
        for number, is_last, begin, end, sag in self._pieces(centre, spread):
            if self._keep is not None and number >= self._begins:
                least = _least((least, self._keep.margin(begin, end, sag)))
            if not least > 0.0:
                return least
            if self._end is not None and is_last and number + 1 >= self._earliest:
                at_end = max(at_end, _least((self._end.margin(end, end, still),)))
        return least if self._end is None else min(least, at_end)

    def broken(self, flight: Sequence[Sequence[float]]) -> float:
        """How far below 0 the property's value is on a flight that was written out, at the worst instant.

        Raises:
            Refused: the flight is another one than this program's, or does not surely break the property.
        """
        point = _set((x, x) for x in flight[0])
        values = [self._keep.value(point)] if self._keep is not None and self._begins == 0 else []
        at_ends = []
        for number, is_last, begin, end, _ in self._pieces(*point):
            if self._keep is not None and number >= self._begins:
                values += [self._keep.value(begin), self._keep.value(end)]
            if not is_last:
                continue
            for x, claimed in zip(_hull(end), map(arb, flight[number + 1]), strict=True):
                # A flight as the rounding of the file may make it, which is a ball, is near it.
                is_near = abs(x - claimed).lower() <= arb(_OFF) * (1 + abs(claimed))
                need(is_near, f"its flight is another one in period {number}.")
            if self._end is not None and number + 1 >= self._earliest:
                at_ends.append(self._end.value(end))
        # The end's box is missed if it is missed at every instant at which a flight may be in it.
        lowest = [float(x.upper()) for x in values if x.is_finite()]
        if at_ends and all(x.is_finite() for x in at_ends):
            lowest.append(max(float(x.upper()) for x in at_ends))
        worst = min(lowest, default=math.inf)
        need(worst < 0.0, f"its flight does not surely break the property: {worst:.3g}.")
        return worst


def _last(problem: dict[str, Any]) -> dict[str, list[float]]:
    """Box in which flights end; a state that never changes and starts in it needs no margin, and has no ends."""
    start, end = problem["start"], problem["end"]
    box = {"lower": list(end["lower"]), "upper": list(end["upper"])}
    for i, rate in enumerate(problem["derivative"]):
        is_inside = end["lower"][i] <= start["lower"][i] and start["upper"][i] <= end["upper"][i]
        if rate.strip() == "0" and is_inside:
            box["lower"][i], box["upper"][i] = -1e9, 1e9
    return box


def _set(cell: Iterable[tuple[float, float]]) -> tuple[Any, Any]:
    """Centre (n, 1) and spread (n, n) of a box."""
    ends = [(arb(a), arb(b)) for a, b in cell]
    return column([(a + b) / 2 for a, b in ends]), diagonal([(b - a) / 2 for a, b in ends])
