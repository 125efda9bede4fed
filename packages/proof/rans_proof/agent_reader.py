"""The checkers' own reader of an agent's file, without a line of the reader that flies it.

An ``agent.safetensors`` is eight bytes with the length of a header, the header as JSON, and all tensors' bytes.
RANS keeps in the header's metadata a table of the network, whose tensors are named by their path in it. What is not
exactly of a kind that a checker computes is refused: dense layers, on/off commands, no memory, no zoom.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from rans_proof.balls import Refused, need
from rans_proof.claims import json_of

_KINDS = {"F32": "<f4", "F64": "<f8"}
"""Types of tensors that are read: little-endian floating-point numbers."""
_PLAIN = {
    "zoom": (0.0,),
    "symmetries": (None,),
    "bf16": (False,),
    "head": ("on-off",),
    "continuous": (False,),
    "levers": ([],),
    "backbone": ("dense",),
    "tokens": ([],),
    "authority": ([],),
    "coast": (0.0,),
    "farthest": (0.0,),
    "farthest_lost": (0.0,),
    "frugal": ([],),
    "reach": ([],),
    "filling": ([],),
    "adapts": (False,),
    "history": (0,),
    "commands_only": (False,),
    "averages": ([],),
    "filters": (None,),
    "units": (0,),
    "clip": (10.0,),
    "preprocessor": ("body",),
}
"""Entries of a network's table and the only value that a checker computes; older files have `continuous`."""
_FREE = {"thrusters", "layers", "activation", "layout", "privileged", "nominal", "bounds"}
"""Entries that are compared elsewhere here, or are not of what flies: the critic's, and a contract's."""
_SAME = {"OwnAttitude": "OwnRotation", "Spin": "AngularVelocity", "Turn": "RelativeRotation"}
"""Names of an observation's blocks in older files, and the ones of today."""
_LAYOUT = [
    ("OwnRotation", 2),
    ("VectorInW", 2),
    ("AngularVelocity", 1),
    ("Scalar", 1),
    ("VectorInW", 2),
    ("RelativeRotation", 2),
]
"""Observation of go-to-pose in the plane, block by block with the widths: rotation, velocity, spin, the task's
flag, and the way and the turn to the goal."""
COLUMNS = 8
"""Columns of a network in the plane: an observation in the body frame, without the craft's own rotation."""


class AgentWeights(NamedTuple):
    """Numbers of an agent's network in double precision, which holds those of the file exactly."""

    activation: str
    """Function between layers."""
    layers: list[tuple[np.ndarray, np.ndarray]]
    """Weights (units, inputs) and biases (units,) of each hidden layer."""
    head: tuple[np.ndarray, np.ndarray]
    """Weights (2 n, units) and biases (2 n,) of the outputs: scores of shut and open for each of n thrusters."""
    mean: np.ndarray
    """(8,) of the columns, which are normalised by it."""
    variance: np.ndarray
    """(8,) of the columns."""


