"""Dense networks: layers of a weight, a bias and an activation, as read from an ONNX file."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from rans.errors import ConfigError, brief, require
from rans.files import first_line, read_bytes

_LARGEST = 2**26
"""Bytes of an ONNX file that is read; networks in control have less than a thousandth of it."""

ACTIVATIONS = {"Tanh": "tanh", "Sigmoid": "sigmoid", "Relu": "relu"}
"""Operations of ONNX that bend, and their names here."""


class Layer(NamedTuple):
    """Layer y = activation(weight x + bias)."""

    weight: np.ndarray
    """(outputs, inputs)."""
    bias: np.ndarray
    """(outputs,)."""
    activation: str
    """ "tanh", "sigmoid", "relu" or "" for none."""


def read_network(file: Path) -> list[Layer]:
    """Layers of the network in an ONNX file, in double precision.

    Known are chains of MatMul, Gemm, Add, Sub, convolutions of one pixel (Conv), Flatten, Reshape, Tanh,
    Sigmoid and Relu. Linear operations that follow one another are joined into one layer.

    Raises:
        ConfigError: the file cannot be read, or has another operation or more than one chain.
        MissingPackage: the package onnx is not installed.
    """
    onnx = require("onnx")
    content = read_bytes(file, _LARGEST)
    try:
        graph = onnx.load_model_from_string(content).graph
        tables = {
            tensor.name: onnx.numpy_helper.to_array(tensor).astype(np.float64)
            for tensor in graph.initializer
        }
        return _layers(graph, tables, file)
    except ConfigError:
        raise
    except Exception as error:  # a damaged file may raise anything
        raise ConfigError(f"{file} is no network that can be read: {first_line(error)}.") from error


def _layers(graph: Any, tables: dict[str, np.ndarray], file: Path) -> list[Layer]:
    """Layers of a chain of operations, whose matrices and vectors are in the tables."""
    inputs = [tensor.name for tensor in graph.input if tensor.name not in tables]
    if len(inputs) != 1:
        raise ConfigError(f"{file} has {len(inputs)} inputs; a proof is about a network of one.")
    # Linear operations are joined until an activation ends their layer; a weight of None stands for none so far.
    current = inputs[0]
    layers: list[Layer] = []
    weight: np.ndarray | None = None
    bias: np.ndarray | float = 0.0
    for node in graph.node:
        if current not in node.input:
            raise ConfigError(
                f"{file} is not a chain: {brief(node.op_type)} does not take what comes before it."
            )
        operands = [tables[name] for name in node.input if name in tables]
        attributes = {item.name: item for item in node.attribute}
        match node.op_type:
            case "MatMul":
                (table,) = operands
                weight, bias = _then(weight, bias, table.T)
            case "Gemm":
                table = operands[0] if attributes["transB"].i else operands[0].T
                weight, bias = _then(weight, bias, table)
                bias = bias + (operands[1] if len(operands) > 1 else 0.0)
            case "Conv":
                if operands[0].shape[2:] != (1,) * (operands[0].ndim - 2) and layers:
                    raise ConfigError(
                        f"{file} has a convolution of {operands[0].shape[2:]} pixels; known are those of one."
                    )
                weight, bias = _then(weight, bias, operands[0].reshape(len(operands[0]), -1))
                bias = bias + (operands[1] if len(operands) > 1 else 0.0)
            case "Add" | "Sub":
                sign = 1.0 if node.op_type == "Add" else -1.0
                bias = bias + sign * operands[0].ravel()
            case "Tanh" | "Sigmoid" | "Relu":
                layers.append(_layer(weight, bias, ACTIVATIONS[node.op_type], layers, file))
                weight = None
                bias = 0.0
            case "Flatten" | "Reshape":
                pass
            case _:
                raise ConfigError(
                    f"{file} has the operation {brief(node.op_type)}; known are MatMul, Gemm, Add, Sub, Conv, "
                    "Flatten, Reshape, Tanh, Sigmoid and Relu."
                )
        current = node.output[0]
    if weight is not None:
        layers.append(_layer(weight, bias, "", layers, file))
    if not layers:
        raise ConfigError(f"{file} has no layer.")
    return layers


def _then(
    weight: np.ndarray | None, bias: np.ndarray | float, table: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Weight and bias of a linear operation after those so far."""
    shift = np.broadcast_to(np.asarray(bias, dtype=float), table.shape[1:])
    return table if weight is None else table @ weight, table @ shift


def _layer(
    weight: np.ndarray | None,
    bias: np.ndarray | float,
    activation: str,
    before: list[Layer],
    file: Path,
) -> Layer:
    if weight is None:
        raise ConfigError(f"{file} has an activation without a layer of weights before it.")
    layer = Layer(
        weight, np.broadcast_to(np.asarray(bias, dtype=float), weight.shape[:1]).copy(), activation
    )
    if not (np.isfinite(layer.weight).all() and np.isfinite(layer.bias).all()):
        raise ConfigError(f"{file} has a weight that is not finite.")
    if before and weight.shape[1] != len(before[-1].bias):
        raise ConfigError(f"{file} has layers that do not fit one another.")
    return layer


def apply(layers: list[Layer], states: np.ndarray) -> np.ndarray:
    """Outputs (N, outputs) of a network for states (N, inputs)."""
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
