"""Decide ARCH-COMP's problems of neural networks in control, from the organisers' own files.

`python -m campaigns.archcomp FOLDER` needs a folder with the networks, such as a clone of
https://github.com/verivital/ARCH-COMP2025; files are known by their SHA-256, wherever they are in it. Names of
problems after it choose some. Results, certificates and flights are written below `archcomp-results`. A proof takes
one core, and its check all.
"""

from __future__ import annotations

import hashlib
import io
import json
import sys
import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper
from rans_proof.certificate import write_certificate
from rans_proof.check import check
from rans_proof.network import network_of
from rans_proof.problem import read_problem
from rans_proof.prove import prove
from scipy.io import loadmat

from rans.extend import Terminal, Workers
from rans.processes import nothing

ROOT = Path(__file__).parents[1]
HERE = ROOT / "packages" / "proof" / "archcomp"
EXAMPLES = ROOT / "examples" / "proofs"


class Row(NamedTuple):
    """A problem."""

    problem: Path
    sha256: str
    """First digits of the network's SHA-256."""
    first: int | tuple[int, ...] = 1
    """Cells along each state to begin with; a number: along all."""


ROWS = {
    "single-pendulum": Row(HERE / "single-pendulum.toml", "f855ee789c5f360b"),
    "double-pendulum-less-robust": Row(
        HERE / "double-pendulum-less-robust.toml", "97a65bdbe5e449d6"
    ),
    "double-pendulum-more-robust": Row(
        HERE / "double-pendulum-more-robust.toml", "23ce3c4b3d2066cc"
    ),
    "tora-remain": Row(HERE / "tora-remain.toml", "52a50c6bc6b1b45b"),
    "tora-reach-tanh": Row(HERE / "tora-reach.toml", "97fd73dd8cb00c12"),
    "tora-reach-sigmoid": Row(HERE / "tora-reach.toml", "9ade5c0a51fa2309"),
    "unicycle": Row(HERE / "unicycle.toml", "9c9796ec74c0b11c"),
    "acc": Row(HERE / "acc.toml", "8dbc1a56cd77b264"),
    "nav-set": Row(HERE / "nav-set.toml", "d8220afa931b3e3b"),
    "nav-point": Row(HERE / "nav-point.toml", "cc356922a0842e5f", 16),
    "balancing-early": Row(HERE / "balancing-early.toml", "ac10c817c994e8ee", (4, 2, 16, 2)),
    "balancing-late": Row(HERE / "balancing-late.toml", "ac10c817c994e8ee"),
    "quad": Row(HERE / "quad.toml", "10e511efa754e128", 2),
    "airplane": Row(HERE / "airplane.toml", "655ba1e82d676373"),
    "attitude": Row(EXAMPLES / "attitude.toml", "5d819b007f6d6807"),
    "docking": Row(EXAMPLES / "docking.toml", "cc46c45e5ee7a0a5", 4),
}


def networks(folder: Path) -> dict[str, bytes]:
    """Content of every network in a folder, by the first digits of its SHA-256."""
    paths = [*sorted(folder.rglob("*.onnx")), *sorted(folder.rglob("*.mat"))]
    files = [path.read_bytes() for path in paths]
    return {hashlib.sha256(content).hexdigest()[:16]: content for content in files}


def renewed(content: bytes) -> bytes:
    """A network of ONNX's version 6 in version 13, or one of a MATLAB file as ONNX; others as they are.

    ACC's file subtracts a constant from four axes and multiplies them as one row, which ONNX Runtime does not do.
    Its weights and the order of its operations stay.
    """
    if content.startswith(b"MATLAB"):
        return _from_matlab(content)
    model = onnx.load_model_from_string(content)
    if model.opset_import[0].version > 6:
        return content
    tables = {entry.name: numpy_helper.to_array(entry) for entry in model.graph.initializer}
    name = next(entry.name for entry in model.graph.input if entry.name not in tables)
    nodes, initializers = [], []
    ends = [name, model.graph.output[0].name]
    for node in model.graph.node:
        settings = {item.name: helper.get_attribute_value(item) for item in node.attribute}
        settings.pop("broadcast", None)
        nodes.append(helper.make_node(node.op_type, node.input, node.output, **settings))
        for operand in node.input:
            if operand in tables:
                table = tables.pop(operand)
                flat = table.reshape(1, -1) if node.op_type == "Sub" else table
                initializers.append(numpy_helper.from_array(flat, operand))
    sizes = [initializers[0].dims[-1], initializers[-1].dims[-1]]
    infos = [
        helper.make_tensor_value_info(end, TensorProto.FLOAT, [1, size])
        for end, size in zip(ends, sizes, strict=True)
    ]
    graph = helper.make_graph(nodes, "renewed", infos[:1], infos[1:], initializers)
    opset = helper.make_opsetid("", 13)
    return helper.make_model(graph, ir_version=8, opset_imports=[opset]).SerializeToString()