def read_agent(content: bytes, thrusters: int) -> AgentWeights:
    """Weights of the file of an agent that goes to a pose in the plane.

    Args:
        content: content of ``agent.safetensors``.
        thrusters: number of thrusters that it must command.

    Raises:
        Refused: the file is damaged, or of a network that no checker computes.
    """
    header, tensors = _tensors(content)
    metadata = header.get("__metadata__")
    if not isinstance(metadata, dict) or not isinstance(metadata.get("rans"), str):
        raise Refused("it has no table of RANS")
    table = json_of(metadata["rans"], len(content))
    need(
        isinstance(table, dict) and isinstance(table.get("architecture"), dict),
        "its table has no network",
    )
    # The kind of the network.
    network = table["architecture"]
    for name, value in network.items():
        need(name in _PLAIN or name in _FREE, f"its network has {name!r}, which no checker knows")
        allowed = _PLAIN.get(name)
        need(
            allowed is None or any(value == x and type(value) is type(x) for x in allowed),
            f"its network's {name} is not one that a checker computes",
        )
    need("head" in network or "continuous" in network, "its network does not say what it commands")
    need(network.get("thrusters") == thrusters, "it is of another number of thrusters")
    need(_blocks(network.get("layout")) == _LAYOUT, "it observes another task")
    # The weights, each by the path at which the table refers to it.
    weights = table.get("weights")
    if not isinstance(weights, dict):
        raise Refused("its table has no weights")
    for name, reference in weights.items():
        need(reference == {"$tensor": f"weights/{name}"}, f"its {name} is another tensor's")
    values = {name: tensors.get(f"weights/{name}") for name in weights}
    sizes = network.get("layers")
    if not isinstance(sizes, list) or not sizes or any(type(x) is not int or x < 1 for x in sizes):
        raise Refused("its layers are no list of sizes")

    def taken(name: str, *shape: int) -> np.ndarray:
        value = values.pop(name, None)
        if value is None or value.shape != shape:
            raise Refused(f"its {name} is missing, or of another size")
        return value

    layers = []
    width = COLUMNS
    for number, units in enumerate(sizes):
        trunk = f"features_extractor.trunk.{2 * number}"
        layers.append((taken(f"{trunk}.weight", units, width), taken(f"{trunk}.bias", units)))
        width = units
    head = taken("action_net.weight", 2 * thrusters, width), taken("action_net.bias", 2 * thrusters)
    mean, variance = (taken(f"features_extractor.{name}", COLUMNS) for name in ("mean", "variance"))
    need(bool((variance >= 0.0).all()), "a variance is below zero")
    left = [name for name in values if not _is_unused(name)]
    need(not left, f"nothing of a dense network is its {left[:1]}")
    activation = network.get("activation", "tanh")
    return AgentWeights(activation, layers, head, mean, variance)


def _is_unused(name: str) -> bool:
    """Whether a tensor is not of what flies: the critic's, or the number of observations that were normalised."""
    return (
        name.startswith(("value_net.", "features_extractor.critic."))
        or name == "features_extractor.count"
    )


def _blocks(rows: Any) -> list[tuple[str, int]]:
    """Names and widths of an observation's blocks in order, to compare with `_LAYOUT`; else `Refused`."""
    need(isinstance(rows, list), "its observation")
    result = []
    for row in rows:
        need(isinstance(row, list) and len(row) == 3 and isinstance(row[0], str), "its observation")
        name = row[0].rpartition(".")[2]
        need(type(row[1]) is int and row[2] == [], "its observation")
        result.append((_SAME.get(name, name), row[1]))
    return result


def _tensors(content: bytes) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Header, and tensors of floating-point numbers, of a safetensors file; its bytes are each of one tensor.

    Bytes that belong to no tensor or to two are refused, and so is every number that is not finite.
    """
    length = int.from_bytes(content[:8], "little")
    need(0 < length <= len(content) - 8, "its header is longer than the file")
    header = json_of(content[8 : 8 + length], length)
    need(isinstance(header, dict), "its header is no table")
    data = content[8 + length :]
    tensors = {}
    parts = []
    for name, entry in header.items():
        if name == "__metadata__":
            continue
        need(
            isinstance(entry, dict) and entry.keys() == {"dtype", "shape", "data_offsets"},
            f"tensor {name}",
        )
        shape, (begin, end) = entry["shape"], entry["data_offsets"]
        need(all(type(x) is int and x >= 0 for x in (*shape, begin, end)), f"tensor {name}'s size")
        need(begin <= end <= len(data), f"tensor {name} is beyond the file")
        parts.append((begin, end))
        kind = _KINDS.get(entry["dtype"])
        if kind is None:
            continue
        size = np.dtype(kind).itemsize
        need(
            end - begin == math.prod(shape) * size, f"tensor {name} has another size than its shape"
        )
        value = np.frombuffer(data[begin:end], kind).astype(float).reshape(shape)
        need(bool(np.isfinite(value).all()), f"tensor {name} has numbers that are not finite")
        tensors[name] = value
    place = 0
    for begin, end in sorted(parts):
        need(begin == place, "its tensors overlap, or leave a gap")
        place = end
    need(place == len(data), "bytes of no tensor follow")
    return header, tensors
