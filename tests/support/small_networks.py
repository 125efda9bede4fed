"""Small networks of proofs, and files that ONNX writes of them."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from rans_proof.network import Layer


def layers(
    sizes: Sequence[int], seed: int, activation: str = "tanh", scale: float = 1.0
) -> list[Layer]:
    random = np.random.default_rng(seed)
    return [
        Layer(
            scale * random.normal(size=(b, a)) / np.sqrt(a), 0.3 * random.normal(size=b), activation
        )
        for a, b in itertools.pairwise(sizes)
    ]


def damping(inputs: int, velocity: Sequence[int], seed: int) -> list[Layer]:
    """A network that brakes, roughly: u = tanh(-6 v + a little of the rest)."""
    first, last = layers([inputs, 16, len(velocity)], seed, scale=0.2)
    weight = 0.002 * first.weight
    for k, i in enumerate(velocity):
        weight[k] = 0.0
        weight[k, i] = 1.0
    out = 0.01 * last.weight
    for k in range(len(velocity)):
        out[k, k] = -6.0
    return [Layer(weight, 0.0 * first.bias, "tanh"), Layer(out, 0.0 * last.bias, "tanh")]


def written(network: Sequence[Layer], file: Path) -> Path:
    """The network as ONNX's own helpers write it."""
    from onnx import TensorProto, helper, numpy_helper

    nodes, tables, name = [], [], "x"
    for k, (weight, bias, activation, _) in enumerate(network):
        tables += [
            numpy_helper.from_array(weight.T.astype(np.float32), f"w{k}"),
            numpy_helper.from_array(bias.astype(np.float32), f"b{k}"),
        ]
        nodes += [
            helper.make_node("MatMul", [name, f"w{k}"], [f"m{k}"]),
            helper.make_node("Add", [f"m{k}", f"b{k}"], [f"a{k}"]),
            helper.make_node(activation.capitalize(), [f"a{k}"], [f"h{k}"]),
        ]
        name = f"h{k}"
    ends = [
        helper.make_tensor_value_info(one, TensorProto.FLOAT, ["N", width])
        for one, width in (("x", network[0].weight.shape[1]), (name, len(network[-1].bias)))
    ]
    graph = helper.make_graph(nodes, "net", ends[:1], ends[1:], tables)
    model = helper.make_model(graph, ir_version=8, opset_imports=[helper.make_opsetid("", 17)])
    file.write_bytes(model.SerializeToString())
    return file