def _from_matlab(content: bytes) -> bytes:
    """Network of TORA's MATLAB files: layers W x + b with their activations, in double precision as they are."""
    table = loadmat(io.BytesIO(content))
    nodes, initializers = [], []
    layers = list(zip(table["W"].ravel(), table["b"].ravel(), table["act_fcns"], strict=True))
    for k, (weight, bias, activation) in enumerate(layers):
        initializers.append(numpy_helper.from_array(weight, f"W{k}"))
        initializers.append(numpy_helper.from_array(bias.ravel(), f"b{k}"))
        operands = [f"x{k}", f"W{k}", f"b{k}"]
        nodes.append(helper.make_node("Gemm", operands, [f"z{k}"], transB=1))
        nodes.append(helper.make_node(activation.strip().title(), [f"z{k}"], [f"x{k + 1}"]))
    sizes = {"x0": layers[0][0].shape[1], f"x{len(layers)}": layers[-1][0].shape[0]}
    infos = [
        helper.make_tensor_value_info(end, TensorProto.DOUBLE, [1, size])
        for end, size in sizes.items()
    ]
    graph = helper.make_graph(nodes, "matlab", infos[:1], infos[1:], initializers)
    opset = helper.make_opsetid("", 13)
    return helper.make_model(graph, ir_version=8, opset_imports=[opset]).SerializeToString()


def decide(name: str, content: bytes, output: Path) -> dict[str, Any]:
    """Prove or refute a problem, check the result, and say what was reached in which processor time."""
    row = ROWS[name]
    problem = read_problem(row.problem)
    content = renewed(content)
    layers = network_of(content, name, problem.input_range())
    begun = time.process_time()
    first = [row.first] * problem.states if isinstance(row.first, int) else row.first
    proof = prove(problem, layers, first=first)
    seconds = time.process_time() - begun
    result: dict[str, Any] = {"problem": name, "prove_s": round(seconds, 1)}
    file = output / f"{name}.json"
    if proof.counterexample is None and not proof.is_whole:
        return result | {"verdict": "open", "proved_part": proof.volume}
    write_certificate(proof, content, file)
    certificate = file.read_bytes()
    # A flight that refutes is one piece of work, and each cell is one.
    count = len(proof.low) if proof.counterexample is None else 1
    jobs = [(certificate, content, [k]) for k in range(count)]
    margins, times = zip(
        *Workers(nothing, (), None, "checked a certificate").ordered(_checked, jobs), strict=True
    )
    result |= {"check_s": round(sum(times), 1), "margin": min(margins), "cells": len(proof.low)}
    if proof.counterexample is not None:
        return result | {"verdict": "refuted", "start": np.round(proof.counterexample, 6).tolist()}
    return result | {"verdict": "proved"}


def _checked(_: None, certificate: bytes, network: bytes, cells: list[int]) -> tuple[float, float]:
    """Least margin of some cells, and the processor time of their check, s."""
    begun = time.process_time()
    margin = check(certificate, network, cells)
    return margin, time.process_time() - begun


def main(folder: Path, chosen: list[str]) -> None:
    """Decide the problems whose networks are in a folder."""
    output = Path("archcomp-results")
    output.mkdir(exist_ok=True)
    found = networks(folder)
    for name in chosen or ROWS:
        if ROWS[name].sha256 not in found:
            Terminal().say(f"{name}: its network is not in {folder}.")
            continue
        result = decide(name, found[ROWS[name].sha256], output)
        (output / f"{name}.result.json").write_text(json.dumps(result, indent=1) + "\n")
        Terminal().say(json.dumps(result))


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:])
