"""Small networks of proofs, and files that ONNX writes of them."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rans_proof.network import Layer

from tests.support.graphs import model_of, step


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
    nodes, name = [], "x"
    tables: dict[str, Any] = {}
    for k, (weight, bias, activation, _) in enumerate(network):
        tables |= {f"w{k}": weight.T, f"b{k}": bias}
        nodes += [
            step("MatMul", f"{name} w{k}", f"m{k}"),
            step("Add", f"m{k} b{k}", f"a{k}"),
            step(activation.capitalize(), f"a{k}", f"h{k}"),
        ]
        name = f"h{k}"
    ends = {"x": ("N", network[0].weight.shape[1])}, {name: ("N", len(network[-1].bias))}
    file.write_bytes(model_of(nodes, *ends, **tables))
    return file
